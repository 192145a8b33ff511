"""`StepMatrices`: what a filter about a path does in each step, block by block."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from kfgen.gap.flight.random.random_error import RandomError
from kfgen.model.filter_equations import FilterEquations

Array = NDArray[np.float64]
Places = tuple[NDArray[np.int64], NDArray[np.int64]]

KEPT_STEPS = 131072
"""Of a flight whose matrices are kept, in one block. A longer one's are computed anew for each pass over it, for they would
be most of what it holds in memory."""
STEPS_AT_ONCE = 32768
"""Steps of its blocks."""


@dataclass(frozen=True)
class Block:
    """Some steps in succession.

    Parameters
    ----------
    first : int
        The first one.
    Phi, Qd, B : ndarray, shape (steps, entries)
        Transition, process noise, and by how much errors of inputs move the error state.
    noise : mapping of str to ndarray, shape (steps, entries)
        What each input alone gives to ``Qd`` where its noise has the assumed size; of those whose size is given.
    """

    first: int
    Phi: Array
    Qd: Array
    B: Array
    noise: Mapping[str, Array]

    def resized(self, before: Mapping[str, float | Array], after: Mapping[str, float | Array]) -> Block:
        """See `StepMatrices.resized`."""
        Qd = self.Qd
        for name, size in after.items():
            now, old = (in_block(x, self.first, len(self.Qd)) for x in (size, before[name]))
            Qd = Qd + (now**2 - old**2) * self.noise[name]
        return replace(self, Qd=Qd)


@dataclass(frozen=True, eq=False)
class StepMatrices:
    """The blocks of a flight.

    Parameters
    ----------
    steps : int
        Of the flight.
    Phi_at, Qd_at : (ndarray, ndarray)
        Rows and columns of the entries of ``Phi`` and ``Qd``.
    made : callable
        The block that begins at a step.
    """

    steps: int
    Phi_at: Places
    Qd_at: Places
    made: Callable[[int], Block]

    @cached_property
    def _only(self) -> Block:
        return self.made(0)

    def beginning(self, first: int) -> Block:
        """The block that begins at a step; of a short flight it is kept."""
        return self._only if self.steps <= KEPT_STEPS else self.made(first)

    def blocks(self, backwards: bool = False) -> Iterator[Block]:
        """All blocks.

        Parameters
        ----------
        backwards : bool
            The last one first.
        """
        firsts = range(0, self.steps, _at_once(self.steps))
        yield from map(self.beginning, reversed(firsts) if backwards else firsts)

    def resized(
        self, before: Mapping[str, float | Array], after: Mapping[str, float | Array]
    ) -> StepMatrices:
        """With other sizes of the noise of inputs.

        Parameters
        ----------
        before, after : mapping of str to float or ndarray, shape (n,)
            Over what the filter assumes: of every input as these matrices have them, and as they are to be.
        """

        def made(first: int) -> Block:
            return self.beginning(first).resized(before, after)

        return StepMatrices(self.steps, self.Phi_at, self.Qd_at, made)

    def with_random_error(self, eq: FilterEquations, random_error: RandomError, states: int) -> StepMatrices:
        """With the states of a random error after those that are there.

        Parameters
        ----------
        eq : FilterEquations
        random_error : RandomError
        states : int
            That are there.
        """
        k, B = random_error.order, eq.input_errors
        block = np.arange(k)
        here, there = np.repeat(states + block, k), states + np.tile(block, k)
        is_input = random_error.channel in eq.channels
        column = eq.channels.index(random_error.channel) if is_input else -1
        own = np.flatnonzero(B.columns == column)
        loads = random_error.C.tolist() if is_input else []
        rows = np.concatenate([self.Phi_at[0], here, *(B.rows[own] for _ in loads)])
        columns = np.concatenate(
            [self.Phi_at[1], there, *(np.full(own.size, states + j) for j in range(len(loads)))]
        )

        def made(first: int) -> Block:
            b = self.beginning(first)
            Phi, Qd = (
                np.broadcast_to(M.ravel(), (b.Phi.shape[0], k * k))
                for M in (random_error.Phi, random_error.Qd)
            )
            moved = [b.Phi, Phi, *(c * b.B[:, own] for c in loads)]
            return Block(first, np.hstack(moved), np.hstack([b.Qd, Qd]), b.B, b.noise)

        Qd_at = np.append(self.Qd_at[0], here), np.append(self.Qd_at[1], there)
        return StepMatrices(self.steps, (rows, columns), Qd_at, made)


def step_matrices(
    eq: FilterEquations, given: Sequence[Array], steps: int, sizes: Mapping[str, float | Array]
) -> StepMatrices:
    """The matrices of a filter along a path.

    Parameters
    ----------
    eq : FilterEquations
    given : sequence of ndarray, shape (steps,) or (1,)
        Values of its variables.
    steps : int
    sizes : mapping of str to float or ndarray, shape (steps,)
        Of the noise of inputs, over what the filter assumes.
    """

    def made(first: int) -> Block:
        values = [g[first : first + _at_once(steps)] if g.size > 1 else g for g in given]
        Phi, Qd, B = (m.entries(values) for m in (eq.transition, eq.process_noise, eq.input_errors))
        noise = {name: eq.input_noise[name].entries(values) for name in sizes}
        return Block(first, Phi, Qd, B, noise).resized(dict.fromkeys(sizes, 1.0), sizes)

    F, Q = eq.transition, eq.process_noise
    return StepMatrices(steps, (F.rows, F.columns), (Q.rows, Q.columns), made)


def in_block(size: float | Array, first: int, steps: int) -> Array:
    """The size of a noise in the steps of a block, shape (1, 1) or (steps, 1).

    Parameters
    ----------
    size : float or ndarray, shape (n,)
        At all times, or at each.
    first, steps : int
        Of the block.
    """
    return np.atleast_1d(size)[first : first + steps, None] if np.ndim(size) else np.full((1, 1), size)


def _at_once(steps: int) -> int:
    """Steps of a block of a flight."""
    return steps if steps <= KEPT_STEPS else STEPS_AT_ONCE

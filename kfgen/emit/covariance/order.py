"""The order of the states in which the factors are cheapest to predict: rows first that need others.

States that drive one another in a circle stand side by side, as one group; the transition is upper triangular in groups.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from sympy.utilities.iterables import strongly_connected_components

Needs = dict[int, set[int]]
Groups = tuple[tuple[int, ...], ...]
PRODUCT = 2
"""Operations of an element of Phi in a column."""
SETUP, TURN, FIRST = 8, 4, 2
"""Operations of a rotation of two columns, of each row in it, and of each row more where the diagonal is not yet one."""
NOISE = 4
"""Operations of a row in a column that a noise goes through."""
MAX_PASSES = 4
"""Times that every run of states of a group is tried at every place."""


def in_groups(n: int, Phi: Mapping[int, Sequence[int]], driven: Sequence[int] = ()) -> Groups:
    """The states in groups that drive one another; each needs itself and groups after it only.

    Parameters
    ----------
    n : int
        States.
    Phi : mapping of int to sequence of int
        Non-zeros of the rows that differ from the identity's.
    driven : sequence of int
        States with white noise.
    """
    needs = {i: {j for j in Phi.get(i, ()) if j != i} for i in range(n)}
    edges = [(i, j) for i in needs for j in sorted(needs[i])]
    left = [sorted(g) for g in strongly_connected_components((list(range(n)), edges))]
    out: list[tuple[int, ...]] = []
    while left:
        needed = [{j for g in left if g is not one for i in g for j in needs[i]} for one in left]
        free = [g for g, wanted in zip(left, needed) if not wanted & set(g)]
        chosen = min(free)
        above = sum(map(len, out))
        size = above, n - above
        out.append(_cheapest(chosen, needs, size, set(driven)))
        left.remove(chosen)
    return tuple(out)


def _cheapest(group: list[int], needs: Needs, size: tuple[int, int], driven: set[int]) -> tuple[int, ...]:
    """The order of a group that takes the fewest operations of those that moving one run of states at a time leads to."""
    best = tuple(group)
    least = work(best, needs, size, driven)
    for _ in range(MAX_PASSES if len(group) > 1 else 0):
        before = least
        for order in _moved(best):
            tried = work(order, needs, size, driven)
            if tried < least:
                best, least = order, tried
        if least == before:
            break
    return best


def _moved(order: tuple[int, ...]) -> Iterator[tuple[int, ...]]:
    """The orders with a run of states at another place."""
    for length in range(1, len(order)):
        for first in range(len(order) - length + 1):
            run, rest = order[first : first + length], order[:first] + order[first + length :]
            for k in range(len(rest) + 1):
                yield (*rest[:k], *run, *rest[k:])


def work(order: tuple[int, ...], needs: Needs, size: tuple[int, int], driven: set[int]) -> int:
    """Operations of the products, the rotations and the noise of a group.

    Parameters
    ----------
    order : tuple of int
        Of its states.
    needs : mapping of int to set of int
        The states that drive each.
    size : (int, int)
        How many states there are above it, and from it on.
    driven : set of int
        States with white noise.
    """
    above, rest = size
    at = {state: k for k, state in enumerate(order)}
    total = sum(PRODUCT * (rest - at[j]) for i in order for j in needs[i] if j in at)
    for r, columns in rotations(filled(order, needs)):
        total += len(columns) * (SETUP + TURN * (above + r)) + FIRST * (above + r)
    tops = [above + at[i] for i in order if i in driven]
    return total + sum(NOISE * top * (top + 1) // 2 for top in tops)


def filled(order: Sequence[int], needs: Mapping[int, set[int]]) -> list[set[int]]:
    """Of each row of a group the columns before its own that are not zero in ``Phi U``, by places in the group.

    Parameters
    ----------
    order : sequence of int
    needs : mapping of int to set of int
    """
    at = {state: k for k, state in enumerate(order)}
    first = [min((at[j] for j in needs[i] if j in at), default=k) for k, i in enumerate(order)]
    return [set(range(f, k)) for k, f in enumerate(first)]


def rotations(below: Sequence[set[int]]) -> list[tuple[int, list[int]]]:
    """From the last row up the columns that are turned against its own, each with what the turns before filled in.

    Parameters
    ----------
    below : sequence of set of int
        As of `filled`.
    """
    left = [set(columns) for columns in below]
    out = []
    for r in range(len(left) - 1, -1, -1):
        columns = sorted(left[r])
        for c in columns:
            for k in range(c + 1, r):
                left[k].add(c)
        if columns:
            out.append((r, columns))
    return out

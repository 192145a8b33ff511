"""How many nats a flight is expected to have between two effects: what one does to the innovations that the other cannot.

With the effect A there, the log-likelihood of the best fit of A exceeds that of the best fit of B by
``1/2 min ||J_A a - f_B(b)||^2`` on average, over the sizes b and the constants that the alignment measured [1]_. Where B is
linear in b that is ``1/2 ||(I - P_B) J_A a||^2``, ``P_B`` projecting on its columns and on those of the constants.

References
----------
.. [1] S. Kullback, Information Theory and Statistics, 1959 (mean information for discrimination).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from kfgen.effects.inertial.lag import MOST_UNHEARD, Lag
from kfgen.gap.flight.scene import FlightScene
from kfgen.gap.scene.newton import derivative, first_steps
from kfgen.gap.scene.scene import Placed, ScenePoint, coordinates, is_signed, keys_of, moved
from kfgen.gap.scene.screen import basis, orthogonal_part

Array = NDArray[np.float64]

STARTS = (1.0, 0.1, 10.0)
"""Factors on corners and time constants of the other effect, from which its fit begins."""
MAX_STEPS = 12
STEP_SHARES = (1.0, 0.3, 0.1)
"""Of a step that are tried until less is left."""
MAX_STEP = 1.0
"""Longest step of a logarithm."""
MIN_SHARE = 1e-6
"""Of a direction of the other effect that must not be that of constants or of its other numbers: less is rounding."""
SETTLED_SHARE = 1e-4
"""Change of what is left, as a share of it, at which the fit ends."""


@dataclass(frozen=True)
class ExpectedResiduals:
    """A flight in which an effect is there and no noise: what is left of it beside other effects.

    Unlike those of `FlightScene` its responses are not in proportion to a short delay: a lag and a delay of the same
    length differ in what comes after the first order.

    Parameters
    ----------
    scene : FlightScene
        About the expected path.
    true : Placed
        The effect that is there.
    """

    scene: FlightScene
    true: Placed

    unknowns = ()

    @property
    def channels(self) -> tuple[str, ...]:
        """As of the flight."""
        return self.scene.channels

    @property
    def lengths(self) -> tuple[int, ...]:
        """As of the flight."""
        return self.scene.lengths

    @property
    def dt(self) -> float:
        """As of the flight."""
        return self.scene.dt

    @property
    def span(self) -> tuple[float, float]:
        """As of the flight."""
        return self.scene.span

    @cached_property
    def nuisance(self) -> Array:
        """Orthonormal directions of the constants that the alignment measured."""
        return basis(self.scene.of_constants)

    @cached_property
    def seen(self) -> Array:
        """What the effect does, shape (rows,)."""
        return self.responses([self.true])[:, 0]

    def responses(self, placed: Sequence[Placed]) -> Array:
        """What innovations lose by each of some effects, shape (rows, effects)."""
        path = self.scene.path
        du = np.zeros((*path.log.u.shape, len(placed)))
        dz = np.zeros((path.rows.t.size, len(placed)))
        for k, p in enumerate(placed):
            du[:, :, k], dz[:, k] = self.scene.errors([p])
        return self.scene.ordinates(path.linear.columns(du, dz))

    def residuals(self, points: Sequence[ScenePoint]) -> Array:
        """What one other effect leaves, see `kfgen.gap.scene.scene.Scene`."""
        return self.seen[:, None] - self.responses([p.placed[0] for p in points])

    def candidates(self, placed: Sequence[Placed]) -> list[list[Placed]]:
        """None."""
        return []


def after_memory(scene: FlightScene, placed: Sequence[Placed]) -> FlightScene:
    """A flight without the first readings, where lags depend on what was before it: that would pass for a difference.

    Parameters
    ----------
    scene : FlightScene
    placed : sequence of Placed
        Effects, lags among them.
    """
    memory = max((p.effect.memory()[0] for p in placed if isinstance(p.effect, Lag)), default=0.0)
    first, last = scene.span
    unheard = scene.path.rows.t < first + min(memory, MOST_UNHEARD * (last - first))
    return replace(scene, path=replace(scene.path, silenced=unheard), memory={})


def expected_nats(scene: FlightScene, true: Placed, other: Placed) -> float:
    """By how much the fit of an effect is expected to be more likely than that of another one, where it is the truth.

    Parameters
    ----------
    scene : FlightScene
        About the expected path.
    true : Placed
        With its sizes.
    other : Placed
        From whose sizes its fit begins.

    Returns
    -------
    float
        Mean difference of log-likelihoods [nats], without what each further free number gains by chance.
    """
    expected = ExpectedResiduals(scene, true)
    if not np.any(expected.seen):
        return 0.0
    return min(_left(expected, start) for start in _starts(other))


def _starts(placed: Placed) -> list[Placed]:
    """The effect itself, and with all its corners and time constants longer and shorter."""
    names = [n for _, n in keys_of([placed]) if not is_signed(placed.effect, n)]
    own = {n: float(getattr(placed.effect, n)) for n in names}
    return [
        replace(placed, effect=replace(placed.effect, **{n: f * v for n, v in own.items()}))
        for f in (STARTS if names else STARTS[:1])
    ]


def _left(expected: ExpectedResiduals, start: Placed) -> float:
    """Half the squared residual of the best fit of an effect from a start, by steps of Gauss and Newton."""
    point = ScenePoint((start,), np.zeros(0))
    logs = np.array([not is_signed(start.effect, n) for _, n in keys_of([start])], dtype=bool)
    residual, steps, Q = expected.residuals([point])[:, 0], first_steps(point), expected.nuisance
    left = float(np.sum(orthogonal_part(residual, Q) ** 2))
    for _ in range(MAX_STEPS):
        J, steps = derivative(expected, point, residual, steps)
        scale = np.maximum(np.linalg.norm(J, axis=0), 1e-300)
        own = orthogonal_part(J / scale, Q)
        own[:, np.linalg.norm(own, axis=0) < MIN_SHARE] = 0.0
        d = -np.linalg.lstsq(own, orthogonal_part(residual, Q), rcond=MIN_SHARE)[0] / scale
        d *= min(1.0, MAX_STEP / max(float(np.abs(d[logs]).max(initial=0.0)), 1e-300))
        tried = [moved(point, coordinates(point) + share * d) for share in STEP_SHARES]
        found = expected.residuals(tried)
        powers = np.sum(orthogonal_part(found, Q) ** 2, axis=0)
        best, before = int(np.argmin(powers)), left
        if not powers[best] < before:
            break
        point, residual, left = tried[best], found[:, best], float(powers[best])
        if before - left < SETTLED_SHARE * before:
            break
    return 0.5 * left

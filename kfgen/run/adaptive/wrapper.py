"""The rules on an emitted filter: a class between the emitted one and filterpy's.

The emitted class sets Q and calls filterpy's ``predict``, computes its residual and calls filterpy's ``update``. A base
put between the two meets both calls and scales what goes through: the emitted code stays as it is.

With several sensors each has its own factor on R and its own window (those of the very same R share them); the
factors on P and Q are common.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter
from numpy.typing import NDArray

from kfgen.core.errors import InputError
from kfgen.run.adaptive.loop import FORGETTING, WINDOW
from kfgen.run.adaptive.rules import Bounds, Factors, Rule, Seen, bounded, by_chance

Array = NDArray[np.float64]


@dataclass
class InnovationWindow:
    """What is remembered of one sensor: the last innovations, how many there were, its factors."""

    recent: deque[float] = field(default_factory=lambda: deque(maxlen=WINDOW))
    count: int = 0
    factors: Factors = field(default_factory=lambda: Factors(1.0, 1.0, 1.0, 1.0))


class Scaled(ExtendedKalmanFilter):  # type: ignore[misc]
    """filterpy's filter with P, Q and R scaled by a rule; the base that `adapted` puts in between.

    Attributes
    ----------
    rule, window, forgetting
        As of `adapted`.
    memories : dict
        By the variances of a sensor.
    scale_q : float
        On Q.
    adapted_nis : float
        Normalised squared innovation of the rows of one sample, with the scaled covariances.
    """

    rule: ClassVar[type[Rule]]
    window: ClassVar[int]
    forgetting: ClassVar[float]
    P: Any
    Q: Any

    def __init__(self, dim_x: int, dim_z: int) -> None:
        super().__init__(dim_x=dim_x, dim_z=dim_z)
        self.memories: dict[tuple[float, ...], InnovationWindow] = {}
        self.scale_q, self.adapted_nis = 1.0, 0.0

    def predict(self) -> None:
        """Predict with Q scaled."""
        self.Q = self.scale_q * self.Q
        super().predict()

    def update(self, z: Array, HJacobian: Callable[..., Array], Hx: Callable[..., Array], R: Array) -> None:
        """Update with P and R scaled by what the rule makes of the innovation.

        Innovations are counted in units of R, so that rows of several units can be added.
        """
        memory = self.memories.setdefault(
            tuple(np.diag(R).tolist()), InnovationWindow(deque(maxlen=self.window))
        )
        H, v, weight = HJacobian(self.x), z - Hx(self.x), 1.0 / np.diag(R)
        now = float(v.ravel() ** 2 @ weight)
        memory.recent.append(now)
        seen = Seen(
            float(memory.count),
            now,
            float(np.mean(memory.recent)),
            float(np.diag(H @ self.P @ H.T) @ weight),
            float(weight.size),
            by_chance(self.window, weight.size),
        )
        f = bounded(self.rule.adapt(seen, memory.factors, self.forgetting), Bounds())
        memory.factors, memory.count, self.scale_q = f, memory.count + 1, f.q
        self.P = f.fade * self.P
        super().update(z, HJacobian=HJacobian, Hx=Hx, R=f.r * f.once * R)
        self.adapted_nis += float((self.y.T @ self.SI @ self.y).item())


def adapted(
    emitted: type[Any], rule: type[Rule], window: int = WINDOW, forgetting: float = FORGETTING
) -> type[Any]:
    """An emitted filter class that adapts by a rule.

    Parameters
    ----------
    emitted : type
        A class of a module that kfgen emitted for filterpy.
    rule : subclass of Rule
    window : int
        Innovations of which the mean square is taken, of each sensor.
    forgetting : float
        ``b`` of Sage and Husa.

    Raises
    ------
    InputError
        A window or a memory that is none.
    """
    if window < 1 or not 0.0 < forgetting < 1.0:
        raise InputError(f"a window of {window} and a forgetting factor of {forgetting:g} are none")

    def fuse(self: Any, z: Array, h: Array, H: Array, variances: list[float], gate: float) -> Any:
        """As emitted; ``nis`` is that of the scaled covariances, of all rows together."""
        self.adapted_nis = 0.0
        status = vars(emitted)["_fuse"](self, z, h, H, variances, gate)
        self.nis = self.adapted_nis
        return status

    content: dict[str, Any] = {"__doc__": emitted.__doc__, "_fuse": fuse}
    content |= {"rule": rule, "window": window, "forgetting": forgetting}
    return type(f"Adapted{emitted.__name__}", (emitted, Scaled), content)

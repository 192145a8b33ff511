"""From a continuous filter model to one step of length `dt`.

The exact series of the exponential and of Van Loan's integral (`kfgen.core.linear.taylor`, [1]_) is free of
the cancellation of their closed forms. The blocks of the effects
(Gauss-Markov, random walks, ramps) are carried until nothing is left of them in single
precision at the longest step; the coupling of the motion, whose F changes from step to step
anyway, to the order that is asked for.

References
----------
.. [1] C. F. Van Loan, 1978; differentiate eq. (1.4) at dt = 0.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import sympy as sp

from kfgen.core.errors import InputError
from kfgen.core.linear import taylor
from kfgen.core.numbers import is_sampling_rate
from kfgen.model.biases import name_walks
from kfgen.model.filter import FilterModel
from kfgen.model.noise_driven import Named, name_inputs
from kfgen.model.parts.sensors import Sensor
from kfgen.model.register import DT, Register
from kfgen.model.symbols.blocks import Attitude
from kfgen.model.symbols.rotation import hamilton, small_quaternion

EXHAUSTED = 2.0**-27
"""Relative remainder at which a series of an effect ends: below single precision."""
LONGEST_SERIES = 24
ROUNDED = 2.0**-24
"""Relative error of a number in single precision."""


def series(F: sp.Matrix, Q: sp.Matrix, order: int) -> tuple[sp.Matrix, sp.Matrix]:
    """``Phi`` and ``Qd`` to `order` in `DT`, shape (n, n), for dynamics F and noise density Q."""
    return taylor(sp.eye(F.rows), F, Q, DT, order)


NEGLIGIBLE = 2.0**-40
"""Share of the largest term of a series below which a term says nothing, even in double precision of a sum."""
LONGEST_STEP = 0.1
"""Of a filter, where nothing else is asked for [s]."""


def series_order(fastest: float, max_step: float) -> int:
    """Terms after which a series of rate `fastest` [1/s] is exhausted at `max_step` [s].

    Raises
    ------
    InputError
        The step is long against the shortest time constant.
    """
    x, term = 2.0 * fastest * max_step, 1.0
    for k in range(1, LONGEST_SERIES + 1):
        term *= x / k
        if term < EXHAUSTED:
            return max(k, 2)
    raise InputError(
        f"a step of {max_step:g} s is too long for a time constant of {1 / fastest:.3g} s",
        remedy="Give a shorter --max-step",
    )


@dataclass(frozen=True)
class DiscreteModel:
    """One step of a filter.

    Parameters
    ----------
    model : FilterModel
    order : int
        Order in `dt` of the motion's coupling, 1 to 3.
    max_step : float
        The longest step [s] for which the effects' series are exhausted.
    rate : float
        Sampling rate [Hz] of the inputs, and of the sensors that have none of their own.
    rates : mapping of str to float
        Of sensors by name [Hz], where theirs is another: white noise that is a density has its variance from it.
    """

    model: FilterModel
    order: int = 1
    max_step: float = 0.1
    rate: float = 100.0
    rates: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not is_sampling_rate(self.rate):
            raise InputError(
                f"--rate must be positive (got {self.rate:g})", remedy="Give the sampling rate in hertz"
            )
        if not 0.0 < self.max_step < math.inf:
            raise InputError(
                f"a step of {self.max_step:g} s is none",
                remedy="Give --max-step a positive number of seconds",
            )
        if self.order not in (1, 2, 3):
            raise InputError(f"an order of {self.order} is not offered", remedy="Give 1, 2 or 3")

    @staticmethod
    def at_rate(
        model: FilterModel,
        rate: float,
        order: int = 1,
        max_step: float | None = None,
        rates: Mapping[str, float] | None = None,
    ) -> DiscreteModel:
        """With the longest step that the fastest of the effects allows, a tenth of a second at most.

        Parameters
        ----------
        max_step : float, optional
            The longest step [s], where it is given.
        rates : mapping of str to float, optional
            Of sensors by name [Hz], where theirs is another.
        """
        if max_step is None:
            A, _ = model.effect_dynamics
            poles = np.abs(np.linalg.eigvals(np.array(A, dtype=np.float64))) if A.rows else np.zeros(0)
            fastest = max(float(poles.max(initial=0.0)), 1e-300)
            max_step = min(LONGEST_STEP, max(1.0 / fastest, 1.05 / rate if rate > 0.0 else 0.0))
        return DiscreteModel(model, order, max_step, rate, rates or {})

    @property
    def named_noise(self) -> tuple[sp.Matrix, Named]:
        """Process noise of a step with a symbol for the density of each input [SI^2/Hz], as `name_inputs` says."""
        _, Qd, named, _ = self._matrices
        return Qd, named

    @property
    def named_walks(self) -> Named:
        """Symbols in `named_noise` for the densities of the biases' random walks [SI^2/s], as `name_walks` says."""
        return self._matrices[3]

    @cached_property
    def _matrices(self) -> tuple[sp.Matrix, sp.Matrix, Named, Named]:
        """Transition, `named_noise` and the symbols in it: what emission needs, and the dearest of it only once."""
        W = self.model.W.copy()
        inputs, walks = name_inputs(self.model, W), name_walks(self.model, W)
        return *self._discretised(W), inputs, walks

    def _discretised(self, W: sp.Matrix) -> tuple[sp.Matrix, sp.Matrix]:
        """Transition and process noise of a step, for densities W of the model's noises."""
        model = self.model
        Phi, Qd = self._of_motion(W)
        self._put_noise_driven(Phi, Qd, W)
        if self.order == 1:
            Phi = Phi.applyfunc(lambda e: self._forces_halfway.get(e, e))
        if self._acting:
            Phi, Qd = Phi.xreplace(self._acting), Qd.xreplace(self._acting)
        A, _ = model.effect_dynamics
        if A.rows:
            driving = W[W.rows - A.rows :, W.cols - A.rows :]
            fastest = float(np.abs(np.linalg.eigvals(np.array(A, dtype=np.float64))).max())
            if self.order > 1 and fastest * self.max_step > 0.5:
                raise InputError(
                    f"order {self.order} needs steps under half of the shortest time constant, {1 / fastest:.3g} s",
                    remedy="Give --order 1, or a shorter --max-step",
                )
            Phi_e, Qd_e = series(A, driving, series_order(fastest, self.max_step) + 1)
            first = Phi.rows - A.rows
            Phi[first:, first:] = Phi_e.applyfunc(self._series)
            Qd[first:, first:] = Qd_e.applyfunc(self._series)
        return Phi, Qd if not Qd.is_zero_matrix or model.F.is_zero_matrix else self._rounding()

    def _of_motion(self, W: sp.Matrix) -> tuple[sp.Matrix, sp.Matrix]:
        """The same of the motion, to the order in `DT` that was asked for."""
        F, G = self.model.F, self.model.G
        density = G * W * G.T
        Phi, Qd = series(F, density, self.order)
        if self.order == 2:
            # The series cut at dt^2 is not positive: the trapezoid of the integral is, to the same order.
            E = sp.eye(F.rows) + F * DT
            Qd = (density + E * density * E.T) * DT / 2
        return Phi, Qd

    def _rounding(self) -> sp.Matrix:
        """Process noise of a motion that has none: a stored state is rounded, and P must not fade to nothing."""
        return sp.diag(*(sp.Float((ROUNDED * s.prior) ** 2) for s in self.model.states))

    @cached_property
    def _noise_driven(self) -> tuple[tuple[int, ...], sp.Matrix, sp.Matrix]:
        """Places of what noise alone moves, its transition and its process noise, exhausted like an effect's."""
        blocks, A, W = self.model.noise_driven_blocks
        if not blocks:
            return (), A, W
        names = [s.name for s in self.model.states]
        fastest = float(np.abs(np.linalg.eigvals(np.array(A, dtype=np.float64))).max())
        Phi, Qd = series(A, W, series_order(fastest, self.max_step) + 1)
        places = tuple(names.index(n) for b in blocks for n in b.error_names)
        return places, Phi.applyfunc(self._series), Qd.applyfunc(self._series)

    def _put_noise_driven(self, Phi: sp.Matrix, Qd: sp.Matrix, W: sp.Matrix) -> None:
        """Put that into the matrices of the whole, beside the noise that turns the error of such states."""
        places, Phi_w, Qd_w = self._noise_driven
        if not places:
            return
        names = {f"w_{self.model.states[k].name}" for k in places}
        others = sp.diag(*(0 if str(s) in names else 1 for s in self.model.noise_symbols))
        turned = self._of_motion(others * W * others)[1]
        for i, k in enumerate(places):
            for j, l in enumerate(places):
                Phi[k, l], Qd[k, l] = Phi_w[i, j], Qd_w[i, j] + turned[k, l]

    def _series(self, expression: sp.Expr) -> sp.Expr:
        """A series in the step without the terms that a slow effect has exhausted, as nested products."""
        if not expression.has(DT) or expression.free_symbols != {DT}:
            return _nested(expression)
        terms = sp.Poly(expression, DT).terms()
        sizes = [abs(float(c)) * self.max_step ** int(k[0]) for k, c in terms]
        kept = [(k, c) for (k, c), size in zip(terms, sizes) if size > NEGLIGIBLE * max(sizes)]
        return _nested(sum((c * DT ** int(k[0]) for k, c in kept), sp.Integer(0)))

    @cached_property
    def _acting(self) -> dict[sp.Symbol, sp.Expr]:
        """What acts over a step in place of the sample of an input that is late."""
        return {sp.Symbol(line.channel, real=True): line.acting(self.rate) for line in self.model.motion.late}

    @cached_property
    def memories(self) -> tuple[Register, ...]:
        """What is kept beside the state: samples of late inputs, where the backlash of channels stands."""
        model = self.model
        lines = [m for line in model.motion.late for m in line.memories(self.rate)]
        return (
            *lines,
            *model.registers,
            *(s.backlash.memory(model.clean(s)[0]) for s in model.sensors if s.backlash),
        )

    def expected(self, sensor: Sensor) -> sp.Matrix:
        """The expected measurement, backlashes and the effects of its channels in it, shape (m, 1)."""
        z = self.model.expected(sensor)
        if sensor.backlash is None:
            return z
        h = self.model.clean(sensor)
        return z - h + sp.Matrix([sensor.backlash.shown(h[0])])

    def H(self, sensor: Sensor) -> sp.Matrix:
        """The measurement's Jacobian, shape (m, n); within a backlash no state shows."""
        H = self.model.H(sensor)
        if sensor.backlash is not None:
            follows = sensor.backlash.follows(self.model.clean(sensor)[0])
            for j in range(sum(len(b.error_names) for b in self.model.blocks)):
                H[0, j] *= follows
        return H

    @property
    def Phi(self) -> sp.Matrix:
        """Transition of the error, shape (n, n)."""
        return self._matrices[0]

    @cached_property
    def Qd(self) -> sp.Matrix:
        """Process noise covariance of a step, shape (n, n)."""
        _, Qd, named, walks = self._matrices
        return self._discretised(self.model.W)[1] if named or walks else Qd

    @cached_property
    def hash(self) -> str:
        """SHA-256 over the model and the options of its step (hexadecimal)."""
        rates = "".join(f" {n} {r!r}" for n, r in sorted(self.rates.items()) if r != self.rate)
        options = f"{self.order} {self.max_step!r} {self.rate!r}{rates}"
        return hashlib.sha256(f"{self.model.hash} {options}".encode()).hexdigest()

    @cached_property
    def step(self) -> tuple[sp.Expr, ...]:
        """The stored state after a step, in the order of `nominal_names`; quaternions not normalised.

        Vectors to second order in `dt`, attitudes by the quaternion of the step's rotation vector, effects and what
        noise alone moves by their own transition. A vector of the body that moves another one (a specific force) acts
        in the axes of the middle of the step: ``v + dt R (u + dt/2 omega x u)``, the second-order term of the attitude.
        """
        rates = self.model.rates(False)
        vectors = {
            s: self._halfway(r, rates)
            for b in self.model.blocks
            if not isinstance(b, Attitude)
            for s, r in zip(b.nominal, rates[b.name])
        }
        out: list[sp.Expr] = []
        driven = self.model.noise_driven_blocks[0]
        x = sp.Matrix([s for b in driven for s in b.nominal])
        ahead = dict(zip(x, self._noise_driven[1] * x)) if driven else {}
        for b in self.model.blocks:
            if isinstance(b, Attitude):
                out.extend(hamilton(b.quaternion, small_quaternion(rates[b.name] * DT)))
                continue
            if b in driven:
                out.extend(ahead[s] for s in b.nominal)
                continue
            for s, r in zip(b.nominal, rates[b.name]):
                second = sum((_slope(r, other) * rate for other, rate in vectors.items()), sp.Integer(0))
                out.append(s + vectors[s] * DT + second * DT**2 / 2)
        first = len(self.model.states) - self.model.effect_dynamics[0].rows
        effects = sp.Matrix([s.symbol for s in self.model.states[first:]])
        kept = [m.after for m in self.memories]
        moved = [e.xreplace(self._acting) for e in out] if self._acting else out
        return (*moved, *(self.Phi[first:, first:] * effects if effects.rows else ()), *kept)

    @cached_property
    def _forces_halfway(self) -> dict[sp.Expr, sp.Expr]:
        """What a vector of the body does over a step, as F has it: the same with the attitude of the middle of the step.

        Where the transition has it as well, it is computed once, and is the mean of the step there too.
        """
        attitude = self.model.attitude
        if attitude is None:
            return {}
        rates, away = self.model.rates(False), dict.fromkeys(attitude.nominal, sp.Integer(0))
        vectors = [r for b in self.model.blocks if not isinstance(b, Attitude) for r in rates[b.name]]
        forces = [r - r.xreplace(away) for r in vectors]
        return {
            DT * sp.expand(sign * f): sign * DT * self._halfway(f, rates)
            for f in forces
            if f != 0
            for sign in (1, -1)
        }

    def _halfway(self, rate: sp.Expr, rates: Mapping[str, sp.Matrix]) -> sp.Expr:
        """A rate with the attitude turned by half a step: ``R' = R [omega x]`` times ``dt / 2`` in place of R.

        What multiplies a row of R is a vector u of the body: it becomes ``u + dt/2 omega x u``.
        """
        attitude = self.model.attitude
        if attitude is None or not rate.free_symbols & set(attitude.nominal):
            return rate
        omega, out = rates[attitude.name], rate
        for i in range(3):
            row = attitude.nominal.row(i)
            u = sp.Matrix([_slope(rate, r) for r in row])
            for r, old, turned in zip(row, u, omega.cross(u)):
                out += (old + turned * DT / 2) * r - old * r
        return out

    @property
    def nominal_names(self) -> tuple[str, ...]:
        """Names of the stored state, in order."""
        first = len(self.model.states) - self.model.effect_dynamics[0].rows
        blocks = tuple(n for b in self.model.blocks for n in b.nominal_names)
        effects = tuple(s.name for s in self.model.states[first:])
        return blocks + effects + tuple(m.name for m in self.memories)

    @property
    def start(self) -> tuple[float, ...]:
        """The stored state before alignment."""
        declared = [(n, v) for b in self.model.blocks for n, v in zip(b.nominal_names, b.start)]
        blocks = tuple(self.model.initial[n].value if n in self.model.initial else v for n, v in declared)
        first = sum(len(b.error_names) for b in self.model.blocks)
        effects = tuple(s.start for s in self.model.states[first:])
        return blocks + effects + tuple(0.0 for _ in self.memories)

    def sample_variance(self, sensor: Sensor, channel: str) -> float:
        """Variance of the white noise of one sample [SI^2]: the channel's own, else the sensor's.

        Quantisation of the integral counts by the variance of its differences.
        """
        white, steps = self.model.white(channel)
        rate = self.rate_of(sensor)
        own = float(white) * rate + 2.0 * float(steps) * rate**2
        factor, extra = self.model.noise_change(channel)
        usual = 0.0 if self.model.is_sampled(channel) else float(factor) * sensor.sd**2
        return (own if own > 0.0 else usual) + float(extra)

    def measurement_variance(self, sensor: Sensor, channel: str) -> float:
        """``R`` of one sample [SI^2]: its white noise and what the model leaves out."""
        return self.sample_variance(sensor, channel) + sensor.left_out**2 * self.rate_of(sensor)

    def rate_of(self, sensor: Sensor) -> float:
        """How often a sensor has a sample [Hz]."""
        return self.rates.get(sensor.name, self.rate)


def _slope(e: sp.Expr, x: sp.Symbol) -> sp.Expr:
    """A derivative; jumps of a sign have none."""
    return e.diff(x).replace(sp.DiracDelta, lambda *_: sp.Integer(0))


def _nested(expression: sp.Expr) -> sp.Expr:
    return sp.horner(expression, wrt=DT) if expression.has(DT) else expression

"""State blocks: each knows its nominal symbols, its error and how the one corrects the other."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import sympy as sp

from kfgen.model.symbols.convention import Convention, Phi
from kfgen.model.symbols.rotation import atoms


@dataclass(frozen=True)
class Vector:
    """A vector state with an additive error.

    Parameters
    ----------
    name : str
        Paper letter; components are ``name_axis``.
    axes : tuple of str
    unit : str
        SI.
    title : str
        In words.
    prior : float
        Standard deviation of the error before the first measurement [SI].
    initial : tuple of float
        The stored components before it [SI]; zeros where left out.
    driven : float
        Root density of the white noise that drives each component's rate [SI/sqrt(s)]; zero for none.
    priors : tuple of float
        Standard deviations by component, where they are not all `prior` [SI].
    """

    name: str
    axes: tuple[str, ...]
    unit: str
    title: str
    prior: float
    initial: tuple[float, ...] = ()
    driven: float = 0.0
    priors: tuple[float, ...] = ()

    @property
    def deviations(self) -> tuple[float, ...]:
        """Standard deviation of each component before the first measurement [SI]."""
        return self.priors or (self.prior,) * len(self.axes)

    @cached_property
    def nominal(self) -> sp.Matrix:
        """Nominal symbols, shape (k, 1)."""
        return sp.Matrix([sp.Symbol(n, real=True) for n in self.error_names])

    @cached_property
    def error(self) -> sp.Matrix:
        """Error symbols, shape (k, 1)."""
        return sp.Matrix([sp.Symbol(f"d_{n}", real=True) for n in self.error_names])

    @property
    def error_names(self) -> tuple[str, ...]:
        """Names of the error components."""
        return tuple(f"{self.name}_{a}" if a else self.name for a in self.axes)

    @property
    def nominal_names(self) -> tuple[str, ...]:
        """Names of the stored components."""
        return self.error_names

    @property
    def start(self) -> tuple[float, ...]:
        """The stored components before alignment."""
        return self.initial or (0.0,) * len(self.axes)

    @property
    def value(self) -> sp.Matrix:
        """What a motion or a sensor sees of the estimate."""
        return self.nominal


@dataclass(frozen=True)
class Attitude:
    """A rotation body to navigation frame, stored as a quaternion; its error as a convention says.

    The default, a global error, keeps the transition matrix of an inertial filter triangular.

    Parameters
    ----------
    convention : type of Convention
    frame : tuple of str
        Navigation axes.
    """

    name: str = "phi"
    title: str = "attitude"
    unit: str = "rad"
    prior: float = 0.1
    convention: type[Convention] = Phi
    frame: tuple[str, ...] = ("N", "E", "D")

    @property
    def deviations(self) -> tuple[float, ...]:
        """Standard deviation of each component before the first measurement [rad]."""
        return (self.prior,) * 3

    @property
    def axes(self) -> tuple[str, ...]:
        """Axes of the error."""
        return ("x", "y", "z") if self.convention.side.body else self.frame

    @cached_property
    def quaternion(self) -> sp.Matrix:
        """Stored symbols, shape (4, 1)."""
        return sp.Matrix([sp.Symbol(n, real=True) for n in self.nominal_names])

    @cached_property
    def nominal(self) -> sp.Matrix:
        """The rotation matrix in atoms, shape (3, 3)."""
        return atoms("R_nb")

    @cached_property
    def error(self) -> sp.Matrix:
        """Error symbols, shape (3, 1)."""
        return sp.Matrix([sp.Symbol(f"d_{n}", real=True) for n in self.error_names])

    @property
    def error_names(self) -> tuple[str, ...]:
        """Names of the error components."""
        return tuple(f"{self.convention.letter}_{a}" for a in self.axes)

    @property
    def nominal_names(self) -> tuple[str, ...]:
        """Names of the stored components."""
        return ("q_w", "q_x", "q_y", "q_z")

    @property
    def start(self) -> tuple[float, ...]:
        """The identity."""
        return (1.0, 0.0, 0.0, 0.0)

    @property
    def value(self) -> sp.Matrix:
        """``R_nb`` of the estimate."""
        return self.nominal


Block = Vector | Attitude

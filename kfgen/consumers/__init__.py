"""Noise parameters in other programs' conventions: one module for each program, found by its ``NAME``.

To add one, add a module to the folder of its kind (``estimators``, ``autopilots``, ``simulators``) with

- ``NAME`` and ``TITLE``,
- ``SOURCE``: where its convention was read, and how far that is verified,
- ``RATE``: which rate its numbers depend on, in words; empty when on none,
- ``NEEDS``: the sensors (``gyro``, ``accel``) that its file cannot do without; where there are any, every key of its
  file is needed, and one that was not identified is an error of the conversion,
- ``convert(imu) -> Converted``; see `kfgen.consumers.base`.
"""

from __future__ import annotations

import hashlib
import importlib
import pkgutil
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from types import ModuleType

from kfgen.consumers.autopilots.settable_values import SettableValues
from kfgen.consumers.base import IMU_RATE, SENSORS, Converted, Imu, Value
from kfgen.consumers.conversion import Conversion
from kfgen.core.errors import InputError
from kfgen.core.numbers import is_sampling_rate
from kfgen.core.optional_library import modules_of_others
from kfgen.core.units import parse_quantity
from kfgen.effects.noise_model import NoiseModel, read_noise
from kfgen.model.filter_file import FilterFile, is_filter_file, read_filter

__all__ = ["Conversion", "Converted", "Imu", "Value", "consumers", "convert"]

MAX_SAFETY = 1e6
"""Factor on every size; its inverse is the least."""


@cache
def consumers() -> dict[str, ModuleType]:
    """The consumers by name, from every module of this package or of another that declares one."""
    inner = pkgutil.walk_packages(__path__, f"{__name__}.")
    own = (importlib.import_module(info.name) for info in inner if not info.ispkg)
    modules = (*own, *modules_of_others("consumers"))
    return {m.NAME: m for m in sorted(modules, key=lambda m: getattr(m, "NAME", "")) if hasattr(m, "NAME")}


def convert(
    noise: NoiseModel | FilterFile | str | Path,
    to: str,
    *,
    rate: float | None = None,
    safety: float = 1.0,
    origin: str = "",
) -> Conversion:
    """The parameters of a noise model in a consumer's own convention.

    Parameters
    ----------
    noise : NoiseModel, FilterFile or path-like
        The effects of the channels; or a filter, of which autopilots take delays, arms and offsets too.
    to : str
        The consumer's name, see `kfgen.list_all`.
    rate : float, optional
        The rate [Hz] that the consumer's numbers depend on; where it is that of the IMU, the rate at which the noise
        was identified is taken where none is given.
    safety : float
        Multiplies every size (its square every covariance).
    origin : str
        The noise file as the text names it; the file's own name where a path is given.

    Returns
    -------
    Conversion

    Raises
    ------
    InputError
        An unknown consumer, a rate or a sensor that it needs and that is not given, or a channel called
        after a sensor whose unit is none of it.
    """
    given = _Given.of(noise, origin)
    rate, assumed = _rate(given, to, rate)
    module = _consumer(to, rate, safety, given.is_inertial)
    imu = Imu(given.noise, rate, safety, given.origin)
    _check_needs(module, imu)
    settable = given.findings is not None and hasattr(module, "SETTINGS")
    made: Converted = module.convert(imu, given.findings) if settable else module.convert(imu)
    said = [*(f"{name}: {v.words}" for name, v in made.values.items() if not v.numbers), *assumed]
    missing = tuple(name for name, v in made.values.items() if module.NEEDS and not v.numbers)
    if missing:
        said.append(f"{module.TITLE} is not complete: it cannot do without {', '.join(missing)}")
    unheld = given.findings.sources if given.findings is not None and not settable else ()
    said += [*made.warnings, *(f"no parameter of {module.TITLE} holds {words}" for words in unheld)]
    how = (module.TITLE, module.SOURCE, rate, safety, given.source, given.sha256, missing)
    return Conversion(made.text, made.values, tuple(said), given.noise, to, *how)


@dataclass(frozen=True)
class _Given:
    """What is converted: a noise model, and what a filter file says beside it; `origin` is its name in the text."""

    noise: NoiseModel
    findings: SettableValues | None = None
    source: str = ""
    sha256: str = ""
    origin: str = ""

    @staticmethod
    def of(noise: NoiseModel | FilterFile | str | Path, origin: str) -> _Given:
        """Of a model, a filter, or the path of its file."""
        if isinstance(noise, str | Path):
            path = Path(noise)
            content = read_filter(path) if is_filter_file(path) else read_noise(path)
            sha256 = hashlib.sha256(path.read_bytes()).hexdigest()
            source = str(noise).encode("utf-8", "replace").decode()
            return replace(_Given.of(content, origin or path.name), source=source, sha256=sha256)
        if isinstance(noise, NoiseModel):
            return _Given(noise, origin=origin)
        return _Given(noise.noise or NoiseModel({}), SettableValues.of(noise), origin=origin)

    @property
    def is_inertial(self) -> bool:
        """Whether there is noise of inertial sensors to be converted; always of a noise file."""
        return self.findings is None or any(name.startswith(tuple(SENSORS)) for name in self.noise.channels)


def _check_needs(module: ModuleType, imu: Imu) -> None:
    """Raise `InputError` where the consumer cannot do without a sensor that is not there."""
    for sensor in module.NEEDS:
        if not imu.readings(sensor):
            names = ", ".join(f"{sensor}_{axis}" for axis in "xyz")
            raise InputError(
                f"the noise file has no {SENSORS[sensor][0]} channel, and {module.TITLE} cannot do without",
                where=imu.origin,
                remedy=f"Add {names} to the noise file, or take --to table",
            )


def _rate(given: _Given, to: str, rate: float | None) -> tuple[float | None, list[str]]:
    """The rate [Hz]: as given, that of the identification, or for a filter that of most autopilots; what is to be said."""
    rate = rate if rate is not None else _own_rate(given.noise, to)
    usual: float | None = getattr(consumers().get(to), "USUAL_RATE_HZ", None)
    if rate is not None or usual is None or given.findings is None or not given.is_inertial:
        return rate, []
    return usual, [f"{usual:g} Hz are assumed, the usual rate of the filter's steps; --rate says another"]


def _own_rate(noise: NoiseModel, to: str) -> float | None:
    """The rate [Hz] at which a noise model was identified, where the consumer wants that of the IMU."""
    module, stated = consumers().get(to), noise.provenance.get("rate", "")
    if module is None or not stated or not module.RATE.startswith(IMU_RATE):
        return None
    rate = parse_quantity(stated, "Hz", where="[provenance] rate")
    return rate if is_sampling_rate(rate) else None


def _consumer(to: str, rate: float | None, safety: float, at_rest: bool) -> ModuleType:
    """The consumer of that name, once the rate [Hz] and the safety factor serve it; `at_rest`: there is noise of the IMU."""
    known = consumers()
    if to not in known:
        raise InputError(
            f"there is no consumer '{to}'", where="--to", remedy=f"Known are {', '.join(sorted(known))}"
        )
    module = known[to]
    if rate is not None and not is_sampling_rate(rate):
        raise InputError(
            f"a rate of {rate:g} Hz is none of a sensor", where="--rate", remedy="Give a positive number"
        )
    if not 1.0 / MAX_SAFETY <= safety <= MAX_SAFETY:
        raise InputError(
            f"a safety factor of {safety:g} is none",
            where="--safety",
            remedy=f"Give a positive number up to {MAX_SAFETY:g}",
        )
    if module.RATE and rate is None and at_rest:
        raise InputError(
            f"{to} needs a rate: {module.RATE}", where="--rate", remedy="Give it in hertz, say --rate 100"
        )
    return module

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
from functools import cache
from pathlib import Path
from types import ModuleType

from kfgen.consumers.base import IMU_RATE, SENSORS, Converted, Imu, Value
from kfgen.consumers.conversion import Conversion
from kfgen.core.errors import InputError
from kfgen.core.numbers import is_sampling_rate
from kfgen.core.units import parse_quantity
from kfgen.effects.noise_model import NoiseModel, read_noise

__all__ = ["Conversion", "Converted", "Imu", "Value", "consumers", "convert"]

MAX_SAFETY = 1e6
"""Factor on every size; its inverse is the least."""


@cache
def consumers() -> dict[str, ModuleType]:
    """The consumers by name, from every module of this package that declares one."""
    inner = pkgutil.walk_packages(__path__, f"{__name__}.")
    modules = [importlib.import_module(info.name) for info in inner if not info.ispkg]
    return {m.NAME: m for m in sorted(modules, key=lambda m: getattr(m, "NAME", "")) if hasattr(m, "NAME")}


def convert(
    noise: NoiseModel | str | Path,
    to: str,
    *,
    rate: float | None = None,
    safety: float = 1.0,
    origin: str = "",
) -> Conversion:
    """The parameters of a noise model in a consumer's own convention.

    Parameters
    ----------
    noise : NoiseModel or path-like
        The effects of the channels.
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
    source = sha256 = ""
    if not isinstance(noise, NoiseModel):
        path = Path(noise)
        noise, source = read_noise(path), str(noise).encode("utf-8", "replace").decode()
        sha256, origin = hashlib.sha256(path.read_bytes()).hexdigest(), origin or path.name
    rate = rate if rate is not None else _own_rate(noise, to)
    module = _consumer(to, rate, safety)
    imu = Imu(noise, rate, safety, origin)
    for sensor in module.NEEDS:
        if not imu.readings(sensor):
            names = ", ".join(f"{sensor}_{axis}" for axis in "xyz")
            raise InputError(
                f"the noise file has no {SENSORS[sensor][0]} channel, and {module.TITLE} cannot do without",
                where=origin,
                remedy=f"Add {names} to the noise file, or take --to table",
            )
    made: Converted = module.convert(imu)
    absent = [f"{name}: {v.words}" for name, v in made.values.items() if not v.numbers]
    missing = tuple(name for name, v in made.values.items() if module.NEEDS and not v.numbers)
    if missing:
        absent.append(f"{module.TITLE} is not complete: it cannot do without {', '.join(missing)}")
    return Conversion(
        made.text,
        made.values,
        (*absent, *made.warnings),
        noise,
        to,
        module.TITLE,
        module.SOURCE,
        rate,
        safety,
        source,
        sha256,
        missing,
    )


def _own_rate(noise: NoiseModel, to: str) -> float | None:
    """The rate [Hz] at which a noise model was identified, where the consumer wants that of the IMU."""
    module, stated = consumers().get(to), noise.provenance.get("rate", "")
    if module is None or not stated or not module.RATE.startswith(IMU_RATE):
        return None
    rate = parse_quantity(stated, "Hz", where="[provenance] rate")
    return rate if is_sampling_rate(rate) else None


def _consumer(to: str, rate: float | None, safety: float) -> ModuleType:
    """The consumer of that name, once the rate [Hz] and the safety factor serve it."""
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
    if module.RATE and rate is None:
        raise InputError(
            f"{to} needs a rate: {module.RATE}", where="--rate", remedy="Give it in hertz, say --rate 100"
        )
    return module

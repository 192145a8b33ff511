"""Noise parameters in other programs' conventions: one module for each program, found by its ``NAME``.

To add one, add a module here with

- ``NAME`` and ``TITLE``,
- ``SOURCE``: where its convention was read, and how far that is verified,
- ``RATE``: which rate its numbers depend on, in words; empty when on none,
- ``NEEDS``: the sensors (``gyro``, ``accel``) that its file cannot do without,
- ``convert(imu) -> Converted``; see `kfgen.consumers.base`.
"""

from __future__ import annotations

import hashlib
import importlib
import pkgutil
from functools import cache
from pathlib import Path
from types import ModuleType

from kfgen.consumers.base import SENSORS, Converted, Imu, Value
from kfgen.consumers.conversion import Conversion
from kfgen.core.errors import InputError
from kfgen.core.numbers import is_sampling_rate
from kfgen.effects.noise_model import NoiseModel, read_noise

__all__ = ["Conversion", "Converted", "Imu", "Value", "consumers", "convert"]

MAX_SAFETY = 1e6
"""Factor on every size; its inverse is the least."""


@cache
def consumers() -> dict[str, ModuleType]:
    """The consumers by name, from every module of this package that declares one."""
    found: dict[str, ModuleType] = {}
    for info in pkgutil.iter_modules(__path__):
        module = importlib.import_module(f"{__name__}.{info.name}")
        if hasattr(module, "NAME"):
            found[module.NAME] = module
    return found


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
        The rate [Hz] that the consumer's numbers depend on.
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
    )


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

"""The verb `build`: a filter model from a name or a file, with its noise and its options."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from kfgen.core.errors import InputError
from kfgen.effects.noise_model import NoiseModel, read_noise
from kfgen.model import library
from kfgen.model.filter import FilterModel
from kfgen.model.filter_file import FilterFile, is_filter_file, read_filter

ModelSource = FilterModel | str | Path
"""A filter model, the name of a library model, or the path of a filter file or a model file."""
NoiseSource = NoiseModel | str | Path
"""A noise model, or the path of its file."""


def build(
    model: str | Path,
    noise: NoiseSource | None = None,
    options: Mapping[str, str] | None = None,
    sensors: Sequence[str] | None = None,
) -> FilterModel:
    """A filter model.

    Parameters
    ----------
    model : str or Path
        The name of a library model (see `kfgen.list_all`), or the path of a filter file or a model file (``.toml``).
    noise : NoiseModel or path-like, optional
        The effects of the channels; typical MEMS figures where left out.
    options : mapping of str to str, optional
        Choices of the library model as ``--set`` takes them, ``{"frame": "ecef"}`` for example.
    sensors : sequence of str, optional
        Names of the aiding sensors; the model's own where left out.

    Returns
    -------
    FilterModel

    Raises
    ------
    InputError
        No such model, option or sensor, a file that cannot be read, or a channel of another dimension.
    """
    chosen = dict(options or {})
    if sensors:
        if "sensors" in chosen:
            raise InputError(
                "the sensors are given twice", where="--sensor", remedy="Give --sensor or --set sensors"
            )
        chosen["sensors"] = ",".join(sensors)
    read = noise_of(noise)
    built = library.build(str(model), read, chosen)
    return replace(built, given=_filter_file(model, read, built) if is_filter_file(model) else read)


def _filter_file(path: str | Path, noise: NoiseModel | None, built: FilterModel) -> FilterFile:
    """A filter file with the noise and the options that were given beside it."""
    options = dict(built.options)
    sensors = tuple(n for n in options.pop("sensors", "").split(",") if n)
    return replace(read_filter(path).with_noise(noise), options=options, sensors=sensors)


def noise_of(noise: NoiseSource | None) -> NoiseModel | None:
    """The noise model, read where a path is given; None where nothing is."""
    return read_noise(noise) if isinstance(noise, str | Path) else noise


def filter_of(model: ModelSource, noise: NoiseSource | None = None) -> FilterModel:
    """The filter model of what a verb was given.

    Parameters
    ----------
    model : FilterModel, str or Path
        As it is, or as `build` takes it.
    noise : NoiseModel or path-like, optional
        As `build` takes it; only beside a name or a path.

    Raises
    ------
    InputError
        As in `build`, or a noise beside a model that has its own.
    """
    if not isinstance(model, FilterModel):
        return build(model, noise)
    if noise is not None:
        raise InputError(
            f"the filter {model.name} was built with its noise",
            remedy="Give the noise to kfgen.build, or the name of the model beside the noise",
        )
    return model

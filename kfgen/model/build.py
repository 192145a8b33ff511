"""The verb `build`: a filter model from a name or a file, with its noise and its options."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from kfgen.core.channel_names import acts_on
from kfgen.core.errors import InputError
from kfgen.effects.noise_model import SAMPLED, WHITE, NoiseModel, read_noise
from kfgen.model import library
from kfgen.model.filter import FilterModel
from kfgen.model.filter_file import FilterFile, is_filter_file, read_filter

ModelSource = FilterModel | str | Path
"""A filter model, the name of a library model, or the path of a filter file or a model file."""
NoiseSource = NoiseModel | str | Path
"""A noise model, or the path of its file."""


def build(
    model: FilterFile | str | Path,
    noise: NoiseSource | None = None,
    options: Mapping[str, str] | None = None,
    sensors: Sequence[str] | None = None,
) -> FilterModel:
    """A filter model.

    Parameters
    ----------
    model : FilterFile, str or Path
        A filter file, or its path, or that of a model file (``.toml``), or the name of a library model (see
        `kfgen.list_all`).
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
    if not isinstance(model, FilterFile) and is_filter_file(model):
        model = read_filter(model)
    if not isinstance(model, FilterFile):
        return replace(library.build(str(model), read, chosen), given=read)
    built = library.build_filter(model.with_noise(read), chosen)
    return replace(built, given=_chosen(model.with_noise(read), built))


def _chosen(file: FilterFile, built: FilterModel) -> FilterFile:
    """A filter file with the options that were chosen."""
    options = dict(built.options)
    sensors = tuple(n for n in options.pop("sensors", "").split(",") if n)
    return replace(file, options=options, sensors=sensors)


def filter_file(model: FilterModel, noise: NoiseModel) -> FilterFile:
    """A filter as a file, with another noise model.

    Parameters
    ----------
    model : FilterModel
        A library model, or one of a filter file.
    noise : NoiseModel
    """
    if isinstance(model.given, FilterFile):
        return model.given.with_noise(noise)
    return _chosen(FilterFile(model.name, model.name, noise=noise), model)


def said_of_noise(model: FilterModel) -> tuple[str, ...]:
    """What a filter takes for granted because the noise that it was given does not say it, in words."""
    noise = model.given.noise if isinstance(model.given, FilterFile) else model.given
    if noise is None:
        return ()
    known = {
        place
        for place, channel in noise.channels.items()
        if any(t.effect.name in (WHITE, SAMPLED) for t in channel.terms)
    }

    def lacks(channels: Sequence[str]) -> list[str]:
        return [c for c in channels if not any(acts_on(place, c) for place in known)]

    inputs = lacks([c for i in model.motion.inputs for c in i.channels])
    own = [(s.name, s.channels, lacks(s.channels)) for s in model.sensors]
    sensors = [n for name, every, some in own for n in ([name] if len(some) == len(every) else some)]
    said = []
    if inputs:
        said.append(
            f"the noise has no white noise of {', '.join(inputs)}: the model's typical figures are used"
        )
    if sensors:
        said.append(
            f"the noise has no white noise of {', '.join(sensors)}: the model's own standard "
            "deviations are used; derive shows them"
        )
    return tuple(said)


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

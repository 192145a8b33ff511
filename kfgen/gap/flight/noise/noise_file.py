"""The sizes of noises in the words of a filter file: white noise of each channel, of the size that a flight asks for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from kfgen.core.channel_names import acts_on
from kfgen.effects import make
from kfgen.effects.noise_model import SAMPLED, WHITE, ChannelNoise, NoiseModel, Term
from kfgen.gap.core.result import NoiseScale
from kfgen.gap.scene.noise_scale import scaled
from kfgen.log.log import Log
from kfgen.model.filter import FilterModel
from kfgen.model.filter_file import FilterFile


def assumed_noise(model: NoiseModel | FilterModel, log: Log) -> NoiseModel:
    """The noise that is assumed about the channels of a log.

    Parameters
    ----------
    model : NoiseModel or FilterModel
    log : Log
        Whose units a channel has that it holds.
    """
    if isinstance(model, NoiseModel):
        return model
    units = {c: log.channels[c].unit if c in log.channels else u for c, u in model.channel_units.items()}
    terms = {c: tuple(Term(e) for e in model.noise[c] if e.name != "bias") for c in units if c in model.noise}
    return NoiseModel({c: ChannelNoise(units[c], t) for c, t in terms.items()})


def as_given(model: FilterModel, noise: NoiseModel) -> NoiseModel:
    """The noise of a filter's channels; of channels and whole sensors that its file describes, as it describes them.

    Parameters
    ----------
    model : FilterModel
    noise : NoiseModel
        Of its channels one by one.
    """
    given = model.given.noise if isinstance(model.given, FilterFile) else model.given
    own = dict(given.channels) if given is not None else {}
    others = {c: n for c, n in noise.channels.items() if n.terms and not any(acts_on(o, c) for o in own)}
    return NoiseModel(own | others)


def with_sizes(noise: NoiseModel, model: FilterModel, scales: Sequence[NoiseScale]) -> NoiseModel:
    """A noise model whose white noise has other sizes.

    Parameters
    ----------
    noise : NoiseModel
        Of a filter's channels or sensors; a sensor that it does not describe has the noise that the filter assumes.
    model : FilterModel
    scales : sequence of NoiseScale
        Those of white noise; others are left out.
    """
    times = {c: s.times for s in scales if s.white for c in model.channel_units if acts_on(s.channel, c)}
    channels = _by_channel(dict(noise.channels), model, times)
    for c, factor in times.items():
        old = channels.get(c, ChannelNoise(model.channel_units[c], ()))
        if not any(_is_white(t) for t in old.terms):
            usual = next((s.sd for s in model.sensors if c in s.channels), 0.0)
            old = replace(old, terms=(Term(make(SAMPLED, sd=usual)), *old.terms))
        terms = tuple(Term(scaled(t.effect, factor)) if _is_white(t) else t for t in old.terms)
        channels[c] = replace(old, terms=terms, covariance=None)
    return replace(noise, channels=channels)


def _by_channel(
    channels: dict[str, ChannelNoise], model: FilterModel, times: Mapping[str, float]
) -> dict[str, ChannelNoise]:
    """White noise that a file gives for a whole sensor, given for each of its channels where one of them changes."""
    for name, entry in list(channels.items()):
        parts = [c for c in model.channel_units if c != name and acts_on(name, c)]
        white = tuple(t for t in entry.terms if _is_white(t))
        if not white or not any(c in times for c in parts):
            continue
        for c in parts:
            old = channels.get(c, ChannelNoise(entry.unit, ()))
            channels[c] = replace(old, terms=(*white, *old.terms), covariance=None)
        rest = tuple(t for t in entry.terms if not _is_white(t))
        channels[name] = replace(entry, terms=rest, covariance=None)
        if not rest:
            del channels[name]
    return channels


def _is_white(term: Term) -> bool:
    return term.effect.name in (WHITE, SAMPLED)

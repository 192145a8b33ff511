"""The noise of a model with what was found in it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from kfgen.core.channel_names import acts_on
from kfgen.effects.faults.samples import Fault
from kfgen.effects.noise_model import ChannelNoise, NoiseModel, Term
from kfgen.gap.scene.noise_scale import scaled
from kfgen.gap.scene.scene_gap import SceneGap


def with_findings(
    assumed: NoiseModel, gaps: Sequence[SceneGap], sensor_units: Mapping[str, str] | None = None
) -> NoiseModel:
    """Every finding but a fault of the rig as a term of the channels where it acts.

    Parameters
    ----------
    assumed : NoiseModel
    gaps : sequence of SceneGap
    sensor_units : mapping of str to str, optional
        Units of all channels of a filter, whose file has an effect of a whole sensor once and not once a channel.
    """
    channels = rescaled(assumed.channels, gaps)
    units = sensor_units or {c: n.unit for c, n in channels.items()}
    for f in [f for g in gaps for f in g.findings if not isinstance(f.effect, Fault)]:
        held = [c for c in units if acts_on(f.where, c)]
        for name in [f.where] if sensor_units else held:
            old = channels.get(name, ChannelNoise(units[held[0]], ()))
            channels[name] = replace(old, terms=(*old.terms, Term(f.effect, f.ci95)), covariance=None)
    return replace(assumed, channels=channels)


def rescaled(channels: Mapping[str, ChannelNoise], gaps: Sequence[SceneGap]) -> dict[str, ChannelNoise]:
    """The noise of channels, of the size that was found.

    Parameters
    ----------
    channels : mapping of str to ChannelNoise
    gaps : sequence of SceneGap
    """
    out = dict(channels)
    for s in [s for g in gaps for s in g.noise_scales if not s.white]:
        for name in [c for c in out if acts_on(s.channel, c)]:
            terms = tuple(Term(scaled(t.effect, s.times)) for t in out[name].terms)
            out[name] = replace(out[name], terms=terms, covariance=None)
    return out

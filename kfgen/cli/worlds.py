"""Which world a gap is looked for in: a plant from a model file, sensors that move, or a sensor at rest."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

    from kfgen.effects.noise_model import ChannelNoise, NoiseModel
    from kfgen.gap.core.outcome import SceneGap
    from kfgen.gap.core.scene import Scene
    from kfgen.log.log import Log
    from kfgen.report.page import Answer


def is_model_file(model: str) -> bool:
    """Whether a path is a model file, by its format."""
    from kfgen.model.plant.user import FORMAT

    path = Path(model)
    if not path.is_file() or path.suffix != ".toml":
        return False
    try:
        document = tomllib.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError, OSError):
        return False  # the reader of noise files says what is wrong
    return document.get("format") == FORMAT


def plant_gap(model: str, log: Log) -> tuple[Answer, str]:
    """The answer for a plant, and the text of its mended model file."""
    from kfgen.effects.faults.samples import Fault
    from kfgen.gap.core.outcome import find_scene_gap
    from kfgen.gap.plant.updated_model import mended
    from kfgen.gap.plant.wiring import plant_scene
    from kfgen.model.plant.file import model_text
    from kfgen.model.plant.user import read_model
    from kfgen.report.scene import scene_answer

    believed = read_model(model)
    scene = plant_scene(believed, log)
    found = find_scene_gap(scene)
    trusted = {n: v for n, (_, v) in found.unknowns.items() if n in believed.parameters}
    missing = [f.placed for f in found.findings if not isinstance(f.placed.effect, Fault)]
    after = mended(believed, missing, trusted if missing else None)
    noises = _retuned({n: m.noise for n, m in after.measurements.items()}, found)
    after = replace(
        after, measurements={n: replace(m, noise=noises[n]) for n, m in after.measurements.items()}
    )
    texts = model_text(believed), model_text(after)
    return scene_answer(log, found, scene.unit, texts), texts[1]


def motion_gap(believed: NoiseModel, log: Log) -> tuple[Answer, NoiseModel] | None:
    """The answer for sensors that move, and the mended noise model; None where nothing moves."""
    from kfgen.effects.noise_model import noise_text
    from kfgen.gap.core.outcome import find_scene_gap
    from kfgen.gap.motion.missing_rows import with_missing
    from kfgen.gap.motion.scene import motion_scene
    from kfgen.report.scene import scene_answer, units_of_channels

    whole, said = with_missing(log)
    scene: Scene | None = motion_scene(whole, believed)
    if scene is None:
        scene, said = _turned_about(log, believed), ()
    if scene is None:
        return None
    found = find_scene_gap(scene)
    after = _with_findings(believed, found)
    texts = noise_text(believed), noise_text(after)
    answer = scene_answer(log, found, units_of_channels(log), texts)
    words = (*said, *answer.warnings)
    return replace(answer, warnings=words, data=answer.data | {"warnings": list(words)}), after


def _turned_about(log: Log, believed: NoiseModel) -> Scene | None:
    """An accelerometer that rests in several poses and has no reference."""
    from kfgen.core.errors import InputError
    from kfgen.gap.motion.known_length import norm_scene

    try:
        return norm_scene(log, believed)
    except InputError:  # holes or uneven time: at rest, the world of one channel can do with them
        return None


def _with_findings(believed: NoiseModel, found: SceneGap) -> NoiseModel:
    """Every finding but a fault of the rig as a term of the channels where it acts."""
    from kfgen.effects.faults.samples import Fault
    from kfgen.effects.noise_model import Term

    channels = _retuned(believed.channels, found)
    for f in [f for f in found.findings if not isinstance(f.placed.effect, Fault)]:
        where = f.placed.where
        for name in [c for c in channels if where in (c, c.rpartition("_")[0])]:
            old = channels[name]
            channels[name] = replace(old, terms=(*old.terms, Term(f.placed.effect, f.ci95)), covariance=None)
    return replace(believed, channels=channels)


def _retuned(channels: Mapping[str, ChannelNoise], found: SceneGap) -> dict[str, ChannelNoise]:
    """The noise of channels, of the size that was found."""
    from kfgen.effects.noise_model import Term
    from kfgen.gap.core.noise_scale import scaled

    out = dict(channels)
    for louder in found.noise_scales:
        for name in [c for c in out if louder.channel in (c, c.rpartition("_")[0])]:
            terms = tuple(Term(scaled(t.effect, louder.times)) for t in out[name].terms)
            out[name] = replace(out[name], terms=terms, covariance=None)
    return out

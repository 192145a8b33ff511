"""`find_gap`: where a model and a log disagree, whatever the model and the log are.

The log and the model decide the world: a plant from a model file; sensors that move, beside references of their own
or in several poses; or sensors at rest, each channel by itself.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import groupby
from pathlib import Path

from kfgen.core.channel_names import sensor_and_axis, some_of
from kfgen.core.elapsed import counted
from kfgen.core.errors import InputError
from kfgen.core.time_budget import time_budget
from kfgen.core.units import parse_unit
from kfgen.effects.faults.samples import Fault
from kfgen.effects.noise_model import ChannelNoise, NoiseModel, read_noise
from kfgen.gap.at_rest import at_rest, long_at_rest, source_of, updated_by
from kfgen.gap.core.drivers import drivers_of, silent
from kfgen.gap.core.result import EFFECTS_FOUND, NO_GAP, Comparison
from kfgen.gap.flight.noise.noise_file import as_given, assumed_noise, with_sizes
from kfgen.gap.motion.filter_scene import filter_scene
from kfgen.gap.motion.known_length import norm_scene
from kfgen.gap.motion.longest_rest import rest_of
from kfgen.gap.motion.missing_rows import with_missing
from kfgen.gap.motion.motion_scene import motion_scene
from kfgen.gap.motion.scene import MotionScene
from kfgen.gap.motion.slower_scene import slower_scene
from kfgen.gap.plant.updated_model import updated_model
from kfgen.gap.plant.wiring import plant_scene
from kfgen.gap.rest.even_record import regular
from kfgen.gap.rest.long_log import MAX_SAMPLES_AT_FULL_RATE, LongLog
from kfgen.gap.rest.several_recordings import JointGap, Recording, joint_gap
from kfgen.gap.result import GapResult, ModelFile, RecordingGap
from kfgen.gap.scene.scene import Placed
from kfgen.gap.scene.scene_gap import SceneGap, UnitOf, scene_gap
from kfgen.gap.updated_noise import rescaled, with_findings
from kfgen.gap.words import compared_at, refused_sentence
from kfgen.identify.screening.motion import motion_in
from kfgen.log.course import own_period_s
from kfgen.log.log import Log, StoredLog
from kfgen.log.own_rows import with_own_samples
from kfgen.log.pauses import longest_part, longest_part_of
from kfgen.log.readers import log_of, read_long
from kfgen.model.build import build, filter_file
from kfgen.model.filter import FilterModel
from kfgen.model.filter_file import is_filter_file
from kfgen.model.plant.user import FORMAT, UserModel, read_model
from kfgen.run.filter_log import as_named_by, unused_sensors

Model = NoiseModel | UserModel | FilterModel
AnyLog = Log | StoredLog


def find_gap(
    logs: AnyLog | str | Path | Sequence[AnyLog | str | Path],
    model: Model | str | Path,
    *,
    channels: Sequence[str] | str | None = None,
    proof: Sequence[Log | str | Path] = (),
) -> GapResult:
    """Where a model and a log disagree, the missing effects by name, and the updated model.

    Parameters
    ----------
    logs : Log, StoredLog or path, or a sequence of them
        One log; or several recordings of one sensor at rest, which are compared together.
    model : NoiseModel, UserModel, FilterModel, str or Path
        What is assumed: a model, a noise file, a model file, or the name of a library model.
    channels : sequence of str, or str with commas, optional
        The channels to compare; every one that the model and the log have when left out.
    proof : sequence of Log or path
        Other recordings of the sensor at rest, on which what was found is judged.

    Returns
    -------
    GapResult

    Raises
    ------
    InputError
        Model and log have no channel in common or not the same units, a log cannot be compared, or recordings are
        given that this world cannot use.
    """
    given = [logs] if isinstance(logs, (Log, StoredLog, str, Path)) else logs
    opened = [read_long(x) if isinstance(x, (str, Path)) else x for x in given]
    data = [x if isinstance(x, StoredLog) else log_of(x) for x in opened]
    others = [log_of(x) for x in proof]
    if not data:
        raise InputError("there is no log to compare", remedy="Give one")
    wanted = [c.strip() for c in channels.split(",") if c.strip()] if isinstance(channels, str) else channels
    stored = next((x for x in data if isinstance(x, StoredLog)), None)
    with time_budget() as budget:
        if stored is None:
            found = _found([x for x in data if isinstance(x, Log)], model, wanted, others)
        else:
            noise, names, said = _of_stored(stored, len(data), model, wanted)
            found = long_at_rest(noise, LongLog.of_stored(stored), names, others, said)
    refused = [refused_sentence(c.refused) for c in found.comparisons if c.refused]
    return replace(found, warnings=(*found.warnings, *refused, *budget.warnings))


def _found(
    data: Sequence[Log], model: Model | str | Path, wanted: Sequence[str] | None, others: Sequence[Log]
) -> GapResult:
    """The answer in the world that the log and the model decide."""
    name, assumed = _name(model), assumed_model(model)
    if len(data) > 1:
        return _several(name, assumed, data, wanted, others)
    if isinstance(assumed, UserModel):
        _refuse(others, name)
        return _plant(assumed, data[0])
    if isinstance(assumed, FilterModel):
        data = [as_named_by(assumed, data[0])]
        flown = _beside_references(name, assumed, data[0], wanted) or _in_flight(name, assumed, data[0])
        if flown is not None:
            _refuse(others, data[0].source)
            return flown
    noise, warnings = _common(name, assumed_noise(assumed, data[0]), data[0])
    own = {n: c.in_record(own_period_s(data[0], n), data[0].duration) for n, c in noise.channels.items()}
    noise = replace(noise, channels=own)
    names = list(wanted or noise.channels)
    moving = _moving(replace(noise, channels={n: noise.channel(n) for n in names}), data[0])
    if moving is not None:
        _refuse(others, data[0].source)
        return replace(moving, warnings=(*warnings, *moving.warnings))
    if how := motion_in(data[0], names):
        if isinstance(assumed, FilterModel):
            raise _unaided(assumed, data[0], f"the sensors moved ({how}), and the log has no reference")
        rest, said = rest_of(data[0], how)
        data = [rest]
        warnings.append(said)
    if data[0].n > MAX_SAMPLES_AT_FULL_RATE:
        long = LongLog.of_log(data[0], {n: noise.channel(n) for n in names})
        return long_at_rest(noise, long, names, others, warnings)
    return at_rest(noise, data[0], names, others, warnings)


def _unaided(model: FilterModel, log: Log, said: str) -> InputError:
    """That nothing in a log of a moving filter shows where it is wrong."""
    there = unused_sensors(model, log)
    take = (
        f"use what the log has (a filter file whose sensors have {', '.join(there)} too), " if there else ""
    )
    return InputError(
        f"{said} and no sensor that aids {model.name} in motion",
        where=log.source,
        remedy=f"Log GNSS, a barometer of the filter or a reference beside them, {take}or log them at rest",
    )


def _of_stored(
    log: StoredLog, logs: int, model: Model | str | Path, wanted: Sequence[str] | None
) -> tuple[NoiseModel, list[str], list[str]]:
    """The noise that is assumed of a log too long for memory, the channels that are compared, and what is to be said."""
    assumed = assumed_model(model)
    if not isinstance(assumed, NoiseModel) or logs > 1 or any(n.startswith("ref_") for n in log.channels):
        raise InputError(
            "a log of this length is compared alone, at rest, and with a noise file",
            where=log.source,
            remedy="Give a part of the log, or a noise file of its channels",
        )
    noise, said = _common(_name(model), assumed, log)
    return (
        noise.in_record(log.dt, log.dt * max(c.n for c in log.channels.values())),
        list(wanted or noise.channels),
        said,
    )


def _name(model: Model | str | Path) -> str:
    """How a model is called in messages."""
    if isinstance(model, NoiseModel):
        return "the noise model"
    return model.name if isinstance(model, (UserModel, FilterModel)) else str(model)


def assumed_model(model: Model | str | Path) -> Model:
    """A model as it is, from a file by its format, or from the library by its name."""
    if not isinstance(model, (str, Path)):
        return model
    if _is_model_file(model):
        return read_model(str(model))
    if str(model).endswith(".toml") and not is_filter_file(model):
        return read_noise(Path(model))
    return build(model)


def _is_model_file(model: str | Path) -> bool:
    """Whether a path is a model file, by its format."""
    path = Path(model)
    if not path.is_file() or path.suffix != ".toml":
        return False
    try:
        document = tomllib.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError, OSError):
        return False  # the reader of noise files says what is wrong
    return document.get("format") == FORMAT


def _common(name: str, noise: NoiseModel, log: AnyLog) -> tuple[NoiseModel, list[str]]:
    """The channels that the model and the log have, and what is to be said of the others."""
    known = {c: n for c, n in noise.channels.items() if c in log.channels}
    if not known:
        raise InputError(
            f"no channel of {name} is in the log",
            where=log.source,
            remedy=f"The model has {some_of(noise.channels)}, the log {some_of(log.channels)}",
        )
    for c, n in known.items():
        if not parse_unit(n.unit).same_dimension(parse_unit(log.channels[c].unit)):
            raise InputError(
                f"channel {c} is in {log.channels[c].unit} in the log, in {n.unit} in {name}",
                where=log.source,
                remedy="Correct the unit of one of them",
            )
    lacking = [c for c in noise.channels if c not in known]
    it = "it" if len(lacking) == 1 else "them"
    said = [f"{some_of(lacking)} of {name} cannot be compared: the log lacks {it}"] if lacking else []
    return NoiseModel(known, noise.provenance), said


def _refuse(others: Sequence[Log], where: str) -> None:
    if others:
        raise InputError(
            "another recording can be given for sensors at rest only", where=where, remedy="Leave --proof out"
        )


def _plant(assumed: UserModel, log: Log) -> GapResult:
    """Of a plant: what was found is written into its model file."""
    scene = plant_scene(assumed, log)
    found = scene_gap(scene, scene.unit)
    trusted = {n: v for n, (_, v) in found.unknowns.items() if n in assumed.parameters}
    missing = [Placed(f.effect, f.where) for f in found.findings if not isinstance(f.effect, Fault)]
    after = updated_model(assumed, missing, trusted if missing else None)
    noises = rescaled({n: m.noise for n, m in after.measurements.items()}, [found])
    measurements = {n: replace(m, noise=noises[n]) for n, m in after.measurements.items()}
    return _of_scenes(log, [found], assumed, replace(after, measurements=measurements), scene.warnings)


def _in_flight(name: str, model: FilterModel, log: Log) -> GapResult | None:
    """Of a filter by its innovations, without a reference; None where the log has no aiding sensor of the filter."""
    from kfgen.gap.flight.excitation import with_excitation
    from kfgen.gap.flight.flight_scene import flight_scene
    from kfgen.gap.flight.noise.noise_factors import with_noise_factors

    whole, log = log, longest_part(log)
    found = flight_scene(log, model)
    if found is None:
        return None
    _, warnings = _common(
        name, NoiseModel({c: ChannelNoise(u, ()) for c, u in model.channel_units.items()}), log
    )
    if log is not whole:
        warnings.append(longest_part_of(whole, log))
    if found.path.log.dt > 1.5 * log.dt:
        warnings.append(compared_at(1.0 / found.path.log.dt))
    gap = with_excitation(scene_gap(found, units_of(log)), found, model, units_of(log))
    gap = with_noise_factors(gap, found)
    written = as_given(model, assumed_noise(model, log))
    sized = with_sizes(written, model, gap.noise_scales)
    updated = filter_file(model, with_findings(sized, [gap], model.channel_units))
    return _of_scenes(log, [gap], filter_file(model, written), updated, warnings)


def _beside_references(
    name: str, model: FilterModel, log: Log, names: Sequence[str] | None
) -> GapResult | None:
    """Of the sensors of a filter along a motion that references say; None where they do not."""
    found = filter_scene(log, model, names)
    if found is None:
        return None
    scene, noise = found
    _, warnings = _common(
        name, NoiseModel({c: ChannelNoise(u, ()) for c, u in model.channel_units.items()}), log
    )
    gaps = _of_each_sensor(scene, log)
    written = as_given(model, noise)
    updated = filter_file(model, with_findings(written, gaps, model.channel_units))
    return _of_scenes(log, gaps, filter_file(model, written), updated, warnings)


def _moving(assumed: NoiseModel, log: Log) -> GapResult | None:
    """Of sensors that move, beside references or in several poses; None where nothing moves."""
    log = with_own_samples(log, _by_sensor(assumed.channels))
    whole, said = with_missing(log)
    scene = motion_scene(whole, assumed)
    if scene is not None:
        gaps = _of_each_sensor(scene, log)
        return _of_scenes(log, gaps, assumed, with_findings(assumed, gaps), (*said, *scene.warnings))
    try:
        poses = norm_scene(log, assumed)
    except InputError:  # holes or uneven time: at rest, one channel by itself can do with them
        return None
    if poses is None:
        return None
    gaps = [scene_gap(poses, units_of(log))]
    return _of_scenes(log, gaps, assumed, with_findings(assumed, gaps))


def _by_sensor(channels: Iterable[str]) -> list[list[str]]:
    """Channels of one sensor together: ``mag_x``, ``mag_y`` and ``mag_z``."""
    return [list(group) for _, group in groupby(sorted(channels), key=lambda n: sensor_and_axis(n)[0])]


def _of_each_sensor(scene: MotionScene, log: Log) -> list[SceneGap]:
    """Of every sensor that moves, each with its share of the time."""
    out, scenes = [], [slower_scene(s) for s in scene.by_sensor()]
    for k, one in enumerate(counted(scenes, "sensors", alike=False)):
        with time_budget(parts=len(scenes) - k):
            out.append(scene_gap(one, units_of(log)))
    return out


def _of_scenes(
    log: Log,
    gaps: Sequence[SceneGap],
    assumed: ModelFile,
    updated: ModelFile,
    warnings: Sequence[str] = (),
) -> GapResult:
    constant = dict.fromkeys(n for g in gaps for n in g.constant_inputs)
    still = [f"the input {n} never changes: no effect of it can be seen" for n in constant]
    said = (*log.held, *warnings, *still, *silent(log))
    return GapResult((source_of(log),), tuple(gaps), assumed, updated, said)


def units_of(log: Log) -> UnitOf:
    """Units of effects placed at channels of a log, or at a triad of them."""
    return lambda placed: log.unit_at(placed.where)


def _several(
    name: str, model: Model, logs: Sequence[Log], names: Sequence[str] | None, others: Sequence[Log]
) -> GapResult:
    """Of several recordings of one sensor at rest, together and each by itself."""
    moving = isinstance(model, UserModel) or any(n.startswith("ref_") for g in logs for n in g.channels)
    if isinstance(model, UserModel) or moving or others:
        why = "beside --proof" if others else "that moves, or of a plant"
        raise InputError(
            f"several recordings {why} are not compared together", remedy="Give one log at a time"
        )
    files = [log.sha256 for log in logs if log.sha256]
    if len(set(files)) < len(files):
        raise InputError("a log is given twice", where=logs[0].source, remedy="Give each log once")
    assumed, warnings = _common(name, assumed_noise(model, logs[0]), logs[0])
    drives = [drivers_of(log) for log in logs]
    found: dict[str, JointGap] = {}
    compared = names or list(assumed.channels)
    for channel in compared:
        noise, parts = assumed.channel(channel), []
        for log, (drive, words) in zip(logs, drives):
            _common(name, assumed_noise(model, log), log)
            record, stamps, more = regular(log, channel, noise.effects, drive)
            parts.append(Recording(log.source, record, stamps, log.stated))
            warnings += [f"{log.source}: {w}" for w in (*words, *more)]
        found[channel] = joint_gap(channel, parts, noise, len(compared))
    alone = tuple(
        RecordingGap(log.source, tuple(j.alone[k][1] for j in found.values())) for k, log in enumerate(logs)
    )
    return GapResult(
        tuple(map(source_of, logs)),
        tuple(_with_once(j) for j in found.values()),
        assumed,
        updated_by(assumed, {n: j.gap for n, j in found.items()}),
        tuple(dict.fromkeys(warnings)),
        recordings=alone,
    )


def _with_once(joint: JointGap) -> Comparison:
    """What lasts in all recordings; what happened once in one of them is a gap too."""
    once = any(f.once for _, g in joint.alone for f in g.findings)
    return replace(joint.gap, verdict=EFFECTS_FOUND) if joint.gap.verdict == NO_GAP and once else joint.gap

"""The command ``gap``: where model and record disagree."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from kfgen.cli.app import app
from kfgen.cli.options import Columns, Json, Output, Rate, Report, deliver, listed, noise_of, not_over, read

if TYPE_CHECKING:
    from kfgen.effects.noise_model import NoiseModel
    from kfgen.gap.core.holdout import Gap
    from kfgen.gap.rest.finding import ChannelGap
    from kfgen.log.log import Log
    from kfgen.report.page import Answer


def _believed(model: str, log: Log) -> tuple[NoiseModel, list[str]]:
    """What is believed of the channels of a log, from a noise file or a library model; what is to be said."""
    from kfgen.core.errors import InputError
    from kfgen.core.units import parse_unit
    from kfgen.effects.noise_model import ChannelNoise, NoiseModel, Term
    from kfgen.model.library import build

    if model.endswith(".toml"):
        noise = noise_of(Path(model))
        assert noise is not None
    else:
        built = build(model)
        noise = NoiseModel(
            {
                c: ChannelNoise(
                    log.channels[c].unit if c in log.channels else u,
                    tuple(Term(e) for e in built.noise[c] if e.name != "bias"),
                )
                for c, u in built.channel_units.items()
                if c in built.noise
            }
        )
    known = {c: n for c, n in noise.channels.items() if c in log.channels}
    if not known:
        raise InputError(
            f"no channel of {model} is in the log",
            where=log.source,
            remedy=f"The model has {', '.join(noise.channels)}, the log {', '.join(log.channels)}",
        )
    for c, n in known.items():
        if not parse_unit(n.unit).same_dimension(parse_unit(log.channels[c].unit)):
            raise InputError(
                f"channel {c} is in {log.channels[c].unit} in the log, in {n.unit} in {model}",
                where=log.source,
            )
    lacking = [c for c in noise.channels if c not in known]
    said = [f"{', '.join(lacking)} of {model} cannot be compared: the log lacks it"] if lacking else []
    return NoiseModel(known, noise.provenance), said


@app.command()
def gap(
    logs: Annotated[
        list[Path],
        typer.Argument(metavar="LOG...", help="A log; or several of one sensor at rest, compared together."),
    ],
    model: Annotated[str, typer.Option(help="What is believed: a noise file or a library model.")],
    channels: Annotated[str | None, typer.Option(help="Only these, separated by commas.")] = None,
    proof: Annotated[
        list[Path] | None, typer.Option(help="Another recording of the sensor at rest, to prove it on.")
    ] = None,
    rate: Rate = None,
    columns: Columns = None,
    output: Output = None,
    json: Json = None,
    report: Report = None,
) -> None:
    """Where model and record disagree, the missing effect by name, the mended model, before and after."""
    from kfgen.core.whole_file import write_text

    for log in logs:
        not_over(output, log)
    data = [read(log, rate, columns) for log in logs]
    others = [read(path, rate, columns) for path in proof or ()]
    if len(data) > 1:
        answer, text = gap_together(model, data, channels, others)
    else:
        answer, text = gap_between(model, data[0], channels, others)
    if output:
        write_text(output, text)
    deliver(answer, json, report)


def gap_between(
    model: str, data: Log, channels: str | None = None, others: Sequence[Log] = ()
) -> tuple[Answer, str]:
    """The answer over the gap between a model and a log, in whichever world they are, and the mended model's file."""
    from kfgen.cli.worlds import is_model_file, motion_gap, plant_gap
    from kfgen.effects.noise_model import noise_text
    from kfgen.gap.rest.cross_axis import with_pairs
    from kfgen.gap.rest.even_record import drivers_of, regular
    from kfgen.gap.rest.workflow import find_gap
    from kfgen.report.again import with_proofs
    from kfgen.report.gap import gap_answer, mended_model

    if is_model_file(model):
        _no_proof(others, model)
        return plant_gap(model, data)
    believed, said = _believed(model, data)
    believed = believed.extended_band(data.dt, data.duration)
    wanted = listed(channels) or list(believed.channels)
    moving = motion_gap(replace(believed, channels={n: believed.channel(n) for n in wanted}), data)
    if moving is not None:
        _no_proof(others, data.source)
        answer, mended = moving
        return replace(answer, warnings=(*said, *answer.warnings)), noise_text(mended)
    drive, words = drivers_of(data)
    said += words
    gaps = {}
    for name in wanted:
        record, stamps, words = regular(data, name, believed.channel(name).effects, drive)
        said += [w for w in words if w not in said]
        gaps[name] = find_gap(name, record, believed.channel(name), stamps, data.stated)
    gaps = with_pairs(gaps)
    answer = gap_answer(data, believed, gaps)
    answer = replace(answer, warnings=(*said, *answer.warnings))
    if others:
        answer = with_proofs(answer, gaps, [(o, _again(gaps, o)) for o in others])
    return answer, noise_text(mended_model(believed, gaps))


def gap_together(
    model: str, logs: Sequence[Log], channels: str | None, others: Sequence[Log]
) -> tuple[Answer, str]:
    """The answer over the gap between a model and several recordings of one sensor, and the mended model's file."""
    from kfgen.cli.worlds import is_model_file
    from kfgen.core.errors import InputError
    from kfgen.effects.noise_model import noise_text
    from kfgen.gap.rest.even_record import drivers_of, regular
    from kfgen.gap.rest.several_recordings import Recording, find_together
    from kfgen.report.gap import mended_model
    from kfgen.report.together import together_answer

    moving = is_model_file(model) or any(n.startswith("ref_") for log in logs for n in log.channels)
    if moving or others:
        why = "beside --proof" if others else "that moves, or of a plant"
        raise InputError(
            f"several recordings {why} are not compared together", remedy="Give one log at a time"
        )
    if len({log.sha256 for log in logs}) < len(logs):
        raise InputError("a log is given twice", where=logs[0].source, remedy="Give each log once")
    believed, said = _believed(model, logs[0])
    found = {}
    drives = [drivers_of(log) for log in logs]
    for name in listed(channels) or list(believed.channels):
        noise, parts = believed.channel(name), []
        for log, (drive, words) in zip(logs, drives):
            _believed(model, log)
            record, stamps, more = regular(log, name, noise.effects, drive)
            parts.append(Recording(log.source, record, stamps, log.stated))
            said += [f"{log.source}: {w}" for w in (*words, *more)]
        found[name] = find_together(name, parts, noise)
    answer = together_answer(logs, believed, found)
    mended = mended_model(believed, {n: t.gap for n, t in found.items()})
    return replace(answer, warnings=(*dict.fromkeys(said), *answer.warnings)), noise_text(mended)


def _again(gaps: Mapping[str, ChannelGap], other: Log) -> dict[str, Gap]:
    """The gap of every channel with a finding over another recording."""
    from kfgen.gap.rest.even_record import drivers_of, regular
    from kfgen.gap.rest.second_recording import again_on

    found = {n: g for n, g in gaps.items() if g.verdict != "bad_data" and (g.findings or g.retuned)}
    drive, _ = drivers_of(other)
    return {
        n: again_on(g, regular(other, n, g.mended.effects, drive)[0], Path(other.source).name)
        for n, g in found.items()
    }


def _no_proof(others: Sequence[Log], what: str) -> None:
    from kfgen.core.errors import InputError

    if others:
        raise InputError(
            "another recording can be given for sensors at rest only", where=what, remedy="Leave --proof out"
        )

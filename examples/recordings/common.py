"""What the examples on real recordings share: where these are, what is assumed, how an answer is said."""

import argparse
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kfgen.effects.noise_model import ChannelNoise, NoiseModel, Term
from kfgen.gap.core.result import Comparison, Finding
from kfgen.gap.find_gap import find_gap, units_of
from kfgen.gap.flight_words import outage_sentence
from kfgen.gap.result import GapResult, LogSource
from kfgen.gap.scene.scene import Scene
from kfgen.gap.scene.scene_gap import SceneGap, UnitOf, scene_gap
from kfgen.gap.words import finding_sentence, noise_scale_sentences
from kfgen.identify.evidence.record import Record
from kfgen.identify.identify import identify
from kfgen.log.log import Log
from kfgen.model.filter import FilterModel
from kfgen.model.plant.user import UserModel
from kfgen.report.gap import gap_answer
from kfgen.report.page import Answer, write_page

AXES = "xyz"
NOT_RULED_OUT = "This log does not rule out"
Array = NDArray[np.float64]
Case = tuple[Sequence[str], Answer | None]
DATA = Path(os.environ.get("KFGEN_DATA") or Path(__file__).resolve().parents[3] / "shared" / "data")


def identified(unit: str, t: Array, y: Array) -> ChannelNoise:
    """What a stretch at rest has beside a constant."""
    found = identify(Record(t - t[0], y)).fit.effects
    return ChannelNoise(unit, tuple(Term(e) for e in found if not e.coefficients()))


def at_rest(log: Log, names: Sequence[str], start: int, stop: int) -> NoiseModel:
    """A noise model from samples `start` to `stop`."""
    part = log.cut(start, stop)
    return NoiseModel({n: identified(log.channels[n].unit, part.t, part.values(n)) for n in names})


def thinned(log: Log, every: int) -> Log:
    """One sample of `every`."""
    kept = {n: replace(c, values=c.values[::every]) for n, c in log.channels.items()}
    return replace(log, t=log.t[::every], channels=kept)


def of_channel(log: Log, name: str, assumed: NoiseModel) -> Case:
    """The gap of one channel at rest."""
    found = find_gap(log, assumed, channels=[name])
    (gap,) = found.comparisons
    return [f"verdict {gap.verdict}", *map(partial(_said, gap), gap.findings)], gap_answer(found)


def of_scene(log: Log, scene: Scene | None, unit: UnitOf | None = None) -> tuple[SceneGap, list[str], Answer]:
    """The gap of a scene."""
    assert scene is not None
    gap = scene_gap(scene, unit or units_of(log))
    nothing = NoiseModel({})
    found = GapResult((LogSource(log.source, log.sha256),), (gap,), nothing, nothing)
    said = [f"{_said(gap, f)} ({100 * f.probability:.0f} %)" for f in gap.findings]
    return gap, [f"verdict {gap.verdict}", *said], gap_answer(found)


def of_log(log: Log, model: FilterModel | UserModel) -> Case:
    """The gap of a filter or a plant over a log without a reference."""
    found = find_gap(log, model)
    (gap,) = found.comparisons
    said = [f"{_said(gap, f)} ({100 * f.probability:.0f} %)" for f in gap.findings]
    said += noise_scale_sentences(gap.noise_scales)
    said += [outage_sentence(*pair) for pair in gap.outages]
    closed = f"{100 * gap.gap.closed:.0f} % of the gap closed"
    return [f"verdict {gap.verdict}", *said, closed], gap_answer(found)


def _said(gap: Comparison, finding: Finding) -> str:
    """The first sentence of a finding, and what the log does not rule out in its place."""
    first, *others = finding_sentence(gap, finding).split(". ")
    return ". ".join([first, *(s.split(";")[0] for s in others if s.startswith(NOT_RULED_OUT))])


def main(words: str, cases: Mapping[str, tuple[str, Callable[[Path], Case]]]) -> None:
    """Say what is found in each recording that is here, and write a page of each where a folder is given."""
    parser = argparse.ArgumentParser(description=words)
    parser.add_argument("--pages", type=Path, help="folder of the reports, which exists")
    parser.add_argument("names", nargs="*", help=f"some of {', '.join(cases)}; all when left out")
    given = parser.parse_args()
    if unknown := sorted(set(given.names) - set(cases)):
        sys.exit(f"there is no {', '.join(unknown)}; known are {', '.join(cases)}")
    for name in given.names or cases:
        file, case = cases[name]
        if not (DATA / file).is_file():
            print(f"{name}: skipped: {file} is not here (set KFGEN_DATA)")
            continue
        said, answer = case(DATA / file)
        print("\n  ".join([f"{name}:", *said]), flush=True)
        if given.pages and answer is not None:
            write_page(answer.page, given.pages / f"{name}.html")

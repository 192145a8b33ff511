"""What the examples on real recordings share: where these are, what is believed, how an answer is said."""

import argparse
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kfgen.effects.noise_model import ChannelNoise, NoiseModel, Term
from kfgen.gap.core.outcome import SceneGap, find_scene_gap
from kfgen.gap.core.scene import Scene
from kfgen.gap.rest.even_record import drivers_of, regular
from kfgen.gap.rest.workflow import find_gap
from kfgen.identify.evidence.record import Record
from kfgen.identify.identify import identify
from kfgen.log.log import Log
from kfgen.report.gap import gap_answer
from kfgen.report.gap_words import finding_sentence
from kfgen.report.page import Answer, write_page
from kfgen.report.scene import UnitOf, finding_words, scene_answer, units_of_channels

AXES = "xyz"
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


def of_channel(log: Log, name: str, believed: NoiseModel) -> Case:
    """The gap of one channel at rest."""
    record, stamps, _ = regular(log, name, believed.channel(name).effects, drivers_of(log)[0])
    gap = find_gap(name, record, believed.channel(name), stamps, log.stated)
    said = [f"verdict {gap.verdict}", *(finding_sentence(gap, f).split(". ")[0] for f in gap.findings)]
    return said, gap_answer(log, believed, {name: gap})


def of_scene(log: Log, scene: Scene | None, unit: UnitOf | None = None) -> tuple[SceneGap, list[str], Answer]:
    """The gap of a world."""
    assert scene is not None
    gap, unit = find_scene_gap(scene), unit or units_of_channels(log)
    said = [finding_words(f, unit).split(". ")[0] + f" ({100 * f.probability:.0f} %)" for f in gap.findings]
    return gap, [f"verdict {gap.verdict}", *said], scene_answer(log, gap, unit, ("", ""))


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

"""The emitted C over real recordings: word by word what Python computes, and beside double precision.

ahrs6: 100 s of BROAD trial 6, fast rotations at 285.7 Hz (Laidig et al., Data 6(7):72, 2021, CC BY 4.0).
ins15: a flight of a fixed wing (P. Riseborough, InertialNav, BSD-3), which begins at the attitude of its autopilot.
`kfgen verify DIR --log LOG` does the same with a log of yours.
"""

import os
import tempfile
from pathlib import Path

from recordings.fixed_wing import flight
from recordings.fixed_wing import model as flying

from kfgen.emit.folder import EmittedFilter, write_folder
from kfgen.emit.routines import Program
from kfgen.log.log import Log
from kfgen.log.readers import read_log
from kfgen.model.discretise import DiscreteModel
from kfgen.model.filter import FilterModel
from kfgen.model.library import build
from kfgen.report.proof import on_log_sentences
from kfgen.verify.compare import verify
from kfgen.verify.rounding import over_log

DATA = (
    Path(os.environ.get("KFGEN_DATA") or Path(__file__).resolve().parents[2] / "shared" / "data") / "dynamic"
)


def said(model: FilterModel, log: Log, start: dict[str, float]) -> str:
    """What the proof says."""
    program = Program(DiscreteModel(model, rate=1.0 / log.dt), "ud")
    played, found = over_log(program, log, start)
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "c"
        write_folder(program, "c", None, folder)
        (verdict,) = verify(EmittedFilter(program, "c", folder), ["host"], played=played)
    words = f"{model.name}, C: {verdict.differing} of {verdict.words} words differ."
    return "\n  ".join([words, *on_log_sentences(found)])


for name in ("broad_06_undisturbed_fast_rotation_A.npz", "inertialnav_swisslog1.npz"):
    file = DATA / name
    if not file.is_file():
        print(f"skipped: {name} is not here (set KFGEN_DATA)")
    elif name.startswith("broad"):
        print(said(build("ahrs6"), read_log(file).cut(0, 28_571), {}))
    else:
        print(said(flying(), *flight(file)))

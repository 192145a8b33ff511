"""The answer of ``verify``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from kfgen.core.errors import InputError
from kfgen.emit.folder import read_folder
from kfgen.report.page import Answer, Page, columns, sentence, table
from kfgen.verify.bounds.assumed import ASSUMPTIONS
from kfgen.verify.bounds.bounds import BoundsProof, bounds
from kfgen.verify.compare import Verification, verify
from kfgen.verify.fly import FaultFlights, fly_faults
from kfgen.verify.rounding import OnLog


def on_log_sentences(found: OnLog) -> list[str]:
    """What was played, and what single precision does to it, in words."""
    counts = ", ".join(f"{n} {r}" for r, n in found.calls.items())
    refused = ", ".join(f"{n} {s}" for s, n in found.refused.items()) or "none refused"
    r = found.rounding
    attitude = "" if r.attitude is None else f" the attitude within {r.attitude:.2g} rad,"
    return [
        f"Over {found.seconds:.6g} s of {Path(found.source).name}: {counts}; {refused}.",
        f"Beside double precision (kfgen run):{attitude} every state within {r.share:.2g} of its standard deviation "
        f"({r.state} at {r.t:.6g} s), standard deviations within {100.0 * r.spread:.2g} %.",
    ]


def verify_answer(found: Verification) -> Answer:
    """The comparison, with its counts, and what a log adds to it."""
    head, rows = found.short_table()
    words = [f"{'; '.join(found.summary())}."]
    if found.on_log is not None:
        words += on_log_sentences(found.on_log)
    facts = (("filter", found.model_hash[:16]),)
    parts = (*map(sentence, words[1:]), table(head, rows))
    page = Page("Proof on cores", parts, (words[0],), found.ok, facts)
    text = "\n".join([columns([head, *rows]), *words])
    warnings = () if found.on_log is None else found.on_log.warnings
    return Answer(text, found.to_dict(), page, ok=found.ok, warnings=warnings)


def faults_answer(found: FaultFlights) -> Answer:
    """The flights, and which floors they missed."""
    head, rows = found.short_table()
    words = [f"{'; '.join(found.summary())}."]
    page = Page("Flights with faults", (*map(sentence, words), table(head, rows)))
    return Answer("\n".join([columns([head, *rows]), *words]), found.to_dict(), page, ok=found.ok)


def bounds_answer(found: BoundsProof) -> Answer:
    """What is proven, what is assumed, and what hostile calls did."""
    head, rows = found.short_table()
    words = [f"{s}." for s in found.summary()]
    assumed_head, assumed = ("assumed", "bound", "kept by"), [[a.name, a.bound, a.kept] for a in ASSUMPTIONS]
    parts = (*map(sentence, words), table(head, rows), table(assumed_head, assumed))
    text = "\n".join([columns([head, *rows]), *words, *(f"assumed, {a}: {b} ({c})." for a, b, c in assumed)])
    return Answer(text, found.to_dict(), Page("Bounds of every operation", parts), ok=found.ok)


def folder_answer(
    folder: Path, cores: Sequence[str], *, faults: bool = False, bounded: bool = False, **compared: Any
) -> Answer:
    """What ``verify`` says of an emitted filter: the comparison, its flights with faults, or its bounds.

    Parameters
    ----------
    folder : Path
        As `kfgen.emit` wrote it.
    cores : sequence of str
        Their names.
    faults : bool
        Fly the faults.
    bounded : bool
        Bound its operations.
    **compared
        Else, as `kfgen.verify.compare.verify` has them: log, contract, sensor_rates.

    Raises
    ------
    InputError
        As in `kfgen.verify.compare.verify`, `kfgen.verify.fly.fly_faults` and `kfgen.verify.bounds.bounds.bounds`;
        faults or bounds beside one another, a log or fused products.
    """
    if not (faults or bounded):
        return verify_answer(verify(read_folder(folder), cores, **compared))
    if any(compared.values()) or (faults and bounded):
        raise InputError(
            "faults and bounds have inputs of their own, each alone and without fused products",
            where="--faults" if faults else "--bounds",
            remedy="Leave --log, --contract and --sensor-rate out, and ask for one of both",
        )
    if bounded:
        return bounds_answer(bounds(read_folder(folder), cores))
    return faults_answer(fly_faults(read_folder(folder), cores))

"""Hostile inputs, of a fixed seed: no exception but kfgen's own, no hang, no number that is none.

Files are made by their structure and then damaged: cells, headers, units, keys, bytes. Options take values from a list
of hostile ones. A part is in ``make test``; ``KFGEN_FUZZ`` commands (2,000) in ``make test-long``; ``make prove`` shows
more than a million inputs to parsers and readers. A command may refuse (exit status 2, one message) or answer (0 or 1,
without nan or inf), each in 10 s.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from conftest import DATA
from hostile import KINDS
from hostile_trials import RECORDINGS, TEXTS, commands, trials
from typer.testing import Result

Cli = Callable[..., Result]

SHORT_INPUTS = 120
LONG_INPUTS = int(os.environ.get("KFGEN_FUZZ", "2000"))
TEXT_INPUTS, FILE_INPUTS = 500, 100
SHORT_SECONDS = 15.0


@pytest.fixture(autouse=True)
def _folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def wrong(found: Iterator[str], seconds: float = float("inf")) -> list[str]:
    """What went wrong, within so many seconds of the processor."""
    until, out = time.process_time() + seconds, []
    for k, said in enumerate(found):
        if said:
            out.append(f"{k}: {said}")
        if time.process_time() > until:
            break
    return out


@pytest.mark.long
def test_hostile_inputs(kfgen: Cli) -> None:
    assert wrong(commands(kfgen, 20261122, SHORT_INPUTS), SHORT_SECONDS) == []


@pytest.mark.long
@pytest.mark.parametrize("seed", range(4))
def test_many_hostile_inputs(seed: int, kfgen: Cli) -> None:
    assert wrong(commands(kfgen, seed, LONG_INPUTS // 4)) == []


@pytest.mark.parametrize("kind", TEXTS)
def test_hostile_texts(kind: str) -> None:
    assert wrong(trials(kind, 1, TEXT_INPUTS)) == []


@pytest.mark.parametrize("kind", [*KINDS, *RECORDINGS])
def test_hostile_files(kind: str) -> None:
    if kind in RECORDINGS and not (DATA / RECORDINGS[kind]).is_file():
        pytest.skip(f"the recording {RECORDINGS[kind]} is not here (set KFGEN_DATA)")
    if kind == "ulg":
        pytest.importorskip("pyulog")
    assert wrong(trials(kind, 1, FILE_INPUTS, DATA)) == []

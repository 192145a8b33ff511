"""One trial: make a record, let the command line of kfgen answer, score the answer."""

from __future__ import annotations

import importlib
import json
import signal
import time
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from baseline import said
from case import Case, Request
from score import Score, score, steps_of
from second import reached

LIMIT = 300
"""Seconds after which a case counts as an error."""


def _late(number: int, frame: object) -> None:
    raise TimeoutError(f"no answer within {LIMIT} s")


def world(name: str) -> Any:
    """The module of a world: ``requests`` and ``make``."""
    return importlib.import_module(name)


def ask(place: Path, answer: Path) -> dict[str, Any]:
    """Let the command line answer; a failure is an answer too."""
    from typer.testing import CliRunner

    from kfgen.cli.app import app

    words = ["gap", str(place / "log.csv"), "--model", str(place / "model.toml"), "--json", str(answer)]
    words += ["-o", str(answer.with_suffix(".toml"))]
    signal.signal(signal.SIGALRM, _late)
    signal.alarm(LIMIT)
    try:
        result = CliRunner().invoke(app, words)
    except Exception as error:
        return {"error": f"{type(error).__name__}: {error}"}
    finally:
        signal.alarm(0)
    if answer.is_file():
        return dict(json.loads(answer.read_text(encoding="utf-8")))
    failure = result.exception if result.exception is not None else result.output
    return {"error": f"{type(failure).__name__}: {failure}".replace("\n", " ").replace(f"{place}/", "")}


def changed(case: Case, path: Path) -> dict[str, float]:
    """What the updated noise file says of the assumed noise and of a low-pass; nothing where there is none.

    Values are text with units: those of the assumed noise in the unit of the channel, as it was given.
    """
    name = case.hidden[0].channel
    if not path.is_file():
        return {}
    channel = tomllib.loads(path.read_text(encoding="utf-8"))[name]
    if channel["unit"] != case.channels[name][1]:
        raise ValueError(f"{path}: channel {name} changed its unit to {channel['unit']}")
    out: dict[str, float] = {}
    for term in channel["effects"]:  # the assumed terms come first
        for key in ("N", "order") if "gauss_markov" not in term["effect"] else ("sigma", "tau"):
            if key in term and key not in out and (key in case.base or key == "order"):
                out[key] = float(str(term[key]).split()[0])
    return out


def run(request: Request, folder: Path) -> Score:
    """Make, write, ask, score."""
    cases, truths, answers = folder / "cases", folder / "truths", folder / "answers"
    answers.mkdir(parents=True, exist_ok=True)
    case: Case = world(request.world).make(request)
    place = case.write(cases)
    start = time.perf_counter()
    answer = ask(place, answers / f"{request.id}.json")
    seconds = time.perf_counter() - start
    truth = json.loads(case.write_truth(truths).read_text(encoding="utf-8"))
    result = score(truth, answer, seconds)
    if case.base and request.kind in ("single", "unknown"):
        gained, best = reached(case, steps_of(answer), changed(case, answers / f"{request.id}.toml"))
        result = replace(result, gained=gained, best=best)
    if case.base:
        y = next(iter(case.channels.values()))[0]
        aic, bic = said(y, float(np.median(np.diff(case.t))), case.base)
        result = replace(result, allan_aic=aic, allan_bic=bic)
    return result

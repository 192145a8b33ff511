"""Proves the proof: it finds no differing word in what kfgen emits, finds an altered one, and counts costs.

Counts on an emulated core are exact and the same on every machine, so they are upper limits of budgets.
"""

from __future__ import annotations

import importlib.util
import json
import os
import re
import shutil
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from kfgen.discretise import DiscreteModel
from kfgen.emit.folder import Emitted, write_folder
from kfgen.emit.routines import Program
from kfgen.emit.scenario import scenario
from kfgen.model.library import build
from kfgen.verify.compare import verify
from kfgen.verify.core import Verdict

NAMES = ["gyro-static", "ahrs6", "ins15"]

# Measured with ziglang 0.17 (clang 22), unicorn 2.1.4: gyro-static predict 55, update_rest 58, stack 8, code
# 552; ahrs6 predict 400, update_accel 604, update_mag 703, stack 148, code 7148; ins15 predict 1927,
# update_gnss_position 1781, update_gnss_velocity 1805, stack 620, code 22700. The budgets are 2 % above.
BUDGETS: dict[str, dict[str, int]] = {
    "gyro-static": {"predict": 56, "update_rest": 59, "stack": 8, "text": 563},
    "ahrs6": {"predict": 408, "update_accel": 616, "update_mag": 717, "stack": 150, "text": 7290},
    "ins15": {
        "predict": 1965,
        "update_gnss_position": 1856,
        "update_gnss_velocity": 1878,
        "stack": 632,
        "text": 23154,
    },
}


@cache
def program(name: str) -> Program:
    return Program(DiscreteModel(build(name)))


def need(core: str) -> None:
    if core == "host":
        if shutil.which(os.environ.get("CC") or "cc") is None:
            pytest.skip("there is no C compiler on this machine")
        return
    for module in ("ziglang", "unicorn", "elftools"):
        if importlib.util.find_spec(module) is None:
            pytest.skip(f"{module} is not installed (pip install 'kfgen[pil]')")


@pytest.fixture(scope="module")
def verdicts(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str, str], Verdict]:
    """The verdict of a model on a core, worked out once."""

    @cache
    def find(name: str, core: str) -> Verdict:
        need(core)
        folder = tmp_path_factory.mktemp("emitted") / "c"
        write_folder(program(name), "c", None, folder)
        (verdict,) = verify(Emitted(program(name), "c", folder), [core])
        return verdict

    return find


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("core", ["host", "m4f"])
def test_no_word_differs(name: str, core: str, verdicts: Callable[[str, str], Verdict]) -> None:
    v = verdicts(name, core)
    n = program(name).n
    per_call = len(program(name).discrete.nominal_names) + n * (n + 1) // 2
    assert v.calls == len(scenario(program(name)))
    assert v.words == v.calls * per_call
    assert (v.differing, v.max_ulp) == (0, 0)


@pytest.mark.parametrize("name", NAMES)
def test_costs_are_within_budget(name: str, verdicts: Callable[[str, str], Verdict]) -> None:
    cost = verdicts(name, "m4f").cost
    found = {**cost.instructions, "stack": cost.stack_bytes, "text": cost.text_bytes}
    found.pop("init")
    assert found.keys() == BUDGETS[name].keys()
    over = {k: (v, BUDGETS[name][k]) for k, v in found.items() if v is None or v > BUDGETS[name][k]}
    assert over == {}
    assert min(v for v in found.values() if v is not None) > 0


def test_the_host_does_not_pretend_to_count(verdicts: Callable[[str, str], Verdict]) -> None:
    cost = verdicts("ahrs6", "host").cost
    assert (cost.instructions, cost.stack_bytes, cost.text_bytes) == ({}, None, None)


def altered(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert text.count(old) >= 1
    path.write_text(text.replace(old, new, 1))


@pytest.mark.parametrize("core", ["host", "m4f"])
def test_altered_header_is_found(core: str, kfgen: Callable[..., Any], tmp_path: Path) -> None:
    need(core)
    folder, out = tmp_path / "ahrs", tmp_path / "v.json"
    assert kfgen("emit", "ahrs6", "--target", "c", "-o", folder).exit_code == 0
    assert kfgen("verify", folder, "--core", core).exit_code == 0
    altered(folder / "ahrs6.h", "S_1 = (0.250400007f", "S_1 = (0.250400037f")
    done = kfgen("verify", folder, "--core", core, "--json", out)
    assert done.exit_code == 1
    assert re.search(rf"[1-9]\d* of 21000 words differ on {core}", done.stdout)
    verdict = json.loads(out.read_text())["cores"][core]
    assert 0 < verdict["differing"] <= verdict["words"] == 21000
    assert verdict["max_ulp"] >= 1


def test_header_that_does_not_compile_is_a_failed_check(kfgen: Callable[..., Any], tmp_path: Path) -> None:
    need("host")
    folder = tmp_path / "rest"
    assert kfgen("emit", "gyro-static", "--target", "c", "-o", folder).exit_code == 0
    altered(folder / "gyro_static.h", "return status;", "return 1.0;")
    assert kfgen("verify", folder, "--core", "host").exit_code == 1


def test_altered_filterpy_module_is_found(kfgen: Callable[..., Any], tmp_path: Path) -> None:
    folder = tmp_path / "py"
    assert kfgen("emit", "gyro-static", "--target", "filterpy", "-o", folder).exit_code == 0
    assert kfgen("verify", folder).exit_code == 0
    path = folder / "gyro_static.py"
    text = path.read_text()
    head, inject = text.split("def _inject", 1)
    assert "+ dx[1]" in inject
    changed = inject.replace("+ dx[1]", "+ (1.001 * dx[1])")
    path.write_text(f"{head}def _inject{changed}")
    assert kfgen("verify", folder).exit_code == 1, "a gain that is wrong by 1e-3 is not noticed"


def test_json_is_as_promised(kfgen: Callable[..., Any], tmp_path: Path) -> None:
    need("host")
    need("m4f")
    folder, out = tmp_path / "rest", tmp_path / "v.json"
    assert kfgen("emit", "gyro-static", "--target", "c", "-o", folder).exit_code == 0
    assert kfgen("verify", folder, "--core", "host", "--core", "m4f", "--json", out).exit_code == 0
    data = json.loads(out.read_text())
    assert data["format"] == "kfgen-verify-1"
    assert data["model_hash"] == program("gyro-static").discrete.hash
    assert data["cores"].keys() == {"host", "m4f"}
    for core in data["cores"].values():
        assert core.keys() >= {"words", "differing", "max_ulp", "instructions", "stack_bytes", "text_bytes"}
    assert data["cores"]["m4f"]["instructions"].keys() == {"init", "predict", "update_rest"}


def test_unknown_core_and_folder_are_bad_usage(kfgen: Callable[..., Any], tmp_path: Path) -> None:
    folder = tmp_path / "rest"
    assert kfgen("emit", "gyro-static", "--target", "c", "-o", folder).exit_code == 0
    assert kfgen("verify", folder, "--core", "z80").exit_code == 2
    assert kfgen("verify", tmp_path / "nowhere").exit_code == 2


def test_folder_of_another_model_is_refused(kfgen: Callable[..., Any], tmp_path: Path) -> None:
    folder = tmp_path / "rest"
    assert kfgen("emit", "gyro-static", "--target", "c", "-o", folder).exit_code == 0
    manifest = json.loads((folder / "kfgen.json").read_text())
    (folder / "kfgen.json").write_text(json.dumps(manifest | {"model_hash": "0" * 64}))
    assert kfgen("verify", folder).exit_code == 2


def test_emitting_into_the_folder_that_one_stands_in_keeps_it(
    kfgen: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "here"
    assert kfgen("emit", "gyro-static", "--target", "c", "-o", folder).exit_code == 0
    monkeypatch.chdir(folder)
    assert kfgen("emit", "gyro-static", "--target", "c", "-o", ".").exit_code == 0
    assert (folder / "gyro_static.h").is_file()
    assert [p.name for p in tmp_path.iterdir()] == ["here"]


def test_a_python_module_runs_on_no_emulated_core(kfgen: Callable[..., Any], tmp_path: Path) -> None:
    folder = tmp_path / "py"
    assert kfgen("emit", "gyro-static", "--target", "filterpy", "-o", folder).exit_code == 0
    assert kfgen("verify", folder, "--core", "m4f").exit_code == 2

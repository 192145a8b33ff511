"""Proves the proof: it finds no differing word in what kfgen emits, finds an altered one, and counts costs.

Counts on an emulated core are exact and the same on every machine, so they are upper limits of budgets.
"""

from __future__ import annotations

import importlib.util
import json
import os
import re
import runpy
import shutil
import subprocess
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from in_part import in_part

from kfgen.emit.folder import EmittedFilter, write_folder
from kfgen.emit.geodetic.calls import border_calls
from kfgen.emit.routines import Program
from kfgen.emit.scenario import scenario
from kfgen.model.discretise import DiscreteModel
from kfgen.model.library import build
from kfgen.verify.compare import verify
from kfgen.verify.core import CoreVerdict, InstructionCount
from kfgen.verify.load import NOISY, calls_a_second, instructions_a_second

NAMES = ["gyro-static", "ahrs6", "ins15"]

# Measured with ziglang 0.17 (clang 22), unicorn 2.1.4 on the Cortex-M4F; the budgets are 2 % above. For each
# model and form: instructions of each routine, deepest stack of the prediction and of all [B], code [B].
BUDGETS: dict[tuple[str, str], dict[str, int]] = {
    ("gyro-static", "p"): {"predict": 78, "update_rest": 104, "predict stack": 8, "stack": 8, "text": 1777},
    ("ahrs6", "p"): {
        "predict": 384, "update_accel": 737, "update_mag": 852, "predict stack": 90,
        "stack": 298, "text": 15310,
    },
    ("ahrs6", "ud"): {
        "predict": 470, "update_accel": 987, "update_mag": 1063, "predict stack": 49,
        "stack": 352, "text": 17800,
    },
    ("ins15", "p"): {
        "predict": 1730, "update_gnss_position": 2013, "update_gnss_velocity": 1993,
        "predict stack": 534, "stack": 534, "text": 34300,
    },
    ("ins15", "ud"): {
        "predict": 3370, "update_gnss_position": 3414, "update_gnss_velocity": 3046,
        "predict stack": 444, "stack": 636, "text": 46700,
    },
    ("ins23", "p"): {
        "predict": 2595, "update_gnss_position": 4342, "update_gnss_velocity": 4394,
        "update_mag": 6640, "update_airspeed": 2091, "predict stack": 640, "stack": 824,
        "text": 97100,
    },
    ("ins23", "ud"): {
        "predict": 5980, "update_gnss_position": 7316, "update_gnss_velocity": 6936,
        "update_mag": 8007, "update_airspeed": 2624, "predict stack": 602, "stack": 971,
        "text": 128000,
    },
}  # fmt: skip

# Instructions of all routines but `init` of the same filters, same compiler and core, without limits of inputs, gate,
# supervisor and settings; then what predicting walks of biases takes, of `ud` the step in which one of them comes in.
BARE = {
    ("ahrs6", "p"): 1678 + 8, ("ahrs6", "ud"): 2071 + 159, ("ins15", "p"): 5330 + 34, ("ins15", "ud"): 7138 + 1729,
    ("ins23", "p"): 18917 + 12, ("ins23", "ud"): 23813 + 3689,
}  # fmt: skip
MOST_FOR_SUPERVISION = 0.15
MOST_TO_GATHER = 250
"""Instructions of a call of align that gathers a sample."""
IN_MOTION = {"align_gather": 130, "align_moving": 4840, "align_course": 3900}
"""Instructions of the alignment in motion; of the course where nothing shows north."""
OF_PLACES = {"recentre": 60, "geodetic_fix": 13000, "geodetic_set_origin": 9300, "geodetic_to_place": 1300}
"""Instructions of the calls that know latitude and longitude, in double precision by software."""


@cache
def program(name: str, form: str = "p") -> Program:
    return Program(DiscreteModel(build(name)), form)


def need(core: str) -> None:
    if core == "host":
        if shutil.which(os.environ.get("CC") or "cc") is None:
            pytest.skip("there is no C compiler on this machine")
        return
    for module in ("ziglang", "unicorn", "elftools"):
        if importlib.util.find_spec(module) is None:
            pytest.skip(f"{module} is not installed (pip install 'kfgen[pil]')")


@pytest.fixture(scope="module")
def verdicts(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., CoreVerdict]:
    """The verdict of a model on a core, worked out once."""

    @cache
    def find(name: str, core: str, form: str = "p") -> CoreVerdict:
        need(core)
        folder = tmp_path_factory.mktemp("emitted") / "c"
        write_folder(program(name, form), "c", None, folder)
        (verdict,) = verify(EmittedFilter(program(name, form), "c", folder), [core])
        return verdict

    return find


@pytest.mark.parametrize("name", in_part(NAMES))
@pytest.mark.parametrize("core", in_part(["host", "m4f"]))
def test_no_word_differs(name: str, core: str, verdicts: Callable[..., CoreVerdict]) -> None:
    v = verdicts(name, core)
    n = program(name).n
    watched = len(program(name).supervisor.places)
    per_call = len(program(name).discrete.nominal_names) + n * (n + 1) // 2 + watched
    border, own = program(name).border, len(scenario(program(name)))
    more = border_calls(border) if border else ()
    assert v.calls == own + len(more)
    assert v.words == own * per_call + sum(c.words.size for c in more)
    assert (v.differing, v.max_ulp) == (0, 0)


CASES = [pytest.param(*key, marks=pytest.mark.long if key[0] == "ins23" else ()) for key in BUDGETS]


@pytest.mark.parametrize(("name", "form"), in_part(CASES))
def test_costs_are_within_budget(name: str, form: str, verdicts: Callable[..., CoreVerdict]) -> None:
    """And no word differs on the core that is counted."""
    verdict = verdicts(name, "m4f", form)
    assert (verdict.differing, verdict.max_ulp) == (0, 0)
    cost, budget = verdict.cost, BUDGETS[name, form]
    found = {**cost.instructions, "stack": cost.stack_bytes, "text": cost.text_bytes}
    found["predict stack"] = cost.stacks["predict"]
    found.pop("init")
    assert found.pop("align", 0) < MOST_TO_GATHER
    moving = {routine: found.pop(routine) for routine in IN_MOTION if routine in found}
    assert len(moving) == len(program(name).moving)
    assert {k: n for k, n in moving.items() if n is None or n > IN_MOTION[k]} == {}
    places = {routine: found.pop(routine) for routine in OF_PLACES if routine in found}
    assert len(places) == len(OF_PLACES) * (program(name).border is not None)
    assert {k: n for k, n in places.items() if n is None or n > OF_PLACES[k]} == {}
    assert found.keys() == budget.keys()
    over = {k: (v, budget[k]) for k, v in found.items() if v is None or v > budget[k]}
    assert over == {}
    assert min(v for v in found.values() if v is not None) > 0


@pytest.mark.parametrize(("name", "form"), [c for c in CASES if c.values != ("gyro-static", "p")])
def test_what_watches_over_a_filter_costs_little(
    name: str, form: str, verdicts: Callable[..., CoreVerdict]
) -> None:
    """Limits, gate, supervisor and settings below 15 % of the instructions of the equations."""
    cost = verdicts(name, "m4f", form).cost.instructions
    whole = sum(
        count for routine, count in cost.items() if routine not in ("init", "align", *OF_PLACES, *IN_MOTION)
    )
    assert 1.0 < whole / BARE[name, form] <= 1.0 + MOST_FOR_SUPERVISION


OTHERS = ["hostcpp", "m7f", "m33f", "m4", "m0", "rv32imfc", "rv32imc"]
OFTEN = ("hostcpp", "m0", "rv32imc")


@pytest.mark.parametrize(
    "core", in_part([c if c in OFTEN else pytest.param(c, marks=pytest.mark.long) for c in OTHERS])
)
def test_no_word_differs_on_any_core(core: str, tmp_path: Path) -> None:
    """In both forms, with loops and without, in double precision on one."""
    need("m4f")
    d = DiscreteModel(build("ahrs6"))
    options = [("p", "float", False), ("ud", "float", True)] + [("ud", "double", False)] * (core == "m7f")
    for k, option in enumerate(options):
        p = Program(d, *option)
        write_folder(p, "c", None, tmp_path / f"{k}")
        (v,) = verify(EmittedFilter(p, "c", tmp_path / f"{k}"), [core])
        assert v.words > 20_000
        assert (v.differing, v.max_ulp) == (0, 0)


@pytest.mark.long
@pytest.mark.parametrize("core", ["rv32imfc"])
def test_fused_products_stay_within_the_tolerance(core: str, tmp_path: Path) -> None:
    """They do fuse, for fewer instructions run; words are within a thousandth of a standard deviation."""
    need("m4f")
    p = Program(DiscreteModel(build("ahrs6")), "ud")
    write_folder(p, "c", None, tmp_path / "c")
    exact, fused = (
        verify(EmittedFilter(p, "c", tmp_path / "c"), [core], contract=c)[0] for c in (False, True)
    )
    assert (fused.differing, fused.tolerance) == (0, 1e-3)
    assert fused.cost.instructions["predict"] < exact.cost.instructions["predict"]


def test_the_host_does_not_pretend_to_count(verdicts: Callable[..., CoreVerdict]) -> None:
    cost = verdicts("ahrs6", "host").cost
    assert (cost.instructions, cost.stack_bytes, cost.text_bytes) == ({}, None, None)


def altered(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert text.count(old) >= 1
    path.write_text(text.replace(old, new, 1))


@pytest.mark.parametrize("core", in_part(["host", "m4f"]))
def test_altered_header_is_found(core: str, kfgen: Callable[..., Any], tmp_path: Path) -> None:
    need(core)
    folder, out = tmp_path / "ahrs", tmp_path / "v.json"
    assert kfgen("emit", "ahrs6", "--target", "c", "-o", folder).exit_code == 0
    assert kfgen("verify", folder, "--core", core).exit_code == 0
    altered(folder / "ahrs6.h", "AHRS6_SD_ACCEL_X 0.0199999996f", "AHRS6_SD_ACCEL_X 0.0200010000f")
    done = kfgen("verify", folder, "--core", core, "--json", out)
    assert done.exit_code == 1
    assert re.search(rf"[1-9]\d* of 47492 values differ on {core}", done.stdout)
    verdict = json.loads(out.read_text())["cores"][core]
    assert 0 < verdict["differing"] <= verdict["words"] == 47492
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


@pytest.mark.long
def test_the_header_says_what_a_call_costs(kfgen: Callable[..., Any], tmp_path: Path) -> None:
    """The same counts as the proof's."""
    need("m4f")
    folder, out = tmp_path / "f", tmp_path / "v.json"
    assert kfgen("emit", "ahrs6", "--target", "c", "--core", "m4f", "-o", folder).exit_code == 0
    assert kfgen("verify", folder, "--core", "m4f", "--json", out).exit_code == 0
    cost = json.loads(out.read_text())["cores"]["m4f"]
    text = (folder / "ahrs6.h").read_text()
    found = re.findall(r"Cortex-M4F, (\w+): (\d+) instructions, (\d+) bytes of stack, (\d+) of code", text)
    assert {r: int(n) for r, n, *_ in found} == cost["instructions"]
    assert {r: int(n) for r, _, n, _ in found} == cost["stack_bytes_by_routine"]
    assert {r: int(n) for r, *_, n in found} == cost["text_bytes_by_routine"]
    assert kfgen("emit", "ahrs6", "--target", "c", "--core", "host", "-o", tmp_path / "g").exit_code == 2
    assert not (tmp_path / "g").exists()


@pytest.mark.parametrize("form", in_part(["p", "ud"]))
def test_factors_stay_positive_with_identified_noise(form: str) -> None:
    """Ten minutes at rest without floors: the packed covariance in single precision is lost, the factors are not.

    Eigenvalues by LAPACK, of the covariance scaled to a unit diagonal.
    """
    need("host")
    bench = runpy.run_path(str(Path(__file__).parents[1] / "benchmarks" / "covariance_health.py"))
    P = bench["run"](bench["emitted"](form, "float"), 600.0)
    least = min(bench["smallest"](p) for p in P)
    if form == "p":
        assert least < 0.0
        return
    true = bench["run"](bench["emitted"]("p", "double"), 600.0)
    assert least == pytest.approx(min(bench["smallest"](p) for p in true), rel=0.05)
    assert least > 0.0
    ratio = np.sqrt(np.diagonal(P, axis1=1, axis2=2) / np.diagonal(true, axis1=1, axis2=2))
    assert np.abs(ratio - 1.0).max() < 0.01


@pytest.mark.long
@pytest.mark.parametrize("form", ["p", "ud"])
def test_header_has_no_finding_of_misra(form: str, tmp_path: Path) -> None:
    """By the add-on of cppcheck, where it is installed."""
    if shutil.which("cppcheck") is None:
        pytest.skip("cppcheck is not installed")
    write_folder(program("ahrs6", form), "c", None, tmp_path / "f")
    (tmp_path / "f" / "use.c").write_text(MISRA_USE)
    words = [
        "cppcheck",
        "--enable=style",
        "--addon=misra",
        "--max-configs=1",
        "-U__cplusplus",
        "--std=c99",
        "-q",
    ]
    done = subprocess.run(
        [*words, "--template={file}:{line}: {id}", "use.c"],
        cwd=tmp_path / "f",
        capture_output=True,
        text=True,
        check=False,
    )
    left_out = runpy.run_path(str(Path(__file__).parents[1] / "benchmarks" / "static_checks.py"))[
        "OF_CPPCHECK"
    ]
    lines = [line for line in (done.stdout + done.stderr).splitlines() if "misra" in line]
    found = [line for line in lines if line.split(": ")[-1] not in left_out]
    assert any(line.startswith("use.c") for line in found), "the add-on does not work"
    assert [line for line in found if not line.startswith("use.c")] == []


MISRA_USE = """
#include "ahrs6.h"
int main(void);
int main(void)
{
    static ahrs6_t kf;
    static const float in[3] = {0.1f, 0.2f, 0.3f};
    float q[4];
    int unused;
    static const kf_reason_t none = KF_REASON_NONE;
    kf_status_t s = ahrs6_init(&kf);
    s = ahrs6_predict(&kf, in, 0.01f);
    s = ahrs6_update_accel(&kf, in);
    s = ahrs6_update_mag(&kf, in);
    s = ahrs6_check(&kf);
    ahrs6_get_attitude(&kf, q);
    ahrs6_consider(&kf, 1, 1);
    return ((s == KF_OK) && (ahrs6_get_variance(&kf, AHRS6_E_PHI_N) > ahrs6_get_state(&kf, AHRS6_X_Q_W))
        && (ahrs6_get_nis(&kf) > ahrs6_get_innovation(&kf, 0)) && (ahrs6_model_hash() != 0) && (none == KF_REASON_NONE)) ? 0 : 1;
}
"""


def test_predictions_in_which_the_noise_of_a_bias_comes_in_have_a_count_of_their_own() -> None:
    """Three biases, one a step, once a second; other predictions take the least that was counted."""
    calls = calls_a_second(Program(DiscreteModel(build("ahrs6")), "ud"), {"mag": 50.0})
    assert calls == {"predict": 97.0, NOISY: 3.0, "update_accel": 100.0, "update_mag": 50.0}
    counted = {"predict": 467, "update_accel": 975, "update_mag": 1043}
    cost = InstructionCount(counted, least=counted | {"predict": 309})
    found = instructions_a_second(CoreVerdict("m4f", 1, 0, 0, 1, cost), calls)
    assert found == 97 * 309 + 3 * 467 + 100 * 975 + 50 * 1043
    constant = Program(DiscreteModel(build("ahrs6", None, {"biases": "constant"})), "ud")
    assert calls_a_second(constant, {}).keys() == counted.keys()


def test_the_instructions_of_a_second_are_those_of_its_calls(kfgen: Any, tmp_path: Path) -> None:
    emitted = kfgen("emit", "ahrs6", "--target", "c", "-o", str(tmp_path / "f"), "--set", "biases=constant")
    assert emitted.exit_code == 0
    answer = tmp_path / "a.json"
    words = ("verify", str(tmp_path / "f"), "--core", "m4f", "--json", str(answer))
    done = kfgen(*words, "--sensor-rate", "mag=50")
    found = json.loads(answer.read_text(encoding="utf-8"))
    count = found["cores"]["m4f"]["instructions"]
    total = 100 * count["predict"] + 100 * count["update_accel"] + 50 * count["update_mag"]
    assert found["instructions_a_second"] == {"m4f": total}
    assert (
        f"100 update_accel, 50 update_mag takes {total} instructions on m4f: {total / 1e6:.3g} MHz"
        in done.stdout
    )
    for wrong in ("baro=5", "mag=0", "mag=fast", "mag"):
        assert kfgen(*words, "--sensor-rate", wrong).exit_code == 2, wrong

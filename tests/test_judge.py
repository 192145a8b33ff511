"""Proves that a declaration is judged by what it explains, and that nothing of it is left behind.

Records are plain numpy: white noise, a supply voltage that swings and settles, and its square where the effect is there.
A record of noise names the declaration in less than 1 % of seeds; seeds are fixed.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import kfgen as kf
from kfgen.cli.app import app
from kfgen.core.errors import InputError
from kfgen.effects import catalogue, make
from kfgen.effects.noise_model import ChannelNoise, NoiseModel, Term, write_noise
from kfgen.gap.judge.judgement import WITH_IT, WITHOUT_IT, Judgement, Trials

DECLARED = Path(__file__).resolve().parents[1] / "examples" / "effects" / "supply_squared.py"
N, RATE, SAMPLES = 1e-4, 10.0, 6_000
T = np.arange(SAMPLES) / RATE
VOLTAGE = 3.3 + 0.2 * np.sin(2.0 * np.pi * T / 150.0) * np.exp(-T / 500.0)
ASSUMED = NoiseModel({"gyro_x": ChannelNoise("rad/s", (Term(make("white_noise", N=N)),))})


def log(size: float, seed: int) -> kf.Log:
    y = N * np.sqrt(RATE) * np.random.default_rng(seed).standard_normal(SAMPLES)
    y = y + size * (VOLTAGE - 3.3) ** 2
    channels = {"gyro_x": kf.Channel.of(y, "rad/s"), "voltage": kf.Channel.of(VOLTAGE, "V")}
    return kf.Log(T, channels, source="log.csv")


@pytest.mark.long
def test_what_is_there_earns_its_place() -> None:
    """8e-3 (V - 3.3 V)^2 against noise: sum of squares / 2 N^2 RATE is hundreds of nats."""
    judged = kf.judge(DECLARED, log(8e-3, 1), ASSUMED, cases=1)
    assert (judged.verdict, judged.objections) == ("earns_its_place", ())
    assert judged.shown is not None
    finding = judged.shown[1]
    expected = (
        0.5 * np.sum((8e-3 * ((VOLTAGE - 3.3) ** 2 - np.mean((VOLTAGE - 3.3) ** 2))) ** 2) / (N**2 * RATE)
    )
    assert finding.evidence_nats == pytest.approx(expected, rel=0.25)
    assert finding.ci95["coefficient"][0] < 8e-3 < finding.ci95["coefficient"][1]
    by_kind = {t.holding: t for t in judged.trials}
    assert (by_kind[WITH_IT].named, by_kind[WITHOUT_IT].named) == (1, 0)
    assert judged.found.gap.after <= judged.without.gap.after
    data = json.loads(json.dumps(judged.to_dict(), allow_nan=False))
    assert data["format"] == "kfgen-judgement-1"
    assert "supply_squared" not in catalogue()


def test_what_is_not_there_is_not_shown() -> None:
    judged = kf.judge(DECLARED, log(0.0, 2), ASSUMED)
    assert (judged.verdict, judged.trials) == ("not_shown", ())
    assert repr(judged).startswith("The log does not show supply_squared")


def test_objections_are_said_with_their_numbers() -> None:
    found = kf.find_gap(log(0.0, 3), ASSUMED)
    judged = Judgement("x", found, found, (Trials(WITH_IT, 8, 3, {}, 1, 3), Trials(WITHOUT_IT, 8, 2)))
    assert judged.objections == (
        "it is named in 3 of 8 simulated records that hold it",
        "its intervals hold 1 of 3 true numbers",
        "it is named in 2 of 8 simulated records without it",
    )
    worse = replace(found.comparisons[0], gap=replace(found.comparisons[0].gap, before=2.0, after=1.0))
    assert Judgement("x", found, replace(found, comparisons=(worse,))).verdict == "not_shown"


def test_the_command_says_it_and_ends_with_one_where_it_is_not_shown(tmp_path: Path) -> None:
    data = log(0.0, 4)
    table = np.column_stack([T, data.values("gyro_x"), VOLTAGE])
    np.savetxt(
        tmp_path / "log.csv", table, delimiter=",", header="t [s],gyro_x [rad/s],voltage [V]", comments=""
    )
    write_noise(ASSUMED, tmp_path / "noise.toml")
    words = ["judge", str(DECLARED), str(tmp_path / "log.csv"), "--model", str(tmp_path / "noise.toml")]
    done = CliRunner().invoke(app, [*words, "--report", str(tmp_path / "page.html")])
    assert done.exit_code == 1
    assert "The log does not show supply_squared." in done.output
    assert "on trial" in (tmp_path / "page.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("raise ValueError('no')", "cannot be imported"),
        ("x = 1", "declares not one effect"),
        (
            DECLARED.read_text(encoding="utf-8").replace('"supply_squared"', '"sinusoid"'),
            "the catalogue has an effect sinusoid",
        ),
        ("class A(__import__('kfgen.effects').effects.Effect):\n    name = 'silent'", "does not say"),
    ],
)
def test_a_file_that_declares_nothing_usable_is_refused(tmp_path: Path, text: str, said: str) -> None:
    file = tmp_path / "effect.py"
    file.write_text(text, encoding="utf-8")
    before = list(catalogue())
    with pytest.raises(InputError, match=said):
        kf.judge(file, log(0.0, 5), ASSUMED)
    assert list(catalogue()) == before


@pytest.mark.parametrize(("name", "cases"), [("none.py", 8), ("log.csv", 8), (str(DECLARED), 0)])
def test_no_python_and_no_records_are_refused(name: str, cases: int) -> None:
    with pytest.raises(InputError):
        kf.judge(name, log(0.0, 5), ASSUMED, cases=cases)

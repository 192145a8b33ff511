"""Proves that every meaning of B comes to the same process, and that every consumer gets its own numbers.

Expected values come from the definitions (the Allan variance of a Gauss-Markov process in closed form, with
mpmath) and from each consumer's formula, worked out here in SI; texts are parsed back by the rules of their readers.
"""

from __future__ import annotations

import hashlib
import json
import math
import re
from collections.abc import Callable
from pathlib import Path

import mpmath as mp
import numpy as np
import pytest
from typer.testing import Result

from kfgen.consumers import consumers, convert
from kfgen.core.errors import InputError
from kfgen.effects import make
from kfgen.effects.noise_model import (
    FORMAT,
    ChannelNoise,
    NoiseModel,
    Term,
    noise_text,
    parse_noise,
    write_noise,
)
from kfgen.effects.process.stochastic import FLICKER_FLOOR_OVER_B, GaussMarkov, gauss_markov_peak

Cli = Callable[..., Result]

DEG = math.pi / 180.0
MILLI_G = 9.80665e-3
TAU = 150.0
NAMES = ["sigma", "q", "B_ieee", "adev_min", "B_saini"]


def document(entry: str, unit: str = "deg/s") -> str:
    return f'format = "{FORMAT}"\n[gyro_x]\nunit = "{unit}"\neffects = [{{effect="gauss_markov", {entry}}}]\n'


def one(entry: str, unit: str = "deg/s") -> GaussMarkov:
    (effect,) = parse_noise(document(entry, unit), "n.toml").channel("gyro_x").effects
    assert isinstance(effect, GaussMarkov)
    return effect


def peak() -> tuple[float, float]:
    """Time and height of the peak of the Allan deviation, sigma = tau = 1, from the closed form."""
    mp.mp.dps = 30

    def avar(t: mp.mpf) -> mp.mpf:  # q^2 = 2
        return 2 / t * (1 - (3 - 4 * mp.exp(-t) + mp.exp(-2 * t)) / (2 * t))

    t = mp.findroot(lambda x: mp.diff(avar, x), 1.9)
    return float(t), float(mp.sqrt(avar(t)))


# The meanings of B.


def test_the_constants_follow_from_their_definitions() -> None:
    t, height = peak()
    assert gauss_markov_peak()[0] == pytest.approx(t, rel=1e-6)
    assert gauss_markov_peak()[1] == pytest.approx(height, rel=1e-11)
    assert (t, height) == pytest.approx((1.892618, 0.617364), rel=1e-6)
    floor = mp.sqrt(2 * mp.log(2) / mp.pi)
    assert pytest.approx(float(floor), rel=1e-14) == FLICKER_FLOOR_OVER_B
    assert pytest.approx(0.664282, rel=1e-6) == FLICKER_FLOOR_OVER_B


SIGMA = {  # of 1 U (or U/sqrt(s), U/sqrt(Hz)) at TAU
    "sigma": 1.0,
    "q": math.sqrt(TAU / 2.0),
    "B_ieee": 1.07600,
    "adev_min": 1.0 / 0.617364,
    "B_saini": math.sqrt(1.0 / TAU / 2.0),
}
UNITS = {"sigma": "", "q": "/sqrt(s)", "B_ieee": "", "adev_min": "", "B_saini": "/sqrt(Hz)"}


@pytest.mark.parametrize(
    "time", [f'tau="{TAU} s"', f'beta="{1 / TAU!r} 1/s"', f"beta={1 / TAU!r}", 'tau="2.5 min"']
)
@pytest.mark.parametrize("name", NAMES)
def test_every_meaning_is_read(name: str, time: str) -> None:
    effect = one(f'{name}="0.02 deg/s{UNITS[name]}", {time}')
    assert effect.tau == pytest.approx(TAU, rel=1e-12)
    assert effect.sigma == pytest.approx(0.02 * DEG * SIGMA[name], rel=5e-6)


@pytest.mark.parametrize("name", NAMES)
def test_the_order_of_the_keys_does_not_matter(name: str) -> None:
    assert one(f"{name}=0.02, beta=0.01") == one(f"beta=0.01, {name}=0.02")


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("unit", ["deg/s", "mg", "g/16384"])
def test_every_number_that_is_called_reads_back(name: str, unit: str) -> None:
    effect = GaussMarkov(sigma=3e-4, tau=TAU)
    value, text = effect.called(unit)[name]
    assert one(f'{name}="{value!r} {text}", tau={TAU}', unit).sigma == pytest.approx(3e-4, rel=1e-12)


def test_the_meanings_are_those_of_their_processes() -> None:
    """q drives, the peak is adev_min and the flicker of B_ieee has that floor, B_saini times beta drives."""
    effect = one('B_ieee="0.003 deg/s", tau="200 s"', "deg/s")
    q, b = effect.under("q"), effect.under("B_saini")
    assert effect.form().W[0][0] == pytest.approx(q**2, rel=1e-12)
    assert b / 200.0 == pytest.approx(q, rel=1e-12)
    tau = np.geomspace(20.0, 20000.0, 20001)
    highest = float(np.sqrt(effect.allan_variance(tau).max()))
    assert effect.under("adev_min") == pytest.approx(highest, rel=1e-6)
    flicker = make("bias_instability", B=0.003 * DEG, shortest=1e-3, longest=1e8)
    assert float(np.sqrt(flicker.allan_variance(np.array([300.0]))[0])) == pytest.approx(highest, rel=1e-2)


def test_a_file_is_written_as_sigma_and_tau() -> None:
    noise = parse_noise(document('q=0.02, beta=0.01, sigma_ci95=["0.1 deg/s", "0.2 deg/s"]'), "n")
    text = noise_text(noise)
    assert re.search(r'sigma = "[^"]+ deg/s", sigma_ci95 = \["0.1 deg/s", "0.2 deg/s"\], tau = "100 s"', text)
    assert noise_text(parse_noise(text, "again")) == text


WRONG = {
    "two at once": ("sigma=1, q=1, tau=1", "sigma and q both given"),
    "two other": ("B_ieee=1, adev_min=1, tau=1", "B_ieee and adev_min both given"),
    "two times": ("sigma=1, tau=1, beta=1", "tau and beta both given"),
    "zero": ("q=0, tau=1", "not positive"),
    "negative": ("B_saini=-1, tau=1", "not positive"),
    "beta zero": ("sigma=1, beta=0", "not positive"),
    "beta negative": ("sigma=1, beta=-1", "not positive"),
    "unit": ('q="1 deg/s", tau=1', "dimension"),
    "unit of saini": ('B_saini="1 deg/s", tau=1', "dimension"),
    "unit of beta": ('sigma=1, beta="100 s"', "dimension"),
    "bare B": ("B=1, tau=1", "no parameter 'B'"),
    "no size": ("tau=1", "lacks its parameter 'sigma'"),
    "no time": ("q=1", "lacks its parameter 'tau'"),
    "beyond": ("sigma=1, beta=1e-320", "beyond any number"),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_meaning_is_refused(case: str) -> None:
    entry, said = WRONG[case]
    with pytest.raises(InputError, match=re.escape(said)) as caught:
        one(entry)
    assert "[gyro_x]" in caught.value.where
    if said.startswith(("no ", "lacks")):
        assert {"B": "B_ieee", "siz": "B_saini", "tim": "beta"}[case.split()[1][:3]] in caught.value.remedy


# Consumers.


def imu(**changed: ChannelNoise | None) -> NoiseModel:
    """About an MPU-6050: N of 0.005 deg/s/sqrt(Hz) and 400 ug/sqrt(Hz); K, Gauss-Markov or both by axis."""
    white = {"x": 0.005, "y": 0.006, "z": 0.004}
    gyro = {
        "x": [make("rate_random_walk", K=1e-4 * DEG), GaussMarkov(sigma=2e-3 * DEG, tau=200.0)],
        "y": [GaussMarkov(sigma=3e-3 * DEG, tau=100.0)],
        "z": [make("rate_random_walk", K=2e-4 * DEG)],
    }
    channels: dict[str, ChannelNoise | None] = {
        f"gyro_{a}": ChannelNoise(
            "deg/s", tuple(map(Term, [make("white_noise", N=white[a] * DEG), *gyro[a]]))
        )
        for a in "xyz"
    }
    for k, a in enumerate("xyz"):
        effects = [
            make("white_noise", N=(0.4 + 0.05 * k) * MILLI_G),
            make("rate_random_walk", K=(1 + k) * 1e-5),
        ]
        channels[f"accel_{a}"] = ChannelNoise("mg", tuple(map(Term, effects)))
    channels |= changed
    return NoiseModel({n: c for n, c in channels.items() if c is not None})


N_GYRO, N_ACCEL = 0.006 * DEG, 0.5 * MILLI_G
Q_X, Q_Y = math.hypot(1e-4, 2e-3 * math.sqrt(2 / 200)) * DEG, 3e-3 * math.sqrt(2 / 100) * DEG
K_GYRO, K_ACCEL = Q_Y, 3e-5  # the worst walks: y and z
REAL = re.compile(r"[-+]?[0-9]+\.[0-9]*(?:[eE][-+][0-9]+)?$")


def yaml(text: str) -> dict[str, float | list[float]]:
    """The numbers of a YAML file by its readers' rule: a real number has a point."""
    found: dict[str, float | list[float]] = {}
    for line in text.splitlines():
        name, colon, value = line.partition("#")[0].strip().partition(": ")
        if colon and value[:1] == "[":
            items = [v.strip() for v in value.strip()[1:-1].split(",")]
            assert all(REAL.match(v) for v in items), line
            found[name] = [float(v) for v in items]
        elif colon and REAL.match(value.strip()):
            found[name] = float(value)
    return found


KALIBR = {
    "accelerometer_noise_density": N_ACCEL,
    "accelerometer_random_walk": K_ACCEL,
    "gyroscope_noise_density": N_GYRO,
    "gyroscope_random_walk": K_GYRO,
    "update_rate": 200.0,
}
ORB = {
    "IMU.NoiseGyro": N_GYRO,
    "IMU.NoiseAcc": N_ACCEL,
    "IMU.GyroWalk": K_GYRO,
    "IMU.AccWalk": K_ACCEL,
    "IMU.Frequency": 200.0,
}


@pytest.mark.parametrize("to", ["kalibr", "openvins", "orbslam3"])
def test_continuous_densities_of_the_worst_axis(to: str) -> None:
    made = convert(imu(), to, rate=200.0)
    wanted = ORB if to == "orbslam3" else KALIBR
    numbers = {k: v for k, v in yaml(made.text).items() if k != "time_offset"}
    assert numbers == pytest.approx(wanted, rel=1e-6)
    assert {k: v.numbers[0] for k, v in made.values.items()} == pytest.approx(wanted, rel=1e-12)
    walk = next(v for k, v in made.values.items() if re.match(r"gyr.*walk|IMU.GyroWalk", k))
    mean = (Q_X + Q_Y + 2e-4 * DEG) / 3
    assert "gyro_y, the worst of 3 axes" in walk.words
    assert f"mean {mean:.4g}" in walk.words
    assert "sqrt(2 sigma^2/tau)" in walk.words


def test_the_first_line_for_opencv_is_its_directive() -> None:
    assert convert(imu(), "openvins", rate=200.0).text.splitlines()[0] == "%YAML:1.0"


def test_covariances_of_gtsam() -> None:
    text = convert(imu(), "gtsam").text
    compile(text, "gtsam", "exec")
    for line in ("params.{}(np.diag([", "# C++: params->{}(gtsam::Matrix3(gtsam::Vector3("):
        for name, wanted in {
            "setGyroscopeCovariance": [(n * DEG) ** 2 for n in (0.005, 0.006, 0.004)],
            "setAccelerometerCovariance": [(n * MILLI_G) ** 2 for n in (0.4, 0.45, 0.5)],
            "setBiasOmegaCovariance": [Q_X**2, Q_Y**2, (2e-4 * DEG) ** 2],
            "setBiasAccCovariance": [1e-10, 4e-10, 9e-10],
        }.items():
            found = re.search(re.escape(line.format(name)) + r"([^\])]*)", text)
            assert found
            assert [float(v) for v in found.group(1).split(",")] == pytest.approx(wanted, rel=1e-6)


@pytest.mark.parametrize(
    ("to", "pattern", "names"),
    [
        (
            "px4",
            r"^param set (\w+) (\S+)$",
            ("EKF2_GYR_NOISE", "EKF2_ACC_NOISE", "EKF2_GYR_B_NOISE", "EKF2_ACC_B_NOISE"),
        ),
        (
            "ardupilot",
            r"^(\w+),(\S+)$",
            ("EK3_GYRO_P_NSE", "EK3_ACC_P_NSE", "EK3_GBIAS_P_NSE", "EK3_ABIAS_P_NSE"),
        ),
    ],
)
def test_deviations_of_a_step_of_the_autopilots(to: str, pattern: str, names: tuple[str, ...]) -> None:
    dt = 0.012
    found = dict(re.findall(pattern, convert(imu(), to, rate=1 / dt).text, re.M))
    wanted = [v / math.sqrt(dt) for v in (N_GYRO, N_ACCEL, K_GYRO, K_ACCEL)]
    assert list(found) == list(names)
    assert [float(v) for v in found.values()] == pytest.approx(wanted, rel=1e-5)
    # what a step of the filter adds to its variances is what the process does in that time
    assert (float(found[names[0]]) * dt) ** 2 == pytest.approx(N_GYRO**2 * dt, rel=1e-5)
    assert (float(found[names[2]]) * dt) ** 2 == pytest.approx(K_GYRO**2 * dt, rel=1e-5)


def test_an_autopilot_warns_of_a_value_out_of_its_range() -> None:
    quiet = ChannelNoise("deg/s", (Term(make("white_noise", N=1e-7)),))
    made = convert(imu(gyro_x=quiet, gyro_y=quiet, gyro_z=quiet), "px4", rate=100.0)
    assert any("EKF2_GYR_NOISE" in w and "outside" in w for w in made.warnings)


def test_units_and_common_time_of_kfgins() -> None:
    made = convert(imu(), "kfgins")
    numbers = yaml(made.text)
    corr = math.sqrt(200.0 * 100.0)
    gyro = [math.hypot(2e-3, 1e-4 * math.sqrt(corr / 2)), 3e-3, 2e-4 * math.sqrt(corr / 2)]
    assert numbers["arw"] == pytest.approx([60 * n for n in (0.005, 0.006, 0.004)], rel=1e-6)
    assert numbers["vrw"] == pytest.approx([60 * n * MILLI_G for n in (0.4, 0.45, 0.5)], rel=1e-6)
    assert numbers["gbstd"] == pytest.approx([3600 * g for g in gyro], rel=1e-6)
    assert numbers["abstd"] == pytest.approx([k * math.sqrt(corr / 2) for k in (1, 2, 3)], rel=1e-6)  # mGal
    assert numbers["corrtime"] == pytest.approx(corr / 3600, rel=1e-6)
    assert any("100 to 200 s" in w for w in made.warnings)


def test_the_table_has_every_parameter_and_every_meaning() -> None:
    noise = imu(mag_x=ChannelNoise("uT", (Term(GaussMarkov(sigma=1e-7, tau=9.0)),) * 2))
    made = convert(noise, "table")
    rows = [
        [c.strip() for c in line.strip("|").split("|")] for line in made.text.splitlines() if line[:1] == "|"
    ]
    n = next(r for r in rows if r[0] == "white_noise N")
    assert n[1] == "0.005 deg/s/sqrt(Hz)"
    assert "0.3 deg/sqrt(h)" in n[2]
    q = next(r for r in rows if r[0] == "q")
    assert float(q[1].split()[0]) == pytest.approx(2e-3 * math.sqrt(2 / 200), rel=1e-5)
    assert made.values["mag_x.gauss_markov_2.sigma"].numbers[0] == pytest.approx(0.1)
    assert made.values["gyro.N"].numbers[0] == pytest.approx(N_GYRO)
    assert sum(r[0] in NAMES for r in rows) == 4 * len(NAMES)


@pytest.mark.parametrize("to", [n for n in consumers() if n != "ardupilot-sim"])
def test_safety_multiplies_and_is_said(to: str) -> None:
    once, twice = (convert(imu(), to, rate=100.0, safety=s) for s in (1.0, 2.0))
    assert "no safety factor" in once.text or to == "basalt"  # JSON has no comments
    assert "safety factor 2" in twice.text or to == "basalt"
    for name, v in once.values.items():
        same = v.unit in ("Hz", "h", "s")
        factor = 1.0 if same else 4.0 if to in ("gtsam", "fastlio") else 2.0
        assert twice.values[name].numbers == pytest.approx([factor * n for n in v.numbers], rel=1e-12)
        assert same or "times safety 2" in twice.values[name].words


@pytest.mark.parametrize(
    "to",
    [n for n in consumers() if n not in ("table", "basalt", "gazebo", "matlab", "px4-sih", "ardupilot-sim")],
)
def test_what_was_not_identified_is_left_out_and_said(to: str) -> None:
    only = {
        f"accel_{a}": ChannelNoise(
            "mg", (Term(make("white_noise", N=4e-3)), Term(make("bias_instability", B=1e-4)))
        )
        for a in "xyz"
    }
    made = convert(imu(**only), to, rate=100.0)
    absent = [n for n, v in made.values.items() if not v.numbers]
    assert len(absent) == 1
    assert any(absent[0] in w and "not identified" in w for w in made.warnings)
    assert any("flicker is no random walk" in w for w in made.warnings)
    active = [line for line in made.text.splitlines() if not line.strip().startswith("#")]
    assert absent[0].lower() not in "\n".join(active).lower()
    assert any(absent[0] in line and "not identified" in line for line in made.text.splitlines())


@pytest.mark.parametrize("to", ["kalibr", "openvins", "orbslam3", "gtsam", "px4", "ardupilot"])
def test_the_rule_for_a_gauss_markov_is_said(to: str) -> None:
    made = convert(imu(), to, rate=100.0)
    assert any("gyro_y" in w and "in place of K" in w and "100 s" in w for w in made.warnings)
    assert any("gyro_x" in w and "added to K" in w for w in made.warnings)
    assert "equal over times short against tau" in made.text


def test_a_zero_counts_as_not_identified() -> None:
    zero = ChannelNoise("mg", (Term(make("white_noise", N=1e-3)), Term(make("rate_random_walk", K=0.0))))
    made = convert(imu(accel_x=zero, accel_y=zero, accel_z=zero), "kalibr", rate=100.0)
    assert made.values["accelerometer_random_walk"].numbers == ()


def test_an_axis_that_is_missing_is_said() -> None:
    made = convert(imu(gyro_z=None), "gtsam")
    assert any("lacks gyro_z" in w for w in made.warnings)
    assert made.values["gyroscopeCovariance"].numbers[2] == pytest.approx(N_GYRO**2)
    assert "gyro_z as the worst of the others" in made.values["gyroscopeCovariance"].words


@pytest.mark.parametrize("to", ["kalibr", "openvins", "orbslam3", "gtsam", "kfgins"])
@pytest.mark.parametrize(("sensor", "title"), [("gyro", "gyroscope"), ("accel", "accelerometer")])
def test_a_sensor_that_cannot_be_missed(to: str, sensor: str, title: str) -> None:
    gone = {f"{sensor}_{a}": None for a in "xyz"}
    with pytest.raises(InputError, match=f"no {title} channel"):
        convert(imu(**gone), to, rate=100.0)


@pytest.mark.parametrize("to", ["px4", "ardupilot"])
def test_an_autopilot_can_do_without_one_sensor(to: str) -> None:
    gone = {f"accel_{a}": None for a in "xyz"}
    made = convert(imu(**gone), to, rate=100.0)
    assert sum(not v.numbers for v in made.values.values()) == 2
    with pytest.raises(InputError, match="neither"):
        convert(NoiseModel({"mag_x": ChannelNoise("uT", ())}), to, rate=100.0)


@pytest.mark.parametrize("to", ["kalibr", "openvins", "orbslam3", "px4", "ardupilot"])
def test_a_rate_that_is_needed_is_asked_for(to: str) -> None:
    with pytest.raises(InputError, match="needs a rate") as caught:
        convert(imu(), to)
    assert caught.value.where == "--rate"


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"to": "ros9"}, "no consumer 'ros9'"),
        ({"rate": 0.0}, "rate"),
        ({"rate": math.nan}, "rate"),
        ({"rate": math.inf}, "rate"),
        ({"safety": 0.0}, "safety"),
        ({"safety": -1.0}, "safety"),
        ({"safety": math.nan}, "safety"),
    ],
)
def test_wrong_options_are_refused(changed: dict[str, float], said: str) -> None:
    with pytest.raises(InputError, match=said):
        convert(imu(), **{"to": "kalibr", "rate": 100.0, "safety": 1.0, **changed})  # type: ignore[arg-type]


def test_a_channel_in_a_unit_that_is_none_of_its_sensor() -> None:
    wrong = ChannelNoise("m/s^2", (Term(make("white_noise", N=1e-3)),))
    with pytest.raises(InputError, match="gyro_x is in m/s"):
        convert(imu(gyro_x=wrong), "kalibr", rate=100.0)
    assert "gyro.N" not in convert(imu(gyro_x=wrong), "table").values


def test_a_name_of_a_file_stays_in_its_comment() -> None:
    text = convert(imu(), "kalibr", rate=100.0, origin="a\nupdate_rate: 9.0\n#.toml").text
    assert yaml(text)["update_rate"] == 100.0


# The command.


@pytest.fixture
def noise_file(tmp_path: Path) -> Path:
    write_noise(imu(), tmp_path / "imu.toml")
    return tmp_path / "imu.toml"


def test_the_command_prints_the_file_alone(kfgen: Cli, noise_file: Path) -> None:
    done = kfgen("convert", noise_file, "--to", "kalibr", "--rate", 200)
    assert done.exit_code == 0
    assert yaml(done.stdout)["gyroscope_noise_density"] == pytest.approx(N_GYRO, rel=1e-6)
    assert "in place of K" in done.stderr
    assert "warning" not in done.stdout


def test_the_command_writes_text_answer_and_page(kfgen: Cli, noise_file: Path, tmp_path: Path) -> None:
    out, answer, page = tmp_path / "o.yaml", tmp_path / "a.json", tmp_path / "p.html"
    words = ["convert", noise_file, "--to", "px4", "--rate", 100, "--safety", 3]
    done = kfgen(*words, "-o", out, "--json", answer, "--report", page)
    assert done.exit_code == 0
    assert str(out) in done.stdout
    data = json.loads(answer.read_text("utf-8"))
    assert data["format"] == "kfgen-convert-1"
    assert (data["consumer"], data["rate_hz"], data["safety"]) == ("px4", 100.0, 3.0)
    assert data["sha256"] == hashlib.sha256(noise_file.read_bytes()).hexdigest()
    entry = data["parameters"]["EKF2_GYR_NOISE"]
    assert entry["value"] == pytest.approx(3 * N_GYRO * 10, rel=1e-8)
    assert entry["unit"] == "rad/s"
    assert "N / sqrt(dt)" in entry["from"]
    assert "PX4-Autopilot" in entry["source"]
    named = data["meanings"]["gyro_y"]["gauss_markov"]
    assert named["sigma"]["value"] == pytest.approx(3 * 3e-3, rel=1e-8)
    assert named["tau"] == {"value": pytest.approx(100.0), "unit": "s"}
    assert set(NAMES) <= set(named)
    assert out.read_text("utf-8").rstrip("\n") == data["text"]
    html = page.read_text("utf-8")
    assert "What each consumer calls B of gyro_y" in html
    assert "B_saini" in html


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--to", "kalibr"], "needs a rate"),
        (["--to", "ros9", "--rate", 9], "no consumer"),
        (["--to", "px4", "--rate=-1"], "--rate"),
        (["--to", "table", "--safety", "nan"], "--safety"),
        (["--to", "table", "-o", "nowhere/o.yaml"], "folder"),
    ],
)
def test_a_wrong_command_is_refused_and_leaves_nothing(
    words: list[object], said: str, kfgen: Cli, noise_file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(noise_file.parent)
    done = kfgen("convert", noise_file, "-o", "o.txt", "--report", "p.html", *words)
    assert done.exit_code == 2
    assert said in f"{done.exception} {done.stderr}"
    assert done.stdout == ""
    assert [p.name for p in noise_file.parent.iterdir()] == ["imu.toml"]


def test_the_command_does_not_overwrite_its_input(kfgen: Cli, noise_file: Path) -> None:
    before = noise_file.read_bytes()
    done = kfgen("convert", noise_file, "--to", "table", "-o", noise_file)
    assert done.exit_code == 2
    assert noise_file.read_bytes() == before


def test_the_list_names_the_consumers(kfgen: Cli) -> None:
    data = json.loads(kfgen("list", "--json", "-").stdout)
    assert set(data["consumers"]) == {
        *("kalibr", "openvins", "orbslam3", "gtsam", "px4", "ardupilot", "kfgins", "table"),
        *("vins", "fastlio", "liosam", "basalt", "matlab", "gazebo", "px4-sih", "ardupilot-sim"),
    }


def test_identify_shows_every_meaning_on_its_page(kfgen: Cli, tmp_path: Path) -> None:
    t = np.arange(6000) / 10.0
    rng = np.random.default_rng(5)
    y = GaussMarkov(sigma=1.0, tau=3.0).simulate(t, rng) + 0.3 * rng.standard_normal(t.size)
    rows = "".join(f"{a:.1f},{b:.6f}\n" for a, b in zip(t, y, strict=True))
    (tmp_path / "log.csv").write_text("t [s],gyro_x [deg/s]\n" + rows, encoding="utf-8")
    words = ["identify", tmp_path / "log.csv", "--effects", "white_noise,gauss_markov"]
    done = kfgen(*words, "--report", tmp_path / "p.html", "-o", tmp_path / "n.toml")
    assert done.exit_code == 0
    assert "B_ieee" in (tmp_path / "p.html").read_text("utf-8")
    written = (tmp_path / "n.toml").read_text("utf-8")
    assert "sigma = " in written
    assert "B_ieee" not in written

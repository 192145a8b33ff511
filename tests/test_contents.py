"""Proves that `kfgen list LOG` says what is inside: rates, gaps and clocks by numbers made here or of the library."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result

import kfgen as kf
from kfgen.core.errors import InputError
from kfgen.log.readers.tables.clock import Clock
from kfgen.report.figures import channels
from kfgen.report.plots import Line

Call = Callable[..., Result]
Find = Callable[[str], Path]


def test_a_clock_with_gaps_repeats_and_steps_back() -> None:
    t = np.concatenate([np.arange(100) * 0.01, 1.5 + np.arange(100) * 0.01])
    t = np.concatenate([t, [t[-1], t[-1] - 0.05]])
    clock = Clock.of(t)
    assert (clock.n, clock.gaps, clock.repeated, clock.back) == (202, 1, 1, 1)
    assert clock.rate == pytest.approx(100.0)
    assert (clock.longest, clock.longest_at) == (pytest.approx(0.51), pytest.approx(0.99))
    assert clock.jitter == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("n", [0, 1])
def test_a_clock_without_steps(n: int) -> None:
    clock = Clock.of(np.arange(float(n)))
    assert clock.n == n
    assert np.isnan(clock.rate)


def test_channels_of_a_text(tmp_path: Path, kfgen: Call) -> None:
    path = tmp_path / "a.csv"
    rows = [f"{k / 100},{k},{20 + k if k % 10 == 0 else ''}" for k in range(100) if not 50 <= k < 60]
    path.write_text("\n".join(["t [s],gyro_x [deg/s],temperature [degC]", *rows]) + "\n")
    out = tmp_path / "a.json"
    result = kfgen("list", path, "--json", out, "--report", tmp_path / "a.html")
    assert result.exit_code == 0
    found = json.loads(out.read_text())["channels"]
    assert found["gyro_x"]["rate_hz"] == pytest.approx(100.0)
    assert (found["gyro_x"]["samples"], found["gyro_x"]["gaps"]) == (90, 1)
    assert found["gyro_x"]["longest_step_s"] == pytest.approx(0.11)
    assert found["temperature"]["rate_hz"] == pytest.approx(10.0)
    assert found["temperature"]["min"] == pytest.approx(20.0)
    assert "gyro_x" in result.output
    assert "gyro_x" in (tmp_path / "a.html").read_text()


def test_topics_of_a_flight_are_those_of_the_library(recording: Find, kfgen: Call, tmp_path: Path) -> None:
    pyulog = pytest.importorskip("pyulog")
    path = recording("flights/px4_vtol_small.ulg")
    out = tmp_path / "a.json"
    assert kfgen("list", path, "--json", out).exit_code == 0
    found = json.loads(out.read_text())
    theirs = pyulog.ULog(str(path)).data_list
    assert sum(t["samples"] for t in found["topics"].values()) == sum(
        d.data["timestamp"].size for d in theirs
    )
    assert len(found["topics"]) == len(theirs) == 70
    assert found["channels"]["gyro_x"]["gaps"] == 1
    assert found["samples"] == "before"


def test_an_instance_and_a_topic_are_chosen(recording: Find, kfgen: Call, tmp_path: Path) -> None:
    pytest.importorskip("pyulog")
    path, out = recording("flights/px4_vtol_small.ulg"), tmp_path / "a.json"
    assert kfgen("list", path, "--topic", "sensor_gyro", "--instance", 2, "--json", out).exit_code == 0
    found = json.loads(out.read_text())
    assert found["samples"] == "at"
    assert any("sensor_gyro 2" in w for w in found["warnings"])


def test_a_flight_without_a_known_sensor_shows_its_topics_and_fails(tmp_path: Path, kfgen: Call) -> None:
    pytest.importorskip("rosbags")
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    kind = "std_msgs/msg/Float64"
    with Writer(tmp_path / "a.bag") as bag:
        connection = bag.add_connection("/speed", kind, typestore=store)
        for k in range(5):
            bag.write(connection, k * 10**9, store.serialize_ros1(store.types[kind](1.0), kind))
    result = kfgen("list", tmp_path / "a.bag")
    assert result.exit_code == 1
    assert "/speed" in result.output
    assert "none of its messages is a sensor" in result.output


def test_in_python(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("t [s],x [m]\n0,1\n1,2\n2,3\n")
    found = kf.contents(path)
    assert "1 channels" in repr(found)
    assert found.to_dict()["channels"]["x"]["mean"] == 2.0
    assert found._repr_html_().startswith("<p>")


def test_what_is_no_log_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        kf.contents(tmp_path / "gone.csv")


def test_without_a_log_the_names_are_listed(kfgen: Call) -> None:
    result = kfgen("list")
    assert result.exit_code == 0
    assert "ins15" in result.output


def test_the_spectrum_of_white_noise_is_level_at_its_density() -> None:
    """N = sd sqrt(dt), two-sided (IEEE Std 952): 20 000 samples give the median density within 3 %."""
    t = np.arange(20_000) / 50.0
    y = np.random.default_rng(6).normal(0.0, 0.1, t.size)
    density = channels._spectrum(Line("gyro_x", t, y, ""))
    assert density is not None
    assert np.median(density.y) == pytest.approx(0.1 / np.sqrt(50.0), rel=0.03)
    uneven = np.sort(np.random.default_rng(6).uniform(0.0, 400.0, t.size))
    assert channels._spectrum(Line("gyro_x", uneven, y, "")) is None
    assert channels._spectrum(Line("gyro_x", t[:20], y[:20], "")) is None


def test_a_thinned_line_keeps_what_is_extreme() -> None:
    y = np.zeros(100_000)
    y[54_321] = 9.0
    y[54_323] = -9.0
    thin = channels.thinned(Line("gyro_x", np.arange(100_000.0), y, ""))
    assert thin.x.size < 4000
    assert (thin.y.max(), thin.y.min()) == (9.0, -9.0)
    assert np.all(np.diff(thin.x) >= 0.0)


def test_sensors_are_drawn_with_their_spectra(tmp_path: Path, kfgen: Call) -> None:
    rows = [f"{k / 100},{np.sin(k)},{np.cos(k)},{20 + k if k % 50 == 0 else ''}" for k in range(400)]
    (tmp_path / "a.csv").write_text(
        "\n".join(["t [s],gyro_x [deg/s],gyro_y [deg/s],temperature [degC]", *rows])
    )
    assert kfgen("list", tmp_path / "a.csv", "--report", tmp_path / "a.html").exit_code == 0
    page = (tmp_path / "a.html").read_text(encoding="utf-8")
    said = ["gyro over time.", "Amplitude density of gyro, two-sided", "temperature over time."]
    assert [words for words in said if words not in page] == []
    assert "Amplitude density of temperature" not in page

"""Proves that tables in memory are logs by the names and units of their columns, and that no library is imported for it."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

import kfgen as kf
from kfgen.core.errors import InputError

T = np.arange(200) * 0.01
GYR = np.random.default_rng(1).normal(0.0, 0.1, (200, 3))
ACC = np.random.default_rng(2).normal([0.0, 0.0, -9.8], 0.1, (200, 3))
COLUMNS = {"t": T, "gyro_x [deg/s]": GYR[:, 0], "temperature [degC]": 20.0 + T, "u [N m]": T}


def right(log: kf.Log) -> None:
    assert log.t == pytest.approx(T, abs=1e-6)
    assert log.values("gyro_x") == pytest.approx(np.deg2rad(GYR[:, 0]))
    assert log.values("temperature") == pytest.approx(293.15 + T)
    assert log.values("u") == pytest.approx(T)


def test_a_mapping_of_arrays() -> None:
    right(kf.read_log(COLUMNS))


def test_triads_in_a_mapping_and_a_rate() -> None:
    log = kf.read_log({"gyr": GYR, "acc": ACC, "fs": 100.0})
    assert log.values("gyro_z") == pytest.approx(GYR[:, 2])
    assert log.values("accel_z") == pytest.approx(ACC[:, 2])
    assert log.dt == pytest.approx(0.01)
    assert kf.read_log({"gyro_x [deg/s]": GYR[:, 0]}, rate=50.0).dt == pytest.approx(0.02)


def test_a_frame_of_pandas() -> None:
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame({**COLUMNS, "mode": "hover"})
    right(kf.read_log(frame))
    dates = pandas.to_datetime(1_700_000_000 + T, unit="s")
    for index in (dates, dates.tz_localize("UTC")):
        dated = kf.read_log(pandas.DataFrame({k: v for k, v in COLUMNS.items() if k != "t"}).set_axis(index))
        assert dated.t == pytest.approx(1.7e9 + T, abs=1e-6)
    column = kf.read_log(pandas.DataFrame({**COLUMNS, "t": dates.tz_localize("UTC")}))
    assert column.t == pytest.approx(1.7e9 + T, abs=1e-6)


def test_a_frame_of_polars() -> None:
    polars = pytest.importorskip("polars")
    right(kf.read_log(polars.DataFrame({**COLUMNS, "mode": ["hover"] * 200})))


def test_a_table_of_pyarrow() -> None:
    pa = pytest.importorskip("pyarrow")
    right(kf.read_log(pa.table(COLUMNS)))


def test_a_data_set_of_xarray() -> None:
    xarray = pytest.importorskip("xarray")
    data = xarray.Dataset(
        {
            "gyro_x": ("time", GYR[:, 0], {"units": "deg/s"}),
            "temperature": ("time", 20.0 + T, {"units": "degC"}),
            "u": ("time", T, {"units": "N m"}),
        },
        coords={"time": T},
    )
    right(kf.read_log(data))


def test_quantities_of_pint() -> None:
    pint = pytest.importorskip("pint")
    units = pint.UnitRegistry()
    log = kf.read_log({"t": T, "gyro_x": units.Quantity(GYR[:, 0], "deg/s"), "u": units.Quantity(T, "N*m")})
    assert log.values("gyro_x") == pytest.approx(np.deg2rad(GYR[:, 0]))
    assert log.values("u") == pytest.approx(T)


def test_quantities_of_unyt() -> None:
    unyt = pytest.importorskip("unyt")
    log = kf.read_log(
        {"t": T, "gyro_x": unyt.unyt_array(GYR[:, 0], "rad/s"), "d": unyt.unyt_array(T, "m/s**2")}
    )
    assert log.values("gyro_x") == pytest.approx(GYR[:, 0])
    assert log.values("d") == pytest.approx(T)


def test_verbs_take_the_log() -> None:
    found = kf.identify(kf.read_log({"t": T, "gyro_x [deg/s]": GYR[:, 0]}), effects="white_noise")
    assert "gyro_x" in found.to_dict()["channels"]


@pytest.mark.parametrize("data", [3.0, [1.0, 2.0], None])
def test_what_is_no_table_is_refused(data: object) -> None:
    with pytest.raises(InputError, match="is no log"):
        kf.read_log(data)


def test_a_table_of_words_is_refused() -> None:
    with pytest.raises(InputError, match="no array of samples"):
        kf.read_log({"name": np.array(["a", "b"])})


def test_no_library_is_imported() -> None:
    script = (
        "import sys, numpy as np, kfgen as kf; kf.read_log({'t': np.arange(3.0), 'x [m]': np.ones(3)}); "
        "print([m for m in ('pandas', 'polars', 'xarray', 'pyarrow', 'pint') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"

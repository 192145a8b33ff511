"""Proves that solutions of RTKLIB are read as their text has them, in metres about the first."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from kfgen.core.errors import InputError
from kfgen.log.readers import read_log

HEADER = "%  GPST            latitude(deg) longitude(deg) height(m) Q ns sdn(m) sde(m) sdu(m) age(s) ratio"


def pos(folder: Path, *lines: str) -> Path:
    path = folder / "a.pos"
    path.write_text("\n".join(lines) + "\n")
    return path


def test_a_walk_is_that_of_its_text(recording: Callable[[str], Path]) -> None:
    path = recording("flights/rtk_walk_gnss.pos")
    log = read_log(path)
    cells = [line.split() for line in path.read_text().splitlines()[1:]]
    fixed = [c for c in cells if float(c[5]) == 1.0]
    assert log.n == len(fixed) == 349
    first = datetime.strptime(" ".join(fixed[0][:2]), "%Y/%m/%d %H:%M:%S.%f").replace(tzinfo=UTC)
    assert log.t[0] == pytest.approx(first.timestamp(), abs=1e-6)
    assert log.values("gnss_v_N") == pytest.approx([float(c[15]) for c in fixed])
    assert log.values("gnss_v_D") == pytest.approx([-float(c[17]) for c in fixed])
    assert log.values("gnss_p_D") == pytest.approx([float(fixed[0][4]) - float(c[4]) for c in fixed])
    assert any("187 of 536 solutions without fixed ambiguities" in w for w in log.warnings)


def test_velocity_is_the_rate_of_position(recording: Callable[[str], Path]) -> None:
    log = read_log(recording("flights/rtk_walk_gnss.pos"))
    even = np.diff(log.t) < 0.26
    for axis in "NE":
        step = np.diff(log.values(f"gnss_p_{axis}"))[even]
        v = log.values(f"gnss_v_{axis}")
        mean = 0.5 * (v[1:] + v[:-1])[even] * 0.25
        assert np.std(step - mean) < 0.35 * np.std(step)


@pytest.mark.parametrize("separator", [" ", ",", "\t"])
def test_weeks_and_separators(tmp_path: Path, separator: str) -> None:
    row = separator.join(["2000", "100.5", "47.0", "8.0", "400.0", "1", "9", "0", "0", "0", "0", "0"])
    log = read_log(pos(tmp_path, "% program : RTKPOST", HEADER, row, row.replace("100.5", "100.7")))
    epoch = datetime(1980, 1, 6, tzinfo=UTC).timestamp()
    assert log.t == pytest.approx(epoch + 2000 * 7 * 86400 + np.array([100.5, 100.7]))


def test_a_baseline_is_metres_from_the_base(tmp_path: Path) -> None:
    header = "%  UTC   e-baseline(m)  n-baseline(m)  u-baseline(m) Q ns"
    rows = [f"2024/01/02 03:04:0{k}.000 1.0 2.0 3.0 1 9" for k in range(3)]
    log = read_log(pos(tmp_path, header, *rows))
    assert [log.values(f"gnss_p_{a}")[0] for a in "NED"] == [2.0, 1.0, -3.0]


def test_a_cut_last_line_is_left_out_and_said(tmp_path: Path) -> None:
    rows = [f"2024/01/02 03:04:0{k}.000 47.0 8.0 400.0 1 9 0 0 0 0 0" for k in range(4)]
    log = read_log(pos(tmp_path, HEADER, *rows, rows[0][:30]))
    assert log.n == 4
    assert any("1 lines are no solution" in w for w in log.warnings)


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        (["hello", "1 2 3"], "no header of RTKLIB"),
        ([HEADER], "no solution in it"),
        (["%  GPST x-ecef(m) y-ecef(m) z-ecef(m) Q ns", "2024/01/02 03:04:05 1 2 3 1 9"], "Earth-fixed"),
    ],
)
def test_what_is_no_solution_is_refused(tmp_path: Path, lines: list[str], said: str) -> None:
    with pytest.raises(InputError, match=said):
        read_log(pos(tmp_path, *lines))

"""Proves that what is printed beside the papers' numbers is what theory gives."""

from __future__ import annotations

import numpy as np
import pytest
from papers.compare import bound, table
from papers.compare import compare as scores
from papers.figures import figure_1, figure_2
from papers.hemerly import figure_1 as rows_of_figure_1
from papers.hemerly import section_4, table_1
from papers.narasimhappa import (
    Static,
    reference_rate,
    static_sensor,
    under_motion,
    white_state_variance,
)
from papers.row import over_seeds, page_of, text_of
from scipy.spatial.transform import Rotation

from kfgen.log.log import Channel, Log
from kfgen.report.page import page_html


def test_bounds_at_the_point_of_section_2_2() -> None:
    """Exact Fisher information: .0022, 183, .90, 198 (Whittle's is between .7 and 1.3 of it over ten taus)."""
    wanted = {"N": 0.0022, "B": 183.0, "K": 0.90, "beta": 198.0}
    for name, value in bound().items():
        assert value == pytest.approx(wanted[name], rel=0.3)


@pytest.mark.long
def test_table_1_by_the_asymptotic_deviation() -> None:
    """sd(e0) / e0 = 1 / sqrt(2 n); median of absolute errors .674 of that, within a factor of two over 15 seeds."""
    rows = {r.what: float(r.here) for r in table_1(15)}
    for n in (1000, 10_000):
        here = rows[f"table 1: error of e0 [%], {n} readings"]
        assert 0.4 < here / (67.4 / np.sqrt(2 * n)) < 2.0
    assert rows["e0 by eq. (6)"] == pytest.approx(133.7, abs=0.05)
    assert rows["e1 by eq. (6)"] == pytest.approx(-98.1, abs=0.05)


@pytest.mark.long
def test_condition_numbers_and_pictures() -> None:
    assert float(rows_of_figure_1()[0].here) == pytest.approx(9.0, abs=0.01)
    html = page_html(page_of("paper", [("4", section_4())], [figure_1(), figure_2()]))
    assert html.count("<svg") == 2
    assert "not public" in html


@pytest.mark.long
def test_comparison_of_methods_in_short() -> None:
    one = scores(1)
    assert one["ml"].given["N"] == 1
    assert one["ml"].error["N"] < 5 * bound()["N"]
    assert "Cramér-Rao bound" in table(one, 1)


def test_the_variance_of_the_state() -> None:
    """ARMA(2,1) by psi weights; the companion form with white noise lacks 2 phi1 theta of the covariance."""
    psi = [1.0, -0.5422 + 0.1382]
    for _ in range(200):
        psi.append(-0.5422 * psi[-1] - 0.1204 * psi[-2])
    true, as_white = white_state_variance()
    assert true == pytest.approx(float(np.sum(np.square(psi))), rel=1e-9)
    ar = [1.0, -0.5422]
    for _ in range(200):
        ar.append(-0.5422 * ar[-1] - 0.1204 * ar[-2])
    assert as_white == pytest.approx((1 + 0.1382**2) * float(np.sum(np.square(ar))), rel=1e-9)


def turning(n: int, dt: float) -> tuple[Log, np.ndarray]:
    """A body that turns about x by a known rate, with gyro and reference."""
    t = np.arange(n) * dt
    rate = 2.0 * np.sin(t)
    q = Rotation.from_rotvec(np.outer(2.0 * (1 - np.cos(t)), [1, 0, 0])).as_quat(scalar_first=True)
    noise = 0.01 * np.random.default_rng(0).standard_normal(n)
    channels = {"gyro_x": Channel(rate + noise, "rad/s")}
    channels |= {f"ref_q_{a}": Channel(q[:, i], "") for i, a in enumerate("wxyz")}
    return Log(t, channels), rate


def test_reference_rate() -> None:
    log, rate = turning(2000, 0.01)
    found = reference_rate(log)[:, 0]
    good = np.isfinite(found)
    assert good.sum() > 1900
    assert found[good] == pytest.approx(rate[good], abs=5e-3)


def test_motion_shows_the_price() -> None:
    log, _ = turning(2000, 0.01)
    noise = 0.01 * np.random.default_rng(1).standard_normal(2000)
    still = Log(np.arange(2000) * 0.01, {"gyro_x": Channel(noise, "rad/s")})
    lines = {
        line.split("  ")[1].strip(): line.split()
        for line in under_motion(log, still, ["kf"]).splitlines()[1:]
    }
    assert float(lines["raw gyro"][-1]) < 0.02
    assert float(lines["kf"][-1]) > 0.99


def test_static_table() -> None:
    text = Static.of(static_sensor(30.0), 0.01, ["kf"])
    assert "do not use it as a denoiser" in text.words()[0]
    assert "raw data" in text.table()


def test_rows_say_how_many_seeds_there_are() -> None:
    row = over_seeds("x", "1", [1.0, np.nan, 3.0])
    assert row.here == "2"
    assert "2 of 3" in row.interval
    assert "none" in text_of("t", [over_seeds("x", "1", [np.nan])])

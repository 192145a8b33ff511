"""What results show of themselves in a notebook: a table, axes of matplotlib, a data frame of pandas."""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from html.parser import HTMLParser
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest

import kfgen as kf
from kfgen.core.errors import InputError, MissingExtra
from kfgen.core.result import Result, ShortTable
from kfgen.report.plots import Line, Picture, bars_picture, series_picture

ROOT = Path(__file__).resolve().parents[1]
RATE_HZ = 50.0
NOISE = """format = "kfgen-noise-1"
[gyro_x]
unit = "deg/s"
effects = [ { effect = "white_noise", N = "0.0035 deg/s/sqrt(Hz)" } ]
"""


@pytest.fixture(autouse=True)
def _no_window() -> Iterator[None]:
    """Figures of pyplot without a screen, closed after each test."""
    import matplotlib.pyplot as plt

    before = mpl.get_backend()
    plt.switch_backend("agg")
    yield
    plt.close("all")
    plt.switch_backend(before)


def bench(slope: float = 0.0, names: tuple[str, ...] = ("gyro_x",)) -> kf.Log:
    """Axes at rest, 120 s: white noise of 0.0035 deg/s/sqrt(Hz), and a ramp [deg/s^2]."""
    rng = np.random.default_rng(7)
    t = np.arange(6000) / RATE_HZ
    sd = 0.0035 * np.sqrt(RATE_HZ)
    channels = {
        n: kf.Channel(np.radians(slope * t + sd * rng.standard_normal(t.size)), "deg/s") for n in names
    }
    return kf.Log(t, channels, "bench")


@dataclass(frozen=True, repr=False)
class Hostile(Result):
    """A result with hostile texts and columns of numbers."""

    def summary(self) -> list[str]:
        return ["<script>alert(1)</script>", "the second line & more"]

    def short_table(self) -> ShortTable:
        return ("name", "count", "share", "mixed"), [["<b>a</b>", "3", "0.5", "1"], ["b", "4", "1e-3", "1 m"]]


class Markup(HTMLParser):
    """Tags, and whatever could ask for something outside."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.attributes: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes += [name for name, _ in attrs]


def test_html_is_escaped_whole_and_asks_for_nothing() -> None:
    shown = Markup(Hostile()._repr_html_())
    assert set(shown.tags) == {"p", "table", "tr", "th", "td"}
    assert shown.tags.count("p") == 2  # every line of the summary
    assert shown.tags.count("td") == 8
    assert shown.attributes == []


def test_frame_has_numbers_where_all_cells_are() -> None:
    pandas = pytest.importorskip("pandas")
    frame = Hostile().to_frame()
    assert isinstance(frame, pandas.DataFrame)
    assert frame["count"].tolist() == [3, 4]
    assert frame["share"].tolist() == [0.5, 0.001]
    assert frame["mixed"].tolist() == ["1", "1 m"]
    assert list(frame.columns) == ["name", "count", "share", "mixed"]
    found = kf.identify(bench())
    assert found.to_frame().shape == np.shape(found.short_table()[1])


def test_a_log_is_shown_in_one_line() -> None:
    assert repr(bench()) == "bench: 6000 samples, t = 0 to 119.98 s; gyro_x"
    wide = bench(names=tuple(f"c{k}" for k in range(14)))
    assert repr(wide).endswith("c11 and 2 more")


def test_without_pandas_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(MissingExtra, match=r'pip install "kfgen\[pandas\]"'):
        Hostile().to_frame()


def test_identification_opens_an_allan_deviation_for_each_channel() -> None:
    found = kf.identify(bench(names=("gyro_x", "gyro_y")))
    axes = found.plot()
    assert [ax.get_title() for ax in axes] == ["gyro_x", "gyro_y"]
    assert {ax.get_xscale() for ax in axes} == {"log"}
    # theory: white noise has the Allan deviation N / sqrt(tau); the curve is in the user's unit
    tau, deviation = axes[0].lines[0].get_data()
    assert deviation[0] * np.sqrt(tau[0]) == pytest.approx(0.0035, rel=0.05)
    assert len({id(ax.figure) for ax in axes}) == 1


def test_a_gap_opens_the_allan_deviation_and_the_spectrum(tmp_path: Path) -> None:
    (tmp_path / "noise.toml").write_text(NOISE, encoding="utf-8")
    gap = kf.find_gap(bench(slope=1e-3), tmp_path / "noise.toml")
    axes = gap.plot()
    assert {"averaging time τ [s]", "frequency [Hz]"} <= {ax.get_xlabel() for ax in axes}
    assert all(ax.figure.get_suptitle().startswith("gyro_x: ") for ax in axes)


def test_a_run_opens_its_estimates_and_innovations_and_an_audit_its_states() -> None:
    found = kf.run("ahrs6", kf.simulate("ahrs6", "generic", duration=2.0, seed=3))
    axes = found.plot()
    titles = dict.fromkeys(ax.figure.get_suptitle().split(".")[0] for ax in axes)
    assert list(titles)[-len(found.updated) :] == [f"Innovations of {n}" for n in found.updated]
    seen = kf.audit("ahrs6", ["static"], duration=2.0)
    assert {ax.get_ylabel() for ax in seen.plot()} == {
        f"standard deviation [{s.unit}]" for s in seen.first.model.states
    }
    without = replace(seen, audits=tuple(replace(a, degree=None) for a in seen.audits))
    with pytest.raises(InputError, match="the audit of ahrs6 has no picture"):
        without.plot()


def test_what_has_no_picture_says_so() -> None:
    with pytest.raises(InputError, match="no picture of a result of the kind Derivation"):
        kf.derive("ahrs6").plot()


def test_axes_that_are_hidden_are_not_given_and_a_page_opens_no_figure() -> None:
    import matplotlib.pyplot as plt

    picture = bars_picture(["a", "b"], [0.9, 0.1], "probability", "k")
    assert picture.svg.startswith("<svg")
    assert plt.get_fignums() == []
    (ax,) = picture.open("Candidates of $x$")
    assert ax.figure.get_suptitle() == "Candidates of $x$"
    ax.figure.canvas.draw()
    assert len(plt.get_fignums()) == 1
    assert isinstance(series_picture([Line("a", np.arange(3.0), np.arange(3.0), "k")], "y", "k"), Picture)


def test_matplotlib_is_imported_in_the_report_only_and_late() -> None:
    for path in sorted((ROOT / "kfgen").rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        if "matplotlib" not in text:
            continue
        tree = ast.parse(text)
        named = [n for n in ast.walk(tree) if isinstance(n, ast.Import | ast.ImportFrom)]
        drawing = [n for n in named if "matplotlib" in ast.unparse(n)]
        assert not drawing or path.parent.name == "report", path
        assert not [n for n in drawing if n in tree.body], path

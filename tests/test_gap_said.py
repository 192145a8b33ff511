"""What the answer of a world that moves says: no unit where there is none, nothing twice, what is taken to be zero."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.fft import dct

from kfgen.core.units import derived_unit, parse_unit
from kfgen.effects import make
from kfgen.effects.faults.samples import UnitError
from kfgen.effects.inertial.magnetic import SoftIron
from kfgen.gap.core.battery import white_tests
from kfgen.gap.core.holdout import Gap
from kfgen.gap.core.result import Comparison, Finding, NoiseScale, OutageDrift
from kfgen.gap.flight_words import outage_sentence
from kfgen.gap.words import finding_sentence, left_sentences, noise_scale_sentences

FIELD = ("field along 1_n", "field along 2_n", "field along 3_n")


def soft_iron(*entries: str) -> Finding:
    values = dict.fromkeys(entries, 0.003)
    ci95 = dict.fromkeys(entries, (0.002, 0.004))
    return Finding(SoftIron(**values), "mag", "uT", ci95, 0.99, 30.0)


def said_of(found: Finding, unknowns: tuple[str, ...] = ()) -> str:
    """Its sentence in the answer of a world in which these numbers are unknown."""
    whole = Comparison(
        channels=("mag",),
        verdict="effects_found",
        findings=(found,),
        before=(),
        after=(),
        gap=Gap(0.0, 0.0, 0.0, (0.0, 0.0)),
        span_s=(0.0, 1.0),
        unknowns=dict.fromkeys(unknowns, ("uT", 0.0)),
    )
    return finding_sentence(whole, found)


@pytest.mark.parametrize(
    ("entries", "unknowns", "said"),
    [
        (("xx", "xy", "yy"), FIELD, "only differences of xx, yy and zz can be seen: zz is taken to be zero"),
        (("xx",), ("length of the field",), "can be seen: yy and zz are taken to be zero"),
        (("xx", "xy", "yy"), (), ""),  # a reference says how large the field is
        (("xy",), FIELD, ""),
        (("xx", "yy", "zz"), FIELD, ""),
    ],
)
def test_scales_of_soft_iron_that_are_fixed_at_zero(
    entries: tuple[str, ...], unknowns: tuple[str, ...], said: str
) -> None:
    """(1 + e) times a matrix in a field is the matrix in a field 1 + e times as large."""
    words = said_of(soft_iron(*entries), unknowns)
    assert said in words if said else "taken to be zero" not in words


def test_another_fault_of_the_same_name_is_not_said() -> None:
    others = (("unit_error", "u", 0.3), ("unit_error", "u", 0.3), ("sign_error", "u", 0.3))
    found = Finding(UnitError(1000.0), "u", "V", probability=0.1, alternatives=others)
    assert said_of(found).endswith("Just as well it is sign_error of u")


@pytest.mark.parametrize(
    ("template", "meant"),
    [("U", ""), ("1/(U)", ""), ("1/(U)^2", ""), ("U/s", "1/s"), ("U*s", "s"), ("1/(U*s^2)", "1/s^2")],
)
@pytest.mark.parametrize("unit", ["", "1"])
def test_a_number_has_no_unit(template: str, meant: str, unit: str) -> None:
    assert derived_unit(template, unit) == meant
    assert parse_unit(derived_unit("U/sqrt(Hz)", unit)).same_dimension(parse_unit("sqrt(s)"))


def test_an_effect_of_a_dimensionless_input_is_said_in_plain_numbers() -> None:
    effect = make("input_nonlinearity", k2=0.01, k3=0.0)
    words = said_of(Finding(effect, "u", "", {"k2": (0.009, 0.011)}, 0.99, 30.0))
    assert "k2 = 0.01 (95 %: 0.009 to 0.011)" in words


def test_channels_of_one_noise_are_said_together() -> None:
    mag = [NoiseScale(f"mag_{a}", 2.24, (1.87, 2.69), True) for a in "xyz"]
    other = NoiseScale("gyro_x", 2.24, (1.87, 2.69))
    assert noise_scale_sentences([*mag, other]) == [
        "The white noise of mag_x, mag_y, mag_z is 2.24 times as large as assumed (95 %: 1.87 to 2.69)",
        "The noise of gyro_x is 2.24 times as large as assumed (95 %: 1.87 to 2.69)",
    ]


@pytest.mark.parametrize(("f", "said"), [(0.0, "a constant offset"), (0.1, "a periodic line at 0.1")])
def test_a_line_without_a_period_is_an_offset(f: float, said: str) -> None:
    """Of a record of a thousand samples at 1 Hz; the largest ordinate is that of the added wave."""
    t = np.arange(1000)
    z = np.random.default_rng(9).standard_normal(1000) + np.cos(2.0 * np.pi * f * (t + 0.5))
    whole = Comparison(
        channels=("accel",),
        verdict="unknown_effect",
        findings=(),
        before=(),
        after=tuple(white_tests(z, 1.0, dct(z, norm="ortho"))),
        gap=Gap(0.0, 0.0, 0.0, (0.0, 0.0)),
        span_s=(0.0, 1000.0),
    )
    assert said in left_sentences(whole)[0]


def test_a_drift_that_grows_in_outages_is_advised_against() -> None:
    better = outage_sentence(OutageDrift(10.0, 14.3, 10), OutageDrift(10.0, 11.2, 10))
    worse = outage_sentence(OutageDrift(10.0, 2.55, 2), OutageDrift(10.0, 6.59, 2))
    assert "keep what was assumed" not in better
    assert worse.endswith("for outages keep what was assumed, until a log with more of them says otherwise")

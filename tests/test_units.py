"""Proves that units are converted by their definitions, compared by dimension, and refused in words.

Expected factors come from the SI brochure (minute, hour, degree), from the standard acceleration of
free fall (9.80665 m/s^2, CGPM 1901) and from the gauss, 1e-4 T: never from the code under test.
"""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kfgen.core.errors import InputError
from kfgen.core.units import derived_unit, display_unit, from_si, parse_quantity, parse_unit, to_si

DEG = math.pi / 180.0
G = 9.80665

FACTORS = [
    ("", 1.0),
    ("1", 1.0),
    ("deg", DEG),
    ("rev", 2.0 * math.pi),
    ("arcmin", DEG / 60.0),
    ("arcsec", DEG / 3600.0),
    ("min", 60.0),
    ("ms", 1e-3),
    ("h", 3600.0),
    ("kHz", 1e3),
    ("dps", DEG),
    ("mdps", 1e-3 * DEG),
    ("deg/h", DEG / 3600.0),
    ("rev/min", 2.0 * math.pi / 60.0),
    ("g", G),
    ("mg", 1e-3 * G),
    ("ug", 1e-6 * G),
    ("g/16384", G / 16384.0),
    ("deg/s/131", DEG / 131.0),
    ("0.01*deg/s", 0.01 * DEG),
    ("Gal", 0.01),
    ("mGal", 1e-5),
    ("km/h", 1.0 / 3.6),
    ("cm", 0.01),
    ("m/s^2", 1.0),
    ("uT", 1e-6),
    ("nT", 1e-9),
    ("G", 1e-4),
    ("mG", 1e-7),
    ("hPa", 100.0),
    ("kPa", 1000.0),
    ("%", 0.01),
    ("ppm", 1e-6),
    ("kg", 1.0),
    ("N m", 1.0),
    ("deg/sqrt(h)", DEG / 60.0),
    ("deg/h/sqrt(Hz)", DEG / 3600.0),
    ("deg/s/sqrt(Hz)", DEG),
    ("mg/sqrt(Hz)", 1e-3 * G),
    ("m/s/sqrt(h)", 1.0 / 60.0),
    ("deg/h^1.5", DEG / 3600.0**1.5),
    ("deg/h^(3/2)", DEG / 3600.0**1.5),
    ("rad s^-1", 1.0),
    ("km h^-1", 1.0 / 3.6),
    ("m s-2", 1.0),
    ("m\N{MIDDLE DOT}s\N{SUPERSCRIPT MINUS}\N{SUPERSCRIPT TWO}", 1.0),
    ("rpm", 2.0 * math.pi / 60.0),
    ("mbar", 100.0),
    ("Ohm", 1.0),
    ("deg/hr", DEG / 3600.0),
    ("deg/sec", DEG),
]


@pytest.mark.parametrize(("text", "factor"), FACTORS)
def test_factor_to_si_is_the_definition(text: str, factor: float) -> None:
    assert parse_unit(text).factor == pytest.approx(factor, rel=1e-14)


SAME = [
    ("deg/s/sqrt(s)", "deg/s^2/sqrt(Hz)"),
    ("deg/s/sqrt(s)", "deg/s^1.5"),
    ("deg/s/sqrt(Hz)", "deg/sqrt(s)"),
    ("60*deg/sqrt(h)", "deg/s/sqrt(Hz)"),
    ("m/s^2/sqrt(Hz)", "m/s/sqrt(s)"),
    ("m/s^2/sqrt(Hz)", "60 m/s/sqrt(h)"),
    ("N", "kg*m/s^2"),
    ("m/s2", "m/s^2"),
    ("m/s²", "m/s^2"),
    ("kg m2", "kg*m^2"),
    ("°/s", "deg/s"),
    ("°/√h", "deg/sqrt(h)"),
    ("µT", "uT"),
    ("\N{GREEK SMALL LETTER MU}g/√Hz", "ug/sqrt(Hz)"),
    ("ohm", "V/A"),
    ("Pa", "N/m^2"),
    ("J", "N m"),
    ("W", "V*A"),
    ("T", "V*s/m^2"),
    ("dps", "deg/s"),
    ("LSB", "count"),
    ("1/s", "Hz"),
    ("deg/(s*sqrt(Hz))", "deg/s/sqrt(Hz)"),
    ("sqrt(m^2)", "m"),
    ("(m/s)/s", "m/s^2"),
    (" deg / s ", "deg/s"),
]


@pytest.mark.parametrize(("one", "other"), SAME)
def test_equal_units_are_one_unit(one: str, other: str) -> None:
    a, b = parse_unit(one), parse_unit(other)
    assert a.same_dimension(b)
    assert a.factor == pytest.approx(b.factor, rel=1e-14)


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("deg/s", "deg"),
        ("rad", "1"),
        ("rad/s", "Hz"),
        ("count", "1"),
        ("deg/sqrt(h)", "deg/h"),
        ("deg/s/sqrt(Hz)", "deg/s*sqrt(Hz)"),
        ("g", "kg"),
        ("m/s^2", "m/s"),
        ("T", "K"),
    ],
)
def test_other_quantities_are_not_confused(one: str, other: str) -> None:
    assert not parse_unit(one).same_dimension(parse_unit(other))


@pytest.mark.parametrize(
    ("unit", "si"),
    [
        ("deg/s", "rad/s"),
        ("mg", "m/s^2"),
        ("uT", "T"),
        ("kHz", "Hz"),
        ("degC", "K"),
        ("hPa", "Pa"),
        ("N m", "N m"),
        ("V", "V"),
        ("%", "1"),
    ],
)
def test_si_names_the_coherent_unit(unit: str, si: str) -> None:
    assert parse_unit(unit).si == si


@pytest.mark.parametrize("unit", [text for text, _ in FACTORS])
def test_the_si_text_is_itself_a_unit_of_the_same_dimension(unit: str) -> None:
    parsed = parse_unit(unit)
    si = parse_unit(parsed.si)
    assert si.same_dimension(parsed)
    assert si.factor == 1.0


def test_degrees_celsius_have_an_offset_of_their_own_only() -> None:
    assert to_si(25.0, "degC") == pytest.approx(298.15, abs=1e-12)
    assert from_si(273.15, "degC") == pytest.approx(0.0, abs=1e-12)
    assert to_si(25.0, "degC/s") == 25.0
    for spelling in ("°C", "° C", "deg C", "degrees C", "degrees Celsius"):
        assert to_si(25.0, spelling) == pytest.approx(298.15, abs=1e-12)
    assert parse_unit(derived_unit("U/sqrt(Hz)", "°C")).same_dimension(parse_unit("K*sqrt(s)"))
    assert to_si(25.0, "m/degC") == 25.0


BAD_UNITS = [
    "furlong",
    "deg/",
    "/s",
    "deg//s",
    "sqrt(s",
    "sqrt s",
    "(deg/s",
    "deg/s)",
    "deg^",
    "deg^x",
    "deg^(1/0)",
    "()",
    "0*deg",
    "deg/0",
    "1e400*deg",
    "deg;s",
    "deg/s^-",
    "__import__('os')",
    "mdegC",
    "kmin",
    "h^99999",
    "s^1e9999",
    "s^(1/99999)^99999999",
    "1e300*1e300*deg",
    "m/(1e-200*1e-200)",
]


@pytest.mark.parametrize("text", BAD_UNITS)
def test_what_is_no_unit_is_refused_with_an_example(text: str) -> None:
    with pytest.raises(InputError) as caught:
        parse_unit(text)
    assert f"'{text}'" in caught.value.what
    assert "deg/s" in caught.value.remedy


def test_deep_nesting_is_refused_like_any_other_text() -> None:
    with pytest.raises(InputError):
        parse_unit("(" * 20000 + "s" + ")" * 20000)


QUANTITIES = [
    ("0.0035 deg/s/sqrt(Hz)", "rad/s/sqrt(Hz)", 0.0035 * DEG),
    ("0.21 deg/sqrt(h)", "deg/s/sqrt(Hz)", 0.21 / 60.0 * DEG),
    ("1e-4 deg/s^1.5", "deg/s/sqrt(s)", 1e-4 * DEG),
    ("-2 mg", "m/s^2", -2e-3 * G),
    ("+.5 h", "s", 1800.0),
    ("100s", "s", 100.0),
    ("19.6 1/s^2", "1/s^2", 19.6),
    ("25 degC", "K", 298.15),
    ("4", "deg", 4.0),
    (4, "deg", 4.0),
    (0.25, "deg/s", 0.25),
    ("3 %", "1", 0.03),
]


@pytest.mark.parametrize(("value", "wanted", "si"), QUANTITIES)
def test_a_text_carries_its_unit_and_a_bare_number_is_si(value: object, wanted: str, si: float) -> None:
    assert parse_quantity(value, wanted) == pytest.approx(si, rel=1e-14)


@pytest.mark.parametrize(
    ("value", "said"),
    [
        ("1 m", "dimension"),
        ("1 deg", "dimension"),
        ("1 deg/s/sqrt(Hz)", "dimension"),
        ("deg/s", "begin with a number"),
        ("", "begin with a number"),
        ("nan deg/s", "begin with a number"),
        ("1.5.2 deg/s", "1.5.2"),
        ("1 furlong", "furlong"),
        ("1e999 deg/s", "finite"),
        (math.nan, "finite"),
        (math.inf, "finite"),
        (-math.inf, "finite"),
        (True, "True"),
        (None, "None"),
        ([1.0], "[1.0]"),
    ],
)
def test_what_is_no_quantity_is_refused(value: object, said: str) -> None:
    with pytest.raises(InputError) as caught:
        parse_quantity(value, "deg/s", where="noise.toml: [gyro_x]")
    assert said in str(caught.value)


@pytest.mark.parametrize("value", ["1 m", "x", True, math.nan, "1 furlong"])
def test_a_refused_quantity_says_where_it_stands(value: object) -> None:
    with pytest.raises(InputError) as caught:
        parse_quantity(value, "deg/s", where="noise.toml: [gyro_x]")
    assert str(caught.value).startswith("noise.toml: [gyro_x]: ")


@pytest.mark.parametrize("value", ["1e308 h", pytest.param(10**400, id="10**400")])
def test_a_quantity_too_large_for_a_float_is_refused(value: object) -> None:
    with pytest.raises(InputError):
        parse_quantity(value, "s")


@pytest.mark.parametrize(
    ("template", "unit", "meant"),
    [
        ("U/sqrt(Hz)", "deg/s", "deg/s/sqrt(Hz)"),
        ("U/sqrt(Hz)", "g/16384", "g/sqrt(Hz)/16384"),
        ("U/sqrt(Hz)", "deg/s/131", "deg/s/sqrt(Hz)/131"),
        ("U/sqrt(Hz)", "0.01*deg/s", "deg/s/sqrt(Hz)*0.01"),
        ("U*s", "0.1*uT", "uT*s/10"),
        ("U*s", "deg/s", "deg"),
        ("U/K", "m/s^2", "m/s^2/K"),
        ("U/s", "km/h", "km/h/s"),
        ("U/sqrt(s)", "m*s", "m*s^(1/2)"),
        ("U", "mg", "mg"),
        ("U/sqrt(Hz)", "1", "1/sqrt(Hz)"),
        ("U/sqrt(Hz)", "", "1/sqrt(Hz)"),
        ("s", "deg/s", "s"),
    ],
)
def test_derived_unit_means_the_template_with_the_channel_unit_in_it(
    template: str, unit: str, meant: str
) -> None:
    found, expected = parse_unit(derived_unit(template, unit)), parse_unit(meant)
    assert found.same_dimension(expected)
    assert found.factor == pytest.approx(expected.factor, rel=1e-13)


@pytest.mark.parametrize(
    ("unit", "shown"),
    [
        ("deg/s", "deg/s"),
        ("rad/s", "deg/s"),
        ("deg/s/131", "deg/s"),
        ("m/s^2", "m/s^2"),
        ("g", "mg"),
        ("g/16384", "mg"),
        ("mg", "mg"),
        ("T", "uT"),
        ("uT/10", "uT"),
        ("degC", "degC"),
        ("hPa", "hPa"),
    ],
)
def test_a_person_reads_his_own_unit_or_the_usual_one(unit: str, shown: str) -> None:
    assert display_unit(unit) == shown


@settings(max_examples=200, deadline=None)
@given(st.floats(-1e12, 1e12, allow_subnormal=False), st.sampled_from([t for t, _ in FACTORS if t != "degC"]))
def test_there_and_back(value: float, unit: str) -> None:
    assert from_si(to_si(value, unit), unit) == pytest.approx(value, rel=1e-14, abs=1e-300)


@settings(max_examples=100, deadline=None)
@given(st.floats(-1e6, 1e6), st.sampled_from(["deg/s", "mg", "uT", "deg/sqrt(h)", "g/16384", "%"]))
def test_a_written_quantity_is_read_again(value: float, unit: str) -> None:
    assert parse_quantity(f"{value!r} {unit}", unit) == pytest.approx(to_si(value, unit), rel=1e-15)


@settings(max_examples=300, deadline=None)
@given(st.text("degsmhHzsqrt()^/*. 0129%K", max_size=16))
def test_any_text_is_a_unit_or_an_input_error(text: str) -> None:
    try:
        unit = parse_unit(text)
    except InputError:
        return
    assert math.isfinite(unit.factor)
    assert unit.factor > 0.0

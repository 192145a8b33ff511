"""Proves that a noise file says what it means, survives being written, and is refused where it is wrong.

A file is text from anywhere: nothing in it is executed, and no text in it, however unusual, may come out as
another model than went in.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import Result

from kfgen.core.errors import InputError
from kfgen.effects import Effect, catalogue, make
from kfgen.effects.noise_model import (
    FORMAT,
    ChannelNoise,
    NoiseModel,
    Term,
    canonical,
    noise_text,
    parse_noise,
    read_noise,
    write_noise,
)
from kfgen.model.library import build

DEG = math.pi / 180.0


def document(effects: str, unit: str = "deg/s", head: str = "", channel: str = "gyro_x") -> str:
    return f'format = "{FORMAT}"\n{head}\n[{channel}]\nunit = "{unit}"\neffects = [{effects}]\n'


def one(effects: str, unit: str = "deg/s") -> Effect:
    (effect,) = parse_noise(document(effects, unit), "n.toml").channel("gyro_x").effects
    return effect


def model(
    *effects: Effect, unit: str = "deg/s", ci95: Mapping[str, tuple[float, float]] | None = None
) -> NoiseModel:
    return NoiseModel({"gyro_x": ChannelNoise(unit, tuple(Term(e, ci95 or {}) for e in effects))})


def full() -> NoiseModel:
    gyro = (
        Term(make("white_noise", N=6.1234567891234e-5), {"N": (6.0e-5, 6.2e-5)}),
        Term(make("gauss_markov", sigma=3.3e-5, tau=123.456789012), {"tau": (100.0, 200.0)}),
        Term(make("rate_ramp", R=-1.0e-9), {"R": (-2.0e-9, 1.0e-10)}),
    )
    accel = (Term(make("white_noise", N=1e-3 / 3.0)), Term(make("rate_random_walk", K=2e-5)))
    return NoiseModel(
        {"gyro_x": ChannelNoise("deg/s", gyro), "accel_z": ChannelNoise("g/16384", accel)},
        {"log": "a.csv", "sha256": "0" * 64},
    )


# Meaning.


@pytest.mark.parametrize(
    ("text", "name", "si"),
    [
        ('{effect="white_noise", N="0.0035 deg/s/sqrt(Hz)"}', "N", 0.0035 * DEG),
        ('{effect="white_noise", N="0.21 deg/sqrt(h)"}', "N", 0.0035 * DEG),
        ('{effect="white_noise", N="0.0035"}', "N", 0.0035),
        ('{effect="white_noise", N=6.1e-5}', "N", 6.1e-5),
        ('{effect="white_noise", N=1}', "N", 1.0),
        ('{effect="gauss_markov", sigma="7.2 deg/h", tau="2 min"}', "sigma", 0.002 * DEG),
        ('{effect="gauss_markov", sigma="7.2 deg/h", tau="2 min"}', "tau", 120.0),
        ('{effect="rate_random_walk", K="1e-4 deg/s/sqrt(s)"}', "K", 1e-4 * DEG),
        ('{effect="rate_random_walk", K="1e-4 deg/s^2/sqrt(Hz)"}', "K", 1e-4 * DEG),
        ('{effect="rate_ramp", R="-3.6 deg/s/h"}', "R", -1e-3 * DEG),
        ('{effect="quantisation", Q="1 arcsec"}', "Q", DEG / 3600.0),
        ('{effect="temperature", coefficient="-0.01 deg/s/K"}', "coefficient", -0.01 * DEG),
        ('{effect="temperature", coefficient=0, reference="25 degC"}', "reference", 298.15),
    ],
)
def test_values_are_read_in_their_units(text: str, name: str, si: float) -> None:
    assert getattr(one(text), name) == pytest.approx(si, rel=1e-14)


def test_the_unit_of_raw_counts_may_be_used() -> None:
    effect = one('{effect="white_noise", N="2 g/16384/sqrt(Hz)"}', unit="g/16384")
    assert vars(effect)["N"] == pytest.approx(2 * 9.80665 / 16384, rel=1e-14)


def test_an_amplitude_in_degrees_celsius_has_no_offset() -> None:
    effect = one('{effect="gauss_markov", sigma="0.05 degC", tau="100 s"}', unit="degC")
    assert vars(effect)["sigma"] == pytest.approx(0.05, rel=1e-12)


def test_intervals_are_read_in_their_units() -> None:
    text = '{effect="white_noise", N="2 deg/sqrt(h)", N_ci95=["1 deg/sqrt(h)", "3 deg/sqrt(h)"]}'
    (term,) = parse_noise(document(text), "n.toml").channel("gyro_x").terms
    assert term.ci95["N"] == pytest.approx((DEG / 60, 3 * DEG / 60), rel=1e-14)


def test_effect_tables_and_inline_effects_are_the_same() -> None:
    inline = parse_noise(document('{effect="white_noise", N="1 deg/s/sqrt(Hz)"}'), "a")
    tables = parse_noise(
        f'format="{FORMAT}"\n[gyro_x]\nunit="deg/s"\n[[gyro_x.effects]]\neffect="white_noise"\n'
        'N="1 deg/s/sqrt(Hz)"\n',
        "b",
    )
    assert inline == tables


def test_channels_keep_their_order() -> None:
    text = f'format="{FORMAT}"\n' + "".join(f'[{c}]\nunit="m"\n' for c in ("z", "a", "m"))
    assert list(parse_noise(text, "n").channels) == ["z", "a", "m"]


def test_a_channel_that_is_not_there_names_those_that_are() -> None:
    with pytest.raises(InputError, match=r"'gyro_y'.*gyro_x, accel_z"):
        full().channel("gyro_y")


# Written and read.


def test_a_model_is_written_and_read_again(tmp_path: Path) -> None:
    write_noise(full(), tmp_path / "n.toml")
    again = read_noise(tmp_path / "n.toml")
    assert again.provenance == full().provenance
    assert list(again.channels) == list(full().channels)
    for name, channel in full().channels.items():
        assert again.channels[name].unit == channel.unit
        for term, read in zip(channel.terms, again.channels[name].terms, strict=True):
            assert read.effect.name == term.effect.name
            for p in term.effect.parameters():
                wanted = getattr(term.effect, p.name)
                assert getattr(read.effect, p.name) == pytest.approx(wanted, rel=1e-8)
            assert set(read.ci95) == set(term.ci95)
            for p_name, pair in term.ci95.items():
                assert read.ci95[p_name] == pytest.approx(pair, rel=1e-8)


@pytest.mark.parametrize("name", sorted(catalogue()))
def test_every_effect_survives_in_every_kind_of_unit(name: str) -> None:
    effect = make(name, **{p.name: 0.375 + k for k, p in enumerate(catalogue()[name].parameters())})
    for unit in ("deg/s", "g/16384", "m/s^2", "0.01*deg/s", "degC", "1", ""):
        (again,) = parse_noise(noise_text(model(effect, unit=unit)), "n.toml").channel("gyro_x").effects
        for p in effect.parameters():
            assert getattr(again, p.name) == pytest.approx(getattr(effect, p.name), rel=1e-6)


def test_only_the_file_is_left_in_the_folder(tmp_path: Path) -> None:
    write_noise(full(), tmp_path / "n.toml")
    assert [p.name for p in tmp_path.iterdir()] == ["n.toml"]


def test_canonical_is_idempotent() -> None:
    once = canonical(full())
    assert canonical(once) == once
    assert noise_text(once) == noise_text(full())


@settings(max_examples=60, deadline=None)
@given(st.floats(1e-9, 1e3), st.sampled_from(["deg/s", "g/16384", "mg", "rad/s", "uT"]))
def test_canonical_is_idempotent_for_any_number(value: float, unit: str) -> None:
    once = canonical(model(make("white_noise", N=value), unit=unit))
    assert canonical(once) == once


def test_a_model_has_the_same_hash_before_and_after_its_noise_is_written(tmp_path: Path) -> None:
    noise = NoiseModel({"gyro_x": full().channel("gyro_x")})
    write_noise(noise, tmp_path / "n.toml")
    assert build("gyro-static", noise).hash == build("gyro-static", read_noise(tmp_path / "n.toml")).hash


def test_another_number_gives_another_hash() -> None:
    a, b = (
        build("gyro-static", model(make("white_noise", N=n), make("rate_ramp", R=n))) for n in (1e-3, 2e-3)
    )
    assert a.hash != b.hash


UNUSUAL = {
    "quotes": 'the "best" log',
    "backslash": "C:\\logs\\new\\u0041.csv",
    "umlaut": "Prüfstand µ°",
    "chinese": "传感器",
    "emoji": "🛰️",
    "newline": "two\nlines\r\n\tand a tab",
    "control": "\x00\x07\x1b[31m\x7f\x85",
    "toml": '"\n[gyro_x]\nunit = "m"\n#',
    "invisible": "a\u200b\u2028b",
    "beyond the base plane": "a\U000e0001b",
    "empty": "",
}


@pytest.mark.parametrize("case", UNUSUAL)
def test_any_text_survives_in_the_provenance(case: str, tmp_path: Path) -> None:
    noise = NoiseModel(full().channels, {"log": UNUSUAL[case]})
    write_noise(noise, tmp_path / "n.toml")
    again = read_noise(tmp_path / "n.toml")
    assert again.provenance["log"] == UNUSUAL[case]
    assert list(again.channels) == list(noise.channels)


@settings(max_examples=100, deadline=None)
@given(st.text(st.characters(exclude_categories=["Cs"]), max_size=30))
def test_any_unicode_survives_in_the_provenance(text: str) -> None:
    again = parse_noise(noise_text(NoiseModel(full().channels, {"log": text})), "n")
    assert again.provenance["log"] == text


def test_the_name_of_a_log_that_is_no_unicode_leaves_a_readable_file() -> None:
    """A file name of other bytes reaches Python as lone surrogates, which TOML cannot hold."""
    text = noise_text(NoiseModel(full().channels, {"log": "b\udcff.csv"}))
    assert list(parse_noise(text, "n").channels) == list(full().channels)


@pytest.mark.parametrize("key", ["log name", "a.b", "log-name", 'a"b', "größe"])
def test_any_key_of_a_provenance_that_was_read_can_be_written(key: str) -> None:
    quoted = '"' + key.replace('"', '\\"') + '"'
    noise = parse_noise(document("", head=f"[provenance]\n{quoted} = 'x'"), "n.toml")
    assert parse_noise(noise_text(noise), "again").provenance == {key: "x"}


# Refused.


BAD = {
    "no toml": ("format = ", "TOML"),
    "cut off": (document("")[:-3], "TOML"),
    "key twice": (document("") + 'unit = "m"\n', "TOML"),
    "channel twice": (document("") + '[gyro_x]\nunit = "m"\n', "TOML"),
    "a csv": ("t [s],a [m]\n0,1\n", "TOML"),
    "no format": ('[gyro_x]\nunit="deg/s"\n', "format"),
    "another format": ('format = "kfgen-model-1"\n[gyro_x]\nunit="deg/s"\n', "kfgen-model-1"),
    "format a number": ("format = 1\n", "format"),
    "empty": ("", "format"),
    "no channel": (f'format = "{FORMAT}"\n', "no channel"),
    "no unit": (f'format = "{FORMAT}"\n[gyro_x]\neffects = []\n', "unit"),
    "unit a number": (f'format = "{FORMAT}"\n[gyro_x]\nunit = 3\n', "unit"),
    "unknown unit": (document("", unit="furlong"), "furlong"),
    "effects a text": (f'format = "{FORMAT}"\n[gyro_x]\nunit="m"\neffects = "white"\n', "list"),
    "effects of texts": (f'format = "{FORMAT}"\n[gyro_x]\nunit="m"\neffects = ["white"]\n', "list"),
    "provenance a text": (document("", head="provenance = 'me'"), "provenance"),
    "provenance a number": (document("", head="provenance = 3"), "provenance"),
    "no name": (document('{N="1 deg/s/sqrt(Hz)"}'), "effect"),
    "name a number": (document("{effect=3}"), "effect"),
    "unknown effect": (document('{effect="gremlins"}'), "gremlins"),
    "unknown parameter": (document('{effect="white_noise", N=1, M=2}'), "'M'"),
    "missing parameter": (document('{effect="gauss_markov", sigma=1}'), "'tau'"),
    "no parameter": (document('{effect="white_noise"}'), "'N'"),
    "other dimension": (document('{effect="white_noise", N="1 deg/s"}'), "dimension"),
    "unknown value unit": (document('{effect="white_noise", N="1 furlong"}'), "furlong"),
    "word": (document('{effect="white_noise", N="much"}'), "much"),
    "true": (document('{effect="white_noise", N=true}'), "True"),
    "list": (document('{effect="white_noise", N=[1]}'), "[1]"),
    "nan": (document('{effect="white_noise", N=nan}'), "finite"),
    "inf": (document('{effect="white_noise", N=inf}'), "finite"),
    "negative": (document('{effect="white_noise", N="-1 deg/s/sqrt(Hz)"}'), "positive"),
    "time negative": (document('{effect="gauss_markov", sigma=1, tau=-1}'), "positive"),
    "time zero": (document('{effect="gauss_markov", sigma=1, tau=0}'), "positive"),
    "integer beyond a float": (document(f'{{effect="white_noise", N={10**400}}}'), ""),
    "integer of 5000 digits": (document(f'{{effect="white_noise", N={"9" * 5000}}}'), ""),
    "interval of another dimension": (
        document('{effect="white_noise", N=1, N_ci95=["1 m", "2 m"]}'),
        "dimension",
    ),
    "nested deeply": ("a = " + "[" * 20000, ""),
}


@pytest.mark.parametrize("case", BAD)
def test_a_wrong_file_is_refused_with_its_name(case: str, tmp_path: Path) -> None:
    text, said = BAD[case]
    path = tmp_path / "n.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as caught:
        read_noise(path)
    assert said in caught.value.what + caught.value.where
    assert caught.value.where.startswith(str(path))


@pytest.mark.parametrize(
    "case",
    ["unknown unit", "unknown parameter", "missing parameter", "word", "negative", "unknown value unit"],
)
def test_a_wrong_entry_is_located_by_its_channel(case: str) -> None:
    with pytest.raises(InputError) as caught:
        parse_noise(BAD[case][0], "n.toml")
    assert "[gyro_x]" in caught.value.where


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file") as caught:
        read_noise(tmp_path / "gone.toml")
    assert caught.value.where == str(tmp_path / "gone.toml")


@pytest.mark.parametrize("content", [b"\xff\xfe\x00\x01", b"format = '\x80'", bytes(range(256))])
def test_a_file_that_is_no_text_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "n.toml"
    path.write_bytes(content)
    with pytest.raises(InputError) as caught:
        read_noise(path)
    assert caught.value.where == str(path)


@pytest.mark.parametrize(
    "name",
    ["gyro x", "gyro-x", "1x", "", "a;b", "a\\nb", 'a\\"b', "a]", "a[b", "x]\\n[b", "x*y", "../x", "a.b"],
)
def test_a_channel_name_that_is_no_identifier_is_refused(name: str) -> None:
    with pytest.raises(InputError) as caught:
        parse_noise(document("", channel=f'"{name}"'), "n.toml")
    assert caught.value.where.startswith("n.toml: [")


@pytest.mark.parametrize("name", ["gyro_ü", "传感器", "lambda", "class", "_", "x1", "provenance_2"])
def test_a_channel_name_is_refused_or_survives(name: str) -> None:
    try:
        noise = parse_noise(document("", channel=f'"{name}"'), "n.toml")
    except InputError:
        return
    assert list(canonical(noise).channels) == [name]


@pytest.mark.parametrize("name", ["", "gyro x", "a.b", "a]\n[b", "format", "provenance"])
def test_a_file_that_could_not_be_read_again_is_not_written(name: str, tmp_path: Path) -> None:
    noise = NoiseModel({name: full().channel("gyro_x")})
    try:
        write_noise(noise, tmp_path / "n.toml")
    except InputError:
        assert not list(tmp_path.iterdir())
        return
    assert list(read_noise(tmp_path / "n.toml").channels) == [name]


HOSTILE = [
    "__import__('os').mkdir('owned')",
    "exec(\\\"open('owned','w')\\\")",
    "$(mkdir owned)",
    "`mkdir owned`",
    "{{ ''.__class__.__mro__ }}",
    "1; import os; os.mkdir('owned')",
]


@pytest.mark.parametrize("text", HOSTILE)
@pytest.mark.parametrize("place", ["value", "unit", "effect", "parameter", "channel"])
def test_hostile_text_is_refused_and_never_executed(
    text: str, place: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    documents = {
        "value": document(f'{{effect="white_noise", N="{text}"}}'),
        "unit": document("", unit=text),
        "effect": document(f'{{effect="{text}"}}'),
        "parameter": document(f'{{effect="white_noise", "{text}"=1}}'),
        "channel": document("", channel=f'"{text}"'),
    }
    with pytest.raises(InputError):
        parse_noise(documents[place], "n.toml")
    assert not list(tmp_path.iterdir())


def test_what_a_noise_file_does_not_say_is_said(tmp_path: Path, kfgen: Callable[..., Result]) -> None:
    """A file of one gyro axis: the others and the sensors keep the model's figures, and every command says so."""
    path = tmp_path / "gx.toml"
    path.write_text(
        f'format = "{FORMAT}"\n[gyro_x]\nunit = "deg/s"\neffects = [{{ effect = "white_noise", N = 0.005 }}]\n'
    )
    for words in (["derive", "ahrs6"], ["emit", "ahrs6", "--target", "numpy", "-o", tmp_path / "out"]):
        answer = kfgen(*words, "--noise", path)
        assert answer.exit_code == 0
        assert "the noise has no white noise of gyro_y, gyro_z: the model's typical figures" in answer.output
        assert "no white noise of accel, mag: the model's own standard deviations" in answer.output
    assert "white noise of" not in kfgen("derive", "ahrs6").output

"""The law, at rest: an effect of a noise file is named where the file lacks it, and is no gap where the file has it.

The effects are those that the catalogue declares for records at rest: they say where a fit begins, how they are found
or what fault the samples show. All others are exceptions, each with its reason, and a record at rest shows nothing of
them. Logs are simulated from noise files. Seeds are fixed; a wrong answer by chance has a rate of 0.1 % a test (the
family-wise rate of the tests of what is left).
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
from in_part import in_part
from strong_effects import (
    ABSTRACT,
    AT_REST,
    EVERY,
    INERTIAL,
    PLANT,
    REFERENCE,
    REST_DURATION_S,
    REST_RATE_HZ,
    SD,
    Strong,
)

import kfgen as kf
from kfgen.core.errors import InputError
from kfgen.effects import Effect, catalogue, make
from kfgen.effects.effect import AddsNothingAtRest
from kfgen.effects.faults.reference import ReferenceFault
from kfgen.effects.faults.samples import Fault
from kfgen.effects.inertial.inertial_error import InertialError
from kfgen.effects.noise_model import ChannelNoise, NoiseModel, Term, noise_text, parse_noise
from kfgen.effects.plant.terms import PlantEffect
from kfgen.gap.result import GapResult
from kfgen.log.log import Log

CHANNEL = "gyro_x"
SEED = 1
WHITE = make("white_noise", N=SD / REST_RATE_HZ**0.5)
OF_ITS_SIZE = {"white_noise", "sample_noise"}
"""White noise beside white noise is noise of another size: its number is estimated again."""
OF_SAMPLES = {"stuck"}
"""Found among the samples before any model, by `kfgen.gap.rest.bad_samples`."""
DESCRIBED = {"sensor_response"}
"""Described by identify; in a log it is a low-pass to the gap: see test_sensor_response."""
REASONS = {
    "bias": "a constant of a record at rest is fitted freely, whatever it is",
    "sign_error": "of noise about an unknown constant nothing shows its sign",
    "axis_swap": "of one channel at rest nothing shows which axis it reads",
    "too_early": "a stationary noise that is shifted is the same noise",
    "cross_axis_noise": "it is of two channels: see test_noise_that_two_channels_share_is_named",
}
"""Effects of a channel that a record of it at rest cannot show, and why."""
FAMILIES = (
    (ReferenceFault, "a record at rest has no reference"),
    (PlantEffect, "it acts inside a plant: see test_effects_in_plants"),
    (InertialError, "it acts where a sensor moves: see test_effects_in_the_gap"),
)
"""Families that a record at rest cannot show, and why."""
NAMED_SLOWLY = {
    *(
        "warm_up",
        "resonance",
        "low_pass",
        "gauss_markov",
        "noise_temperature",
        "thermal_lag",
        "temperature_rate",
    ),
    *(
        "rate_ramp",
        "supply_current",
        "temperature_squared",
        "air_pressure",
        "humidity",
        "supply_voltage",
        "rate_random_walk",
        "random_telegraph",
        "power_law_noise",
        "thermal_hysteresis",
        "bias_instability",
        "periodic_wave",
    ),
}
QUICK_AND_LONG = [pytest.param(s, marks=pytest.mark.long if s.name in NAMED_SLOWLY else []) for s in AT_REST]


def says(cls: type[Effect]) -> bool:
    """Whether an effect says how a record at rest shows it."""
    return any(
        getattr(cls, n).__func__ is not getattr(Effect, n).__func__
        for n in ("starts", "detect", "detect_fault")
    )


def file_of(*effects: Effect) -> NoiseModel:
    """The noise file of a gyro with white noise and these effects."""
    noise = ChannelNoise("rad/s", tuple(map(Term, (WHITE, *effects))))
    return parse_noise(noise_text(NoiseModel({CHANNEL: noise})), "noise.toml")


@lru_cache
def log_of(*effects: Effect) -> Log:
    """A log at rest that is simulated from that file."""
    return kf.simulate("gyro-static", "static", REST_DURATION_S, REST_RATE_HZ, SEED, noise=file_of(*effects))


def spoils(found: GapResult) -> bool:
    return found.verdict == "bad_data"


def label(value: object) -> str:
    return value.name if isinstance(value, Strong) else str(value)


def test_every_effect_that_a_record_at_rest_can_show_is_tried_and_no_other() -> None:
    """And no exception is stale: none of them says how a record at rest shows it."""
    known = {n: c for n, c in catalogue().items() if n not in ABSTRACT}
    tried = {s.name for s in AT_REST}
    shown = {n for n, c in known.items() if says(c)}
    assert tried == shown | OF_ITS_SIZE | OF_SAMPLES
    of_families = {n for n, c in known.items() if issubclass(c, tuple(f for f, _ in FAMILIES))}
    assert set(REASONS) <= set(known) - shown - of_families
    assert tried | set(REASONS) | of_families | DESCRIBED == set(known)
    assert not tried & (set(REASONS) | of_families | DESCRIBED)
    assert tried >= NAMED_SLOWLY


@pytest.mark.parametrize("strong", QUICK_AND_LONG, ids=label)
def test_an_effect_that_the_noise_file_lacks_is_named(strong: Strong) -> None:
    """Alone; or as noise of another size. Of a fault that spoils the samples nothing else is said."""
    found = kf.find_gap(log_of(strong.effect), file_of())
    if strong.name in OF_ITS_SIZE:
        assert (found.verdict, found.findings) == ("effects_found", ())
        assert found.comparisons[0].retuned
        return
    assert [(f.name, f.where) for f in found.findings] == [(strong.name, CHANNEL)]
    faulty = isinstance(strong.effect, Fault)
    assert found.verdict == "effects_found" or (faulty and spoils(found))


@pytest.mark.parametrize("strong", QUICK_AND_LONG, ids=label)
def test_an_effect_that_the_noise_file_has_is_no_gap(strong: Strong) -> None:
    """A fault that spoils the samples is said again: no model of noise can have it."""
    found = kf.find_gap(log_of(strong.effect), file_of(strong.effect))
    if isinstance(strong.effect, Fault) and spoils(kf.find_gap(log_of(strong.effect), file_of())):
        assert spoils(found)
        assert [f.name for f in found.findings] == [strong.name]
    else:
        assert (found.verdict, found.findings) == ("no_gap", ())


@pytest.mark.parametrize("share", [0.1, 0.3])
def test_a_channel_that_is_stuck_is_named_however_long(share: float) -> None:
    """Before: beyond a fifth of the record, a division by zero."""
    stuck = make("stuck", time=100.0, lasting=share * REST_DURATION_S)
    found = kf.find_gap(log_of(stuck), file_of())
    assert [f.name for f in found.findings] == ["stuck"]
    assert spoils(found) == (share > 0.2)


def test_a_log_of_white_noise_alone_shows_no_gap() -> None:
    found = kf.find_gap(log_of(), file_of())
    assert (found.verdict, found.findings) == ("no_gap", ())


@pytest.mark.parametrize("name", list(REASONS))
def test_what_a_record_at_rest_cannot_show_is_no_gap(name: str) -> None:
    """Its log may differ, but not in what the file says of its noise.

    A shift is by whole samples: one by a part of them is an interpolation, which smooths.
    """
    effects = {s.name: s.effect for s in EVERY} | {"too_early": make("too_early", shift=2.0 / REST_RATE_HZ)}
    assert kf.find_gap(log_of(effects[name]), file_of()).verdict == "no_gap"


@pytest.mark.parametrize("strong", [*INERTIAL, *PLANT], ids=label)
def test_what_needs_motion_or_a_plant_does_nothing_at_rest(strong: Strong) -> None:
    assert isinstance(strong.effect, tuple(f for f, _ in FAMILIES))
    assert isinstance(strong.effect, AddsNothingAtRest)
    log = log_of(strong.effect)
    away = log.values(CHANNEL) - log_of().values(CHANNEL)
    assert np.ptp(away) < 1e-9 * SD  # a constant, as of hard iron, no record at rest shows


@pytest.mark.parametrize("strong", REFERENCE, ids=label)
def test_a_fault_of_a_reference_is_refused_at_rest(strong: Strong) -> None:
    assert isinstance(strong.effect, ReferenceFault)
    with pytest.raises(InputError, match=strong.name) as refused:
        log_of(strong.effect)
    assert refused.value.remedy


@pytest.mark.parametrize(
    "rho",
    in_part(
        [
            0.3,
            pytest.param(
                0.9,
                marks=pytest.mark.xfail(
                    strict=True,
                    reason="a channel is regressed on the other, whose noise it shares: unknown_effect",
                ),
            ),
        ]
    ),
)
def test_noise_that_two_channels_share_is_named(rho: float) -> None:
    """And is no gap where the file has it. Two channels of a triad, out of a log of a filter at rest."""
    shared = make("cross_axis_noise", rho=rho)

    def noise(*effects: Effect) -> NoiseModel:
        of_one = ChannelNoise("rad/s", tuple(map(Term, (WHITE, *effects))))
        return NoiseModel({"gyro_x": of_one, "gyro_y": of_one})

    still = kf.simulate("ahrs6", "static", REST_DURATION_S, REST_RATE_HZ, SEED, noise=noise(shared))
    log = Log(still.t, {c: still.channels[c] for c in ("gyro_x", "gyro_y")})
    found = kf.find_gap(log, noise())
    assert (found.verdict, {f.name for f in found.findings}) == ("effects_found", {"cross_axis_noise"})
    assert kf.find_gap(log, noise(shared)).verdict == "no_gap"

"""Proves that faults of the samples are seen before any model, and that sound samples have none.

Every fault is far from chance: a few percent of the samples show it, which sound ones do in no seed of 20 (a single
false alarm among 100 sound records would be one of ten effects at 1e-3). Seeds are fixed.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from kfgen.core.errors import InputError
from kfgen.effects import catalogue, make
from kfgen.effects.faults.repeats import repeated_share
from kfgen.effects.faults.samples import Fault
from kfgen.effects.noise_model import ChannelNoise, Term
from kfgen.gap.rest.channel_gap import channel_gap
from kfgen.gap.rest.even_record import regular
from kfgen.gap.rest.faults import spotted_in
from kfgen.identify.evidence.record import Record
from kfgen.log.log import Channel, Log

Array = NDArray[np.float64]

N, DT = 4096, 0.1
T = np.arange(N) * DT


def assumed(scale: float = 1.0) -> ChannelNoise:
    return ChannelNoise("rad/s", (Term(make("white_noise", N=scale * np.sqrt(DT))),))


def white(seed: int, n: int = N) -> Array:
    return np.random.default_rng([seed, 51]).standard_normal(n)


def repeated(y: Array) -> Array:
    y = y.copy()
    for k in np.flatnonzero(np.random.default_rng(1).random(N) < 0.1)[1:]:
        y[k] = y[k - 1]
    return y


def stuck(y: Array) -> Array:
    """Codes of a tenth of a standard deviation whose bit 2 is never set."""
    codes = np.round(y / 0.1).astype(np.int64) + 1000
    return 0.1 * (codes & ~4)


SPOIL: dict[str, tuple[Callable[[Array], Array], str, float]] = {
    "repeated_samples": (repeated, "share", 0.1),
    "clipping": (lambda y: np.clip(y, -9.0, 1.5), "limit", 1.5),
    "coarse_quantisation": (lambda y: 2.0 * np.round(y / 2.0), "step", 2.0),
    "stuck_bit": (stuck, "bit", 2.0),
    "dead_zone": (lambda y: np.where(abs(y) < 0.3, 0.0, y), "width", 0.3),
    "unit_error": (lambda y: y * 180.0 / np.pi, "factor", 180.0 / np.pi),
}


@pytest.mark.parametrize("name", SPOIL)
def test_a_fault_that_spoils_is_said_and_nothing_is_fitted(name: str) -> None:
    wrong, parameter, value = SPOIL[name]
    gap = channel_gap("gyro_x", Record(T, wrong(white(2))), assumed())
    assert gap.verdict == "bad_data"
    assert gap.findings[0].effect.name == name
    assert float(getattr(gap.findings[0].effect, parameter)) == pytest.approx(value, rel=0.15)
    assert gap.updated.terms == assumed().terms
    assert gap.limits == ()


def jitter(t: Array) -> Array:
    return t + 0.1 * DT * np.random.default_rng(3).standard_normal(t.size)


def test_jitter_is_said_and_the_samples_are_used() -> None:
    """Steps differ by sqrt 2 of the stamps' 10 %; what is left of the record is white."""
    log = Log(jitter(T), {"gyro_x": Channel.of(white(3), "rad/s")})
    record, stamps, _ = regular(log, "gyro_x")
    gap = channel_gap("gyro_x", record, assumed(), stamps)
    assert [f.effect.name for f in gap.findings] == ["timestamp_jitter"]
    assert gap.verdict == "effects_found"
    sigma = gap.findings[0].effect.sigma  # type: ignore[attr-defined]
    assert sigma == pytest.approx(0.1 * DT, rel=4.5 / np.sqrt(N))


def lost(seed: int, share: float) -> NDArray[np.bool_]:
    keep = np.random.default_rng(seed).random(N) >= share
    keep[[0, -1]] = True
    return keep


def test_dropped_samples_are_said_and_drawn_over() -> None:
    keep, y = lost(4, 0.03), white(4)
    log = Log(T[keep], {"gyro_x": Channel.of(y[keep], "rad/s")})
    record, stamps, said = regular(log, "gyro_x")
    assert record.n == N
    np.testing.assert_allclose(record.t, T, atol=1e-6)
    np.testing.assert_allclose(record.y[keep], y[keep], atol=1e-12)
    assert [f"{N - keep.sum()} samples" in s for s in said] == [True]
    (fault,) = spotted_in(record, assumed(), stamps)
    assert fault.effect.name == "dropped_samples"
    assert not fault.spoils
    assert fault.effect.share == pytest.approx(1.0 - keep.mean(), rel=1e-9)  # type: ignore[attr-defined]
    assert fault.samples == N - keep.sum()


def test_many_dropped_samples_spoil() -> None:
    keep = lost(5, 0.3)
    log = Log(T[keep], {"gyro_x": Channel.of(white(5)[keep], "rad/s")})
    record, stamps, _ = regular(log, "gyro_x")
    assert channel_gap("gyro_x", record, assumed(), stamps).verdict == "bad_data"


def test_samples_that_are_no_numbers_are_drawn_over() -> None:
    """And are as good as dropped."""
    keep, y = lost(6, 0.02), white(6)
    holes = np.where(keep, y, np.nan)
    record, stamps, said = regular(Log(T, {"gyro_x": Channel.of(holes, "rad/s")}), "gyro_x")
    np.testing.assert_allclose(record.y, np.interp(T, T[keep], y[keep]), atol=1e-9)
    assert len(said) == 1
    assert {f.effect.name for f in spotted_in(record, assumed(), stamps)} == {"dropped_samples"}


@pytest.mark.parametrize(("share", "match"), [(0.6, "no numbers"), (1.0, "no numbers")])
def test_a_channel_of_holes_is_refused(share: float, match: str) -> None:
    y = np.where(np.arange(N) < share * N, np.nan, white(7))
    with pytest.raises(InputError, match=match):
        regular(Log(T, {"gyro_x": Channel.of(y, "rad/s")}), "gyro_x")


def test_a_log_that_pauses_is_refused() -> None:
    """Two logs in one: more is missing than there is."""
    t = np.where(T > 200.0, T + 1000.0, T)
    with pytest.raises(InputError, match="uneven"):
        regular(Log(t, {"gyro_x": Channel.of(white(8), "rad/s")}), "gyro_x")


def test_a_refusal_for_uneven_time_names_the_rate() -> None:
    """Stamps that come in packets of 20: with the rate of the sensor the same log is compared."""
    t = np.repeat(T[19::20], 20)[:N] + 1e-4 * (np.arange(t_size := N // 20 * 20) % 20)
    log = Log(t, {"gyro_x": Channel.of(white(8, t_size), "rad/s")})
    with pytest.raises(InputError, match="uneven") as refused:
        regular(log, "gyro_x")
    assert "--rate HZ" in refused.value.remedy
    mean = float(refused.value.remedy.partition("mean is ")[2].partition(" Hz")[0])
    assert mean == pytest.approx(1.0 / DT, rel=0.01)


def slow(seed: int) -> Array:
    a, w = np.exp(-DT / 5.0), np.random.default_rng([seed, 52]).standard_normal(N)
    x = np.empty(N)
    x[0] = w[0]
    for k in range(1, N):
        x[k] = a * x[k - 1] + np.sqrt(1 - a * a) * w[k]
    return x


def calibrated(seed: int) -> Array:
    """Coarse codes of two axes with slow noise, mixed by a calibration: values recur, neighbours oftener than others."""
    w = np.random.default_rng([seed, 53]).standard_normal((2, N))
    codes = np.round(lfilter([np.sqrt(0.75)], [1.0, -0.5], w, axis=1) / 0.5)
    return np.asarray(0.5 * (codes[0] + 0.013 * codes[1]))


SOUND: dict[str, Callable[[int], Array]] = {
    "white": white,
    "calibrated": calibrated,
    "coarse, calibrated": lambda s: np.round(
        np.round(white(s) / 0.9) * 0.87 + np.round(white(s + 100) / 0.9) * 0.24, 3
    ),
    "rounded twice": lambda s: 0.01 * np.round(0.0488 * np.round(white(s) / 0.0488) / 0.01),
    "slow": lambda s: white(s) + 3.0 * slow(s),
    "ADC grid": lambda s: 0.1 * np.round(white(s) / 0.1),
    "wide ADC grid": lambda s: 0.5 * np.round((white(s) + 2.0) / 0.5),
    "integral of an ADC grid": lambda s: (
        np.diff(np.round(np.cumsum(white(s, N + 1)) * DT / 0.02) * 0.02) / DT
    ),
    "offset": lambda s: white(s) + 1e4,
}


@pytest.mark.parametrize("name", SOUND)
def test_sound_samples_have_no_fault(name: str) -> None:
    for seed in range(20):
        found = spotted_in(Record(T, SOUND[name](seed)), assumed())
        assert [f.effect.name for f in found] == [], seed


@pytest.mark.parametrize("seed", range(3))
def test_samples_that_repeat_and_values_that_recur_are_distinguished(seed: int) -> None:
    """A third repeats; of sound neighbours 4 % are equal. The share within a fifth, of which chance is a tenth."""
    y, rng = calibrated(seed), np.random.default_rng([seed, 54])
    hit = rng.random(N) < 1.0 / 3.0
    hit[0] = False
    assert repeated_share(y, 0.0) == 0.0
    y = y[np.maximum.accumulate(np.where(hit, 0, np.arange(N)))]
    assert repeated_share(y, 0.0) == pytest.approx(1.0 / 3.0, rel=0.2)


def test_every_fault_has_its_test() -> None:
    faults = {n for n, cls in catalogue().items() if issubclass(cls, Fault)}
    elsewhere = {"sample_rate_error", "sign_error", "axis_swap"}  # see tests/test_gap_axes.py
    elsewhere |= {
        "other_motion",
        "reversed_attitude",
        "scalar_last_attitude",
    }  # see tests/test_gap_reference.py
    elsewhere |= {"held_reference", "stuck_reference", "rounded_reference"}  # see tests/test_gap_rounded.py
    elsewhere |= {"stuck", "too_early"}  # see tests/test_gap_wiring.py
    assert faults == {*SPOIL, "timestamp_jitter", "dropped_samples"} | elsewhere


def test_a_fault_that_is_assumed_is_said_again_only_where_it_spoils_the_samples() -> None:
    """Before: a file that had the clipping of its log was told of an unknown effect."""
    faults = (Term(make("clipping", limit=1.5)), Term(make("timestamp_jitter", sigma=1e-3)))
    noise = ChannelNoise("rad/s", (*assumed().terms, *faults))
    stamps = T + 0.1 * (T[1] - T[0]) * white(3)
    assert spotted_in(Record(T, white(2)), noise, stamps) == []
    found = spotted_in(Record(T, np.clip(white(2), -9.0, 1.5)), noise, stamps)
    assert [f.effect.name for f in found] == ["clipping"]


def gauss_markov(seed: int, tau: float) -> Array:
    """Of standard deviation one."""
    phi = np.exp(-DT / tau)
    return np.asarray(lfilter([np.sqrt(1.0 - phi**2)], [1.0, -phi], white(seed, 2 * N))[N:])


SCALED = {
    "g for m/s^2": ("m/s^2", 9.80665, 9.80665, True),
    "g for m/s^2 in a gyro": ("rad/s", 9.80665, 9.80665, False),
    "degrees for radians in an accelerometer": ("m/s^2", 180.0 / np.pi, 180.0 / np.pi, False),
    "a thousand in a magnetometer": ("T", 1e3, 1e3, True),
    "white noise alone": ("m/s^2", 9.80665, 1.0, False),
}


@pytest.mark.parametrize("name", SCALED)
def test_a_wrong_unit_scales_everything_between_units_of_its_quantity(name: str) -> None:
    """A Gauss-Markov bias as large as the white noise is scaled with it; where it is not, N of the model is wrong."""
    unit, of_white, of_slow, is_unit = SCALED[name]
    model = (make("white_noise", N=np.sqrt(DT)), make("gauss_markov", sigma=1.0, tau=20.0))
    record = Record(T, of_white * white(61) + of_slow * gauss_markov(62, 20.0))
    faults = spotted_in(record, ChannelNoise(unit, tuple(Term(e) for e in model)))
    assert ("unit_error" in {f.effect.name for f in faults}) is is_unit


def test_values_of_a_slower_sensor_that_recur_are_not_clipped() -> None:
    """Each is held over eight samples, and goes to the next within one: one in a hundred is the largest."""
    new = np.round(white(63, N // 8) / 0.8)
    y = np.repeat(new, 8) + 1e-7 * np.arange(N)
    y[::8] += 0.37 * np.concatenate([[0.0], np.diff(new)])
    y = np.where(y > 2.0, 2.3, y)  # its largest code
    assert "clipping" not in {f.effect.name for f in spotted_in(Record(T, np.round(y, 4)), assumed())}

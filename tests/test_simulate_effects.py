"""Proves that every effect of a noise file acts in a simulated log, at the size that it states.

A log with the effect is held against the log of the same seed without it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from kfgen.core.errors import InputError
from kfgen.effects import Effect, catalogue, effect_named, make
from kfgen.effects.effect import Parameter
from kfgen.effects.plant.sensor import SensorLag
from kfgen.log.log import Log
from kfgen.model.discretise import DiscreteModel
from kfgen.model.filter import FilterModel
from kfgen.model.library import build
from kfgen.simulate.channels import channel_effects
from kfgen.simulate.rates import at_every_sample, read_rates, rows_of, sensor_rates
from kfgen.simulate.simulate import simulate

RATE = 100.0
SENSORS = {"sensors": "gnss_position,gnss_velocity,barometer,mag"}
VALUES = {
    "size": 0.05, "time": 3.0, "frequency": 7.0, "corner": 5.0, "ratio": 0.4, "width": 0.2, "signed": 0.01,
    "solved": 0.05, "place": 4.0, "setting": 0.5,
}  # fmt: skip
SPECIAL: dict[str, dict[str, float]] = {
    "time_delay": {"delay": 0.03},
    "unit_error": {"factor": 1.7},
    "sample_rate_error": {"factor": 1.02},
    "noise_change": {"ratio": 3.0, "time": 4.0},
    "stuck_bit": {"bit": 3},
    "clipping": {"limit": 0.3},
    "outliers": {"share": 0.1, "sigma": 1.0},
    "hard_iron": {"x": 1e-5, "y": 2e-5, "z": 3e-6},
    "magnetic_disturbance": {"x": 1e-5, "y": 2e-5, "z": 3e-6},
    "coarse_quantisation": {"step": 0.1},
    "timestamp_jitter": {"sigma": 1e-3},
    "repeated_samples": {"share": 0.2},
    "dropped_samples": {"share": 0.2},
    "cross_axis_noise": {"rho": 0.8},
    "vibration_rectification": {"coefficient": 0.1},
    "bias_instability": {"B": 0.05},
    "power_law_noise": {"B": 0.05, "slope": 1.5},
    "intermittent_noise": {"ratio": 4.0, "share": 0.3, "lasting": 0.5},
    "low_pass": {"corner": 5.0},
}
ON_MAG = ("hard_iron", "soft_iron", "magnetic_disturbance")
OF_PLANTS = tuple(
    n for n, c in catalogue().items() if ".plant." in c.__module__ and not issubclass(c, SensorLag)
)


def bare(name: str = "ins15", **options: str) -> FilterModel:
    """Without biases, its white noise small."""
    model = build(name, None, {**SENSORS, "biases": "false", **options} if name == "ins15" else options)
    noise = {c: (make("white_noise", N=1e-4),) for i in model.motion.inputs for c in i.channels}
    return replace(model, noise=noise)


def log_of(model: FilterModel, extra: dict[str, Sequence[Effect]], seconds: float = 20.0, **more: Any) -> Log:
    noise = {c: (*model.noise.get(c, ()), *extra.get(c, ())) for c in [*model.noise, *extra]}
    discrete = DiscreteModel(replace(model, noise=noise), rate=RATE)
    more.setdefault("rates", at_every_sample(discrete))
    return simulate(discrete, "generic", seconds, np.random.default_rng(5), **more)


def value(p: Parameter) -> float:
    return VALUES[p.kind]


def example(cls: type[Effect]) -> Effect:
    given = SPECIAL.get(cls.name)
    return cls(**(given or {p.name: value(p) for p in cls.parameters()}))


GENERAL = ("coupling", "lagged", "noise_level")
"""Effects of any channel, which is named behind a colon."""
OF_REFERENCES = tuple(n for n, c in catalogue().items() if c.__module__.endswith("faults.reference"))
ACTING = [
    n + ":throttle" * (n in GENERAL)
    for n in catalogue()
    if n not in OF_PLANTS and n not in OF_REFERENCES and n != "unknown"
]


@cache
def quiet() -> Log:
    return log_of(bare(), {}, seconds=10.0, vibration=0.5)


@pytest.mark.parametrize("name", ACTING)
def test_every_effect_changes_the_log(name: str) -> None:
    """Of the catalogue, on a triad where it can be.

    What the first axis draws at random for itself comes first, so only the effect can have changed it.
    """
    effect = example(effect_named(name))
    kinds = getattr(effect, "sensors", ("accel",))
    stem = "mag" if name in ON_MAG else "accel" if "accel" in kinds else "gyro"
    log = log_of(bare(), {f"{stem}_{a}": (effect,) for a in "xyz"}, seconds=10.0, vibration=0.5)
    axis = "y" if name == "cross_axis_noise" else "x"
    new, old = (x.channels[f"{stem}_{axis}"].values for x in (log, quiet()))
    assert (
        log.n != quiet().n
        or not np.array_equal(log.t, quiet().t)
        or not np.array_equal(new, old, equal_nan=True)
    )


def difference(extra: dict[str, Sequence[Effect]], channel: str, **more: Any) -> tuple[Log, np.ndarray]:
    model = bare()
    base, log = log_of(model, {}, **more), log_of(model, extra, **more)
    return base, log.channels[channel].values - base.channels[channel].values


def test_scale_factor_and_misalignment_have_their_size() -> None:
    base, away = difference({"gyro_x": (make("scale_factor", coefficient=0.02),)}, "gyro_x")
    assert away == pytest.approx(0.02 * base.values("gyro_x"), abs=2e-4)
    base, away = difference({"accel_x": (make("misalignment", xy=0.01),)}, "accel_x")
    assert away == pytest.approx(0.01 * base.values("accel_y"), abs=1e-3)
    base, away = difference({"gyro_z": (make("g_sensitivity", zx=1e-3),)}, "gyro_z")
    assert away == pytest.approx(1e-3 * base.values("accel_x"), abs=1e-4)


def test_a_delay_of_a_gyro_is_that_of_the_true_rate() -> None:
    """The reading of generic motion, a sinusoid, 20 ms later: means of the interval of the late rate."""
    model = bare()
    silent = replace(model, noise={c: (make("white_noise", N=1e-12),) for c in model.noise})
    log = log_of(silent, {"gyro_x": (make("time_delay", delay=0.023),)})
    middle = log.t + 0.5 / RATE - 0.023
    w = 2 * np.pi * 0.11
    wanted = 0.5 * np.sin(w * middle) * np.sinc(w / RATE / 2 / np.pi)
    assert log.values("gyro_x")[10:] == pytest.approx(wanted[10:], abs=1e-5)


def test_a_late_antenna_shows_where_it_was() -> None:
    """Delay and lever arm of the model: the truth at t - delay, at the antenna, not its first order."""
    model = build("ins15", None, {"lever_arm": "2 -1 0.5 m", "delay": "0.2 s"})
    for s in model.sensors:
        s.sd = 1e-9
    log = simulate(
        DiscreteModel(model, rate=RATE), "generic", 20.0, np.random.default_rng(2), rates={"gnss": RATE}
    )
    from scipy.spatial.transform import Rotation

    R = Rotation.from_quat(np.column_stack([log.values(f"ref_q_{a}") for a in "wxyz"]), scalar_first=True)
    p = np.column_stack([log.values(f"ref_p_{a}") for a in "NED"]) + R.apply([2.0, -1.0, 0.5])
    late = round(0.2 * RATE)
    shown = np.column_stack([log.values(f"gnss_p_{a}") for a in "NED"])
    assert shown[late:] == pytest.approx(p[:-late], abs=1e-7)
    v = np.gradient(p, 1.0 / RATE, axis=0, edge_order=2)
    shown = np.column_stack([log.values(f"gnss_v_{a}") for a in "NED"])
    assert shown[late + 5 : -5] == pytest.approx(v[5 : -late - 5], abs=1e-3)


def test_effects_of_a_late_antenna_off_its_place() -> None:
    """The same as effects of the channels, beyond what the model assumes."""
    extra = {f"gnss_p_{a}": (make("lever_arm", x=1.0, y=0.0, z=-0.5),) for a in "NED"}
    _, away = difference(extra, "gnss_p_D")
    assert 0.3 < np.abs(away).max() < 1.2
    base, away = difference({"gnss_p_N": (make("time_delay", delay=0.1),)}, "gnss_p_N")
    assert away[100:] == pytest.approx(-0.1 * base.values("ref_v_N")[100:], abs=0.01)


def test_white_noise_of_two_channels_is_shared() -> None:
    model = bare()
    extra = {f"gyro_{a}": (make("white_noise", N=1e-2), make("cross_axis_noise", rho=0.8)) for a in "xy"}
    base, log = log_of(model, {}), log_of(model, extra)
    x, y, z = (log.values(f"gyro_{a}") - base.values(f"gyro_{a}") for a in "xyz")
    assert np.corrcoef(x, y)[0, 1] == pytest.approx(0.8, abs=0.05)
    assert np.std(y) == pytest.approx(0.1, rel=0.1)
    assert abs(np.corrcoef(x, z)[0, 1]) < 0.1


def test_vibration_comes_and_goes_and_is_rectified() -> None:
    model = bare()
    quiet = log_of(model, {})
    shaken = log_of(model, {}, vibration=0.5)
    away = shaken.values("accel_y") - quiet.values("accel_y")
    spans = np.std(away[: 7 * (away.size // 7)].reshape(7, -1), axis=1)
    assert (spans[1::2] > 0.25).all()
    assert (spans[::2] < 0.05).all()
    assert np.abs(shaken.values("ref_v_E") - quiet.values("ref_v_E")).max() < 0.1
    k = {f"gyro_{a}": (make("vibration_rectification", coefficient=0.05),) for a in "xyz"}
    bias = log_of(model, k, vibration=0.5).values("gyro_x") - shaken.values("gyro_x")
    power = 3 * np.mean(away[300:560] ** 2)
    assert np.mean(bias[350:500]) == pytest.approx(0.05 * power, rel=0.3)
    assert abs(np.mean(bias[:150])) < 0.1 * 0.05 * power


def test_accelerometers_of_an_attitude_filter_are_shaken_too() -> None:
    model = build("ahrs6")
    discrete = DiscreteModel(model, rate=RATE)
    quiet, shaken = (
        simulate(discrete, "static", 20.0, np.random.default_rng(1), vibration=v) for v in (0.0, 1.0)
    )
    assert np.std(shaken.values("accel_x")) > 5 * np.std(quiet.values("accel_x"))
    with pytest.raises(InputError, match="--vibration"):
        simulate(discrete, "static", 20.0, np.random.default_rng(1), vibration=-1.0)


def test_decoys_are_in_the_log_and_act_on_nothing() -> None:
    log = log_of(bare(), {}, decoys=("voltage", "temperature"))
    assert log.channels["voltage"].unit == "V"
    assert log.values("temperature").std() > 1.0
    with pytest.raises(InputError, match=r"'tide'.*temperature"):
        log_of(bare(), {}, decoys=("tide",))


def test_sensors_sample_at_their_own_rates() -> None:
    discrete = DiscreteModel(bare(), rate=200.0)
    usual = sensor_rates(discrete)
    assert usual == {"gnss_position": 5.0, "gnss_velocity": 5.0, "barometer": 20.0, "mag": 50.0}
    log = simulate(discrete, "generic", 10.0, np.random.default_rng(0), rates={"gnss": 10.0, "baro": 4.0})
    counts = {c: int(np.isfinite(v.values).sum()) for c, v in log.channels.items()}
    assert counts["gyro_x"] == 2000
    assert counts["gnss_p_N"] == counts["gnss_v_D"] == 100
    assert counts["baro"] == 40
    assert counts["mag_x"] == 500
    there = np.isfinite(log.channels["gnss_p_N"].values)
    away = log.channels["gnss_p_N"].values - log.values("ref_p_N")
    assert np.nanstd(away) == pytest.approx(1.5, rel=0.25)
    assert np.diff(log.t[there]) == pytest.approx(np.full(99, 0.1))


def test_rows_of_a_rate_that_does_not_divide_are_as_even_as_can_be() -> None:
    rows = rows_of(1000, 100.0, 30.0)
    assert rows[0] == 0
    assert rows.size == 300
    assert set(np.diff(rows)) == {3, 4}


def test_rates_are_read_from_texts() -> None:
    assert read_rates(["200", "gnss=5", "baro = 20"]) == (200.0, {"gnss": 5.0, "baro": 20.0})
    assert read_rates([]) == (100.0, {})
    for bad in ("fast", "gnss=", "=5", "gnss=nan"):
        with pytest.raises(InputError, match="--rate"):
            read_rates([bad])
    discrete = DiscreteModel(bare(), rate=RATE)
    with pytest.raises(InputError, match=r"no sensor 'sonar'.*barometer"):
        sensor_rates(discrete, {"sonar": 5.0})
    with pytest.raises(InputError, match="200 Hz of gnss"):
        sensor_rates(discrete, {"gnss": 200.0})


def test_noise_of_a_sample_follows_the_sensors_own_rate() -> None:
    """A density: by its rate; the standard deviation of a sample: by none."""
    model = replace(bare(), noise={**bare().noise, "baro": (make("white_noise", N=0.1),)})
    discrete = DiscreteModel(model, rate=RATE, rates={"barometer": 4.0, "gnss_position": 5.0})
    baro, gnss = model.sensor("barometer"), model.sensor("gnss_position")
    assert discrete.sample_variance(baro, "baro") == pytest.approx(0.1**2 * 4.0)
    assert discrete.sample_variance(gnss, "gnss_p_N") == pytest.approx(1.5**2)
    assert DiscreteModel(model, rate=RATE).sample_variance(baro, "baro") == pytest.approx(0.1**2 * RATE)
    assert discrete.hash != DiscreteModel(model, rate=RATE).hash
    log = simulate(discrete, "static", 400.0, np.random.default_rng(0), rates={"baro": 4.0})
    assert np.nanstd(log.channels["baro"].values) == pytest.approx(0.2, rel=0.1)


def test_effects_of_a_whole_sensor_are_found_by_its_name() -> None:
    model = bare()
    drop = make("scale_factor", coefficient=0.01)
    placed = {"gnss": (drop,), "gnss_p": (drop,), "mag": (drop,), "gyro_x": (drop,)}
    gyro = next(i for i in model.motion.inputs if i.name == "gyro")
    counts = {
        s.name: [len(es) for es in channel_effects(placed, s)]
        for s in (gyro, *model.sensors)
        if s.name != "mag"
    }
    assert counts == {
        "gyro": [1, 0, 0],
        "gnss_position": [2, 2, 2],
        "gnss_velocity": [1, 1, 1],
        "barometer": [0],
    }

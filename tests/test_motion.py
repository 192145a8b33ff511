"""Proves that the motion world tells what is wrong with a sensor that moves.

The data are made here in plain numpy, with other code than the world's: sums of sines for the motion, an
attitude integrated with small rotations at ten times the rate, exact sine responses for delays and low-passes.
A fit is good within 4.5 of its standard deviations (7e-6 a check); seeds are fixed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from in_part import in_part
from numpy.typing import NDArray

from kfgen.core.errors import InputError
from kfgen.core.units import STANDARD_GRAVITY as G
from kfgen.effects import Parameter, make
from kfgen.effects.inertial.felt import Signals
from kfgen.effects.inertial.inertial_error import free
from kfgen.effects.inertial.vibration import running_variance
from kfgen.effects.noise_model import ChannelNoise, NoiseModel, Term
from kfgen.gap.motion.motion_scene import motion_scene
from kfgen.gap.motion.on_off_times import best_span, vibrations
from kfgen.gap.motion.scene import MotionScene
from kfgen.gap.motion.truth import body_rate, truth_of
from kfgen.gap.scene.scene import Placed, ScenePoint
from kfgen.gap.scene.scene_gap import scene_gap
from kfgen.log.log import Channel, Log
from kfgen.log.readers import read_log

Array = NDArray[np.float64]
Find = Callable[[str], Path]

LIMIT = 4.5
DT, N = 0.01, 6000
T = np.arange(N) * DT
AXES = "xyz"


# A fit in plain least squares: what the engine does with any scene.


def located(placed: Sequence[Placed]) -> list[tuple[int, Parameter]]:
    return [(i, p) for i, one in enumerate(placed) for p in free(one.effect)]


def at(placed: Sequence[Placed], keys: list[tuple[int, Parameter]], x: Array) -> tuple[Placed, ...]:
    """The effects with values: times and sizes are given by their logarithms."""
    out = list(placed)
    for (i, p), value in zip(keys, x):
        v = float(value if p.kind == "signed" else np.exp(value))
        out[i] = replace(out[i], effect=replace(out[i].effect, **{p.name: v}))
    return tuple(out)


def values(placed: Sequence[Placed], keys: list[tuple[int, Parameter]]) -> Array:
    return np.array([float(getattr(placed[i].effect, p.name)) for i, p in keys])


def fit(scene: MotionScene, *placed: Placed) -> tuple[tuple[Placed, ...], Array, Array, float]:
    """The effects at their least squares, values, standard deviations, and the sum of squares left."""
    keys = located(placed)
    theta, signed = values(placed, keys), np.array([p.kind == "signed" for _, p in keys], dtype=bool)
    u = np.array([one.value for one in scene.unknowns])
    both = np.concatenate([np.where(signed, theta, np.log(np.where(signed, 1.0, theta))), u])
    steps = np.concatenate([np.where(signed, 0.1 * np.abs(theta) + 1e-9, 1e-3), 1e-3 * np.abs(u) + 1e-9])
    m = theta.size
    for _ in range(8):
        points = [both] + [both + np.eye(both.size)[k] * h for k, h in enumerate(steps)]
        r = scene.residuals([ScenePoint(at(placed, keys, p[:m]), p[m:]) for p in points])
        J = (r[:, 1:] - r[:, :1]) / steps
        size = np.maximum(np.linalg.norm(J, axis=0), 1e-300)
        inverse = np.linalg.pinv((J / size).T @ (J / size), rcond=1e-12, hermitian=True)
        change = -inverse @ ((J / size).T @ r[:, 0]) / size
        change[:m] = np.where(signed, change[:m], np.clip(change[:m], -1.0, 1.0))
        both = both + change
    best = at(placed, keys, both[:m])
    left = scene.residuals([ScenePoint(best, both[m:])])[:, 0]
    deviation = (np.sqrt(np.diag(inverse)) / size)[:m]
    theta = values(best, keys)
    return best, theta, np.where(signed, deviation, deviation * theta), float(left @ left)


def gains(scene: MotionScene, *placed: Placed) -> list[tuple[float, tuple[Placed, ...]]]:
    """Every candidate with what it takes off half the sum of squares less five a parameter, the best first."""
    base = fit(scene, *placed)
    found = []
    for starts in scene.candidates(base[0]):
        best = min((fit(scene, *base[0], s) for s in starts), key=lambda one: one[3])
        found.append(
            (0.5 * (base[3] - best[3]) - 5.0 * len(located([*starts])) / len(starts), best[0][len(placed) :])
        )
    return sorted(found, key=lambda one: -one[0])


# Motion and sensors in plain numpy.


def waves(seed: int, size: float, top: float = 2.0, n: int = N, dt: float = DT) -> Array:
    """Three columns of eight sines each, to `top` Hz."""
    rng = np.random.default_rng(seed)
    f, phase = rng.uniform(0.05, top, (8, 3)), rng.uniform(0, 2 * np.pi, (8, 3))
    t = np.arange(n) * dt
    return size / 2 * np.sin(2 * np.pi * f * t[:, None, None] + phase).sum(axis=1)


def noise_of(unit: str, N: float, *names: str) -> NoiseModel:
    return NoiseModel({n: ChannelNoise(unit, (Term(make("white_noise", N=N)),)) for n in names})


def table_log(true: Array, read: Array, sensor: str = "gyro", unit: str = "rad/s", **more: Array) -> Log:
    channels = {f"{sensor}_{a}": Channel.of(read[:, i], unit) for i, a in enumerate(AXES)}
    channels |= {f"ref_{sensor}_{a}": Channel.of(true[:, i], unit) for i, a in enumerate(AXES)}
    channels |= {k: Channel.of(v, "m/s^2") for k, v in more.items()}
    return Log(np.arange(len(true)) * DT, channels)


N_GYRO = 2e-4
GYRO = noise_of("rad/s", N_GYRO, "gyro_x", "gyro_y", "gyro_z")
BIAS = np.array([0.01, -0.02, 0.03])


def white(seed: int, N: float, shape: tuple[int, ...] = (N, 3)) -> Array:
    return np.random.default_rng(seed).standard_normal(shape) * N / np.sqrt(DT)


def table(wrong: Callable[[Array], Array], seed: int = 1) -> MotionScene:
    """A rate table, and a gyro that is `wrong`."""
    w = waves(2, 1.0)
    scene = motion_scene(table_log(w, wrong(w) + BIAS + white(seed, N_GYRO)), GYRO)
    assert scene is not None
    return scene


def moved(x: Array, i: int, added: Array) -> Array:
    out = x.copy()
    out[:, i] += added
    return out


WRONG: dict[str, tuple[Callable[[Array], Array], str, dict[str, float]]] = {
    "scale_factor": (lambda w: moved(w, 1, 0.003 * w[:, 1]), "gyro_y", {"coefficient": 0.003}),
    "scale_asymmetry": (lambda w: moved(w, 2, 0.004 * abs(w[:, 2])), "gyro_z", {"coefficient": 0.004}),
    "nonlinearity": (lambda w: moved(w, 0, 0.002 * w[:, 0] ** 3), "gyro_x", {"k3": 0.002}),
    "misalignment": (lambda w: moved(w, 0, -0.003 * w[:, 2]), "gyro_x", {"xz": -0.003}),
}


@pytest.mark.parametrize("name", in_part(WRONG, 2))
def test_an_error_of_a_gyro_on_a_rate_table_comes_first(name: str) -> None:
    wrong, where, true = WRONG[name]
    scene = table(wrong)
    gain, (found,) = gains(scene)[0]
    assert (found.effect.name, found.where) == (name, where)
    assert gain > 30.0
    _, theta, deviation, left = fit(scene, found)
    for (_, parameter), value, sd in zip(located([found]), theta, deviation):
        assert abs(value - true.get(parameter.name, 0.0)) < LIMIT * sd
    assert abs(left / (3 * N) - 1.0) < LIMIT * np.sqrt(2 / (3 * N))


def test_without_an_error_there_is_nothing_to_gain() -> None:
    """No candidate takes off more than chance: ten nats beyond five a parameter, of some 60 of them."""
    found = gains(table(lambda w: w))
    assert len(found) > 30
    assert found[0][0] < 10.0


def test_the_deviation_of_a_scale_is_that_of_its_closed_form() -> None:
    """Var(s) = N^2 / dt / sum (w - mean)^2 beside a bias."""
    scene = table(lambda w: w)
    _, _, (sd,), _ = fit(scene, Placed(make("scale_factor", coefficient=1e-3), "gyro_x"))
    w = waves(2, 1.0)[:, 0]
    assert sd == pytest.approx(N_GYRO / np.sqrt(DT) / np.sqrt(N * w.var()), rel=1e-3)


@pytest.mark.long
def test_a_delay_and_a_bandwidth_are_distinguished_where_there_is_content() -> None:
    """Exact answers of sines to 12 Hz: a phase of -2 pi f d; a phase and a loss of 1 / (1 + i f / fc)."""
    rng = np.random.default_rng(3)
    f, phase = rng.uniform(0.1, 12.0, (3, 10)), rng.uniform(0, 2 * np.pi, (3, 10))
    arg = 2 * np.pi * f * T[:, None, None] + phase
    true = np.sin(arg).sum(axis=2)
    late = np.sin(arg - 2 * np.pi * f * 0.0037).sum(axis=2)
    slow = (np.sin(arg - np.arctan(f / 25.0)) / np.hypot(1, f / 25.0)).sum(axis=2)
    for read, name, value in ((late, "time_delay", 0.0037), (slow, "bandwidth", 25.0)):
        scene = motion_scene(table_log(true, read + white(5, 2e-3)), noise_of("rad/s", 2e-3, *GYRO.channels))
        assert scene is not None
        ranked = gains(scene)
        _, (found,) = ranked[0]
        assert (found.effect.name, found.where) == (name, "gyro")
        _, (theta,), (sd,), _ = fit(scene, found)
        assert abs(theta - value) < LIMIT * sd + 2e-3 * value
        other = next(g for g, p in ranked if p[0].effect.name in {"time_delay", "bandwidth"} - {name})
        assert ranked[0][0] - other > 20.0


def test_g_sensitivity_feels_the_accelerometer() -> None:
    w, f = waves(2, 1.0), waves(4, 5.0, 0.5) + np.array([0.0, 0.0, -G])
    read = moved(w, 1, 1e-4 * f[:, 2]) + white(6, N_GYRO)
    log = table_log(w, read, **{f"accel_{a}": f[:, i] for i, a in enumerate(AXES)})
    scene = motion_scene(log, GYRO)
    assert scene is not None
    _, (found,) = gains(scene)[0]
    assert (found.effect.name, found.where) == ("g_sensitivity", "gyro_y")
    _, (theta,), (sd,), _ = fit(scene, found)
    assert abs(theta - 1e-4) < LIMIT * sd


@pytest.mark.parametrize("pair", in_part(["zz", "xy"]))
def test_products_of_forces_are_no_forces(pair: str) -> None:
    """Tilts to all sides: of 100 m^2/s^4 times 1e-5 the standard deviation of a sample's noise makes 60 in the whole record."""
    w, f = waves(2, 1.0), waves(4, 5.0, 0.5) + np.array([0.0, 0.0, -G])
    product = f[:, AXES.index(pair[0])] * f[:, AXES.index(pair[1])]
    read = moved(w, 1, 1e-5 * product) + white(6, N_GYRO)
    scene = motion_scene(table_log(w, read, **{f"accel_{a}": f[:, i] for i, a in enumerate(AXES)}), GYRO)
    assert scene is not None
    first = scene_gap(scene).findings[0]
    assert (first.effect.name, first.where) == ("g_squared", "gyro_y")
    lo, hi = first.ci95[pair]
    assert abs(1e-5 - 0.5 * (lo + hi)) < LIMIT / 1.96 * 0.5 * (hi - lo)


@pytest.mark.long
def test_a_scale_that_follows_the_temperature() -> None:
    w, heat = waves(2, 1.0), 300.0 + 10.0 * np.sin(2 * np.pi * T / 45.0)
    log = table_log(w, moved(w, 2, 1e-3 * (heat - heat.mean()) * w[:, 2]) + white(6, N_GYRO))
    log = Log(log.t, {**log.channels, "temperature": Channel.of(heat, "K")})
    scene = motion_scene(log, GYRO)
    assert scene is not None
    (found,) = scene_gap(scene).findings
    assert (found.effect.name, found.where) == ("scale_temperature", "gyro_z")
    lo, hi = found.ci95["coefficient"]
    assert abs(1e-3 - 0.5 * (lo + hi)) < LIMIT / 1.96 * 0.5 * (hi - lo)


def test_a_lever_arm_in_fast_motion_has_the_whole_acceleration() -> None:
    """A swing of 2 Hz at 50 Hz: ``alpha r``, of which a difference over two samples would lose 1 %."""
    t = np.arange(500) / 50.0
    rate, turn = np.zeros((500, 3)), 2.0 * np.pi * 2.0
    rate[:, 2] = np.sin(turn * t)
    felt = Signals(t, np.zeros((500, 3)), rate, None, None, 1.0, None)
    alone = make("lever_arm", x=0.1, y=0.0, z=0.0).output(felt, 1)  # type: ignore[attr-defined]
    np.testing.assert_allclose(alone[10:-10], (0.1 * turn * np.cos(turn * t))[10:-10], atol=1e-3 * 0.1 * turn)


@pytest.mark.long
def test_a_lever_arm_is_that_of_a_turning_point() -> None:
    """The acceleration of a point at r is the second derivative of R r, taken here by differences of R."""
    r = np.array([0.1, -0.05, 0.2])
    R, w = attitude(waves(2, 2.0, 1.0, 10 * N, DT / 10))
    p = R @ r
    a_n = np.gradient(np.gradient(p, DT / 10, axis=0), DT / 10, axis=0)
    f = np.einsum("nji,nj->ni", R, a_n - np.array([0.0, 0.0, G]))[::10]
    f0 = np.einsum("nji,j->ni", R, -np.array([0.0, 0.0, G]))[::10]
    log = table_log(f0, f + white(7, 1e-3), "accel", "m/s^2")
    rates = {f"ref_gyro_{a}": Channel.of(w[::10, i], "rad/s") for i, a in enumerate(AXES)}
    log = replace(log, channels={**log.channels, **rates})
    scene = motion_scene(log, noise_of("m/s^2", 1e-3, "accel_x", "accel_y", "accel_z"))
    assert scene is not None
    _, (found,) = gains(scene)[0]
    assert (found.effect.name, found.where) == ("lever_arm", "accel")
    _, theta, sd, _ = fit(scene, found)
    assert (np.abs(theta - r) < LIMIT * sd + 1e-3 * np.abs(r)).all()


def attitude(w: Array, dt: float = DT / 10) -> tuple[Array, Array]:
    """Rotation matrices body to navigation, shape (n, 3, 3), of a body rate, and that rate."""
    R = np.empty((len(w), 3, 3))
    R[0] = np.eye(3)
    for k in range(1, len(w)):
        x, y, z = 0.5 * (w[k - 1] + w[k]) * dt
        S = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        a2 = x * x + y * y + z * z
        R[k] = R[k - 1] @ (np.eye(3) + S * (1 - a2 / 6) + S @ S * (0.5 - a2 / 24))
    return R, w


def quaternion(R: Array) -> Array:
    """Scalar first, shape (n, 4), for turns by less than half a revolution about some axis."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_matrix(R).as_quat(scalar_first=True))


@pytest.fixture(scope="module")
def turning() -> tuple[Array, Array, Array]:
    """Times, attitude and rate at DT of a body that turns about all axes, at rest at both ends."""
    R, w = attitude(waves(8, 1.5, 1.5, 10 * N, DT / 10) * np.hanning(10 * N)[:, None])
    return T, R[::10], w[::10]


def test_the_rate_of_an_attitude(turning: tuple[Array, Array, Array]) -> None:
    _, R, w = turning
    omega, corner, _, _ = body_rate(quaternion(R), DT)
    np.testing.assert_allclose(omega, w, atol=2e-3)
    assert corner > 1.5
    noisy = R @ attitude_noise(1e-4)
    omega, corner, angle, floor = body_rate(quaternion(noisy), DT, w + white(20, N_GYRO))
    assert angle == pytest.approx(1e-4, rel=0.1)
    assert 1.5 < corner < 25.0
    assert np.std(omega - w) < 1e-2
    # Density of the derivative of white angles: (2 pi f)^2 sd^2.
    assert floor.slope == pytest.approx(2.0, abs=0.3)
    assert floor.density(np.array([10.0]))[0] == pytest.approx((2 * np.pi * 10.0 * 1e-4) ** 2, rel=0.3)


def attitude_noise(sd: float) -> Array:
    a = np.random.default_rng(9).standard_normal((N, 3)) * sd
    S = np.zeros((N, 3, 3))
    S[:, 0, 1], S[:, 0, 2], S[:, 1, 2] = -a[:, 2], a[:, 1], -a[:, 0]
    return np.eye(3) + S - np.swapaxes(S, 1, 2)


M_N = np.array([20e-6, 1e-6, 43e-6])
MAG = noise_of("uT", 2e-8, "mag_x", "mag_y", "mag_z")


def attitude_log(R: Array, **triads: tuple[Array, str]) -> Log:
    q = quaternion(R)
    q[1000:1020] = np.nan
    channels = {f"ref_q_{c}": Channel.of(q[:, i], "") for i, c in enumerate("wxyz")}
    for sensor, (values, unit) in triads.items():
        channels |= {f"{sensor}_{a}": Channel(values[:, i], unit) for i, a in enumerate(AXES)}
    return Log(T, channels)


@pytest.mark.long
def test_iron_on_a_magnetometer(turning: tuple[Array, Array, Array]) -> None:
    """A hard iron always, a magnet for a while, a soft iron: by name, vector and time, holes left out."""
    t, R, _ = turning
    m = np.einsum("nji,j->ni", R, M_N)
    h = np.array([2e-6, -1e-6, 3e-6])
    magnet = ((t >= 20.0) & (t < 41.0))[:, None] * h
    A = np.array([[0.0, 0.01, 0.0], [0.01, 0.0, 0.0], [0.0, 0.0, 0.0]])
    for added, name in ((h + 0 * m, "hard_iron"), (magnet, "hard_iron"), (m @ A.T, "soft_iron")):
        scene = motion_scene(attitude_log(R, mag=(m + added + white(10, 2e-8), "uT")), MAG)
        assert scene is not None
        assert [u.value for u in scene.unknowns][2] == pytest.approx(43e-6, rel=0.1)
        _, (found,) = gains(scene)[0]
        assert (found.effect.name, found.where) == (name, "mag")
        _, theta, sd, left = fit(scene, found)
        if name == "hard_iron":
            assert (np.abs(theta - h) < LIMIT * sd).all()
        if added is magnet:
            assert found.effect.time == pytest.approx(
                20.0, abs=DT
            )  # to the sample: of ten standard deviations
            assert found.effect.duration == pytest.approx(21.0, abs=DT)
            assert "from 2" in found.effect.sentence("mag", "uT")
        else:
            assert abs(left / (3 * (N - 20)) - 1.0) < 0.05


@pytest.mark.long
def test_a_field_fixed_in_space_is_no_iron(turning: tuple[Array, Array, Array]) -> None:
    t, R, _ = turning
    d = np.array([2e-6, -3e-6, 1e-6])
    m = np.einsum("nji,nj->ni", R, M_N + ((t >= 15.0) & (t < 45.0))[:, None] * d)
    scene = motion_scene(attitude_log(R, mag=(m + white(11, 2e-8), "uT")), MAG)
    assert scene is not None
    _, (found,) = gains(scene)[0]
    assert found.effect.name == "magnetic_disturbance"
    assert found.effect.time == pytest.approx(15.0, abs=0.3)


def test_gravity_finds_its_direction(turning: tuple[Array, Array, Array]) -> None:
    """The same motion given in east-north-up and north-east-down gives the same accelerometer."""
    _, R, _ = turning
    f = np.einsum("nji,j->ni", R, np.array([0.0, 0.0, -G]))
    flip = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1.0]])
    for frame in (R, flip @ R):
        truth = truth_of(attitude_log(frame, accel=(f + white(12, 1e-3), "m/s^2")))
        assert truth is not None
        np.testing.assert_allclose(truth.read["accel"][truth.good], f[truth.good], atol=0.02)
        assert ("up" in truth.words[0]) == (frame is not R)


@pytest.mark.long
def test_a_scale_under_an_attitude(turning: tuple[Array, Array, Array]) -> None:
    _, R, w = turning
    noisy = R @ attitude_noise(5e-5)
    read = moved(w, 2, 0.02 * w[:, 2]) + white(13, N_GYRO)
    scene = motion_scene(attitude_log(noisy, gyro=(read, "rad/s")), GYRO)
    assert scene is not None
    _, (found,) = gains(scene)[0]
    assert (found.effect.name, found.where) == ("scale_factor", "gyro_z")
    _, (theta,), (sd,), left = fit(scene, found)
    assert abs(theta - 0.02) < LIMIT * sd
    assert left / sum(scene.lengths) == pytest.approx(1.0, abs=0.2)


def test_a_reference_slower_than_the_log(turning: tuple[Array, Array, Array]) -> None:
    """An attitude at a quarter of the rate of the log, nothing between; a scale of 2 % as before."""
    _, R, w = turning
    log = attitude_log(
        R @ attitude_noise(5e-5), gyro=(moved(w, 2, 0.02 * w[:, 2]) + white(19, N_GYRO), "rad/s")
    )
    sparse = {
        k: replace(c, values=np.where(np.arange(N) % 4, np.nan, c.values)) if k.startswith("ref_") else c
        for k, c in log.channels.items()
    }
    scene = motion_scene(replace(log, channels=sparse), GYRO)
    assert scene is not None
    left_out = (2 * 4 + 2) / scene.truth.bandwidth[
        "gyro"
    ] + 0.2  # periods at the ends and beside the hole of 0.2 s
    assert 1.0 - scene.good.mean() == pytest.approx(left_out / 60.0, abs=0.01)
    _, (theta,), (sd,), _ = fit(scene, Placed(make("scale_factor", coefficient=1e-3), "gyro_z"))
    assert abs(theta - 0.02) < LIMIT * sd + 2e-4


# What a log may lack.


def test_no_reference_no_motion_no_world() -> None:
    w = waves(2, 1.0)
    log = table_log(w, w)
    assert motion_scene(log.select(["gyro_x", "gyro_y"]), GYRO) is None
    still = np.full((N, 3), 0.1)
    assert motion_scene(table_log(still, still + white(1, N_GYRO)), GYRO) is None
    with pytest.raises(InputError, match="no numbers"):
        motion_scene(table_log(np.full((N, 3), np.nan), w), GYRO)
    with pytest.raises(InputError, match="noise in"):
        motion_scene(log, noise_of("m/s^2", 1e-3, "gyro_x"))


def test_one_axis_on_a_table() -> None:
    w = waves(2, 1.0)
    log = table_log(w, w + white(1, N_GYRO)).select(["gyro_z", "ref_gyro_z"])
    scene = motion_scene(log, GYRO)
    assert scene is not None
    assert scene.channels == ("gyro_z",)
    names = {s[0].effect.name for s in scene.candidates([])}
    assert "misalignment" not in names
    assert {"scale_factor", "time_delay"} <= names


def test_entries_at_zero_are_not_there() -> None:
    assert [p.name for p in free(make("misalignment", xy=1e-3))] == ["xy"]
    assert [p.name for p in free(make("hard_iron", x=1e-6, z=1e-6, time=3.0))] == ["x", "z"]
    assert [p.name for p in free(make("scale_factor", coefficient=0.0))] == ["coefficient"]
    assert make("misalignment", xy=1e-3).sentence("gyro_x", "deg/s").count("=") == 1


def test_each_effect_adds_what_its_formula_says() -> None:
    rng = np.random.default_rng(14)
    y, f, w = rng.standard_normal((3, 50, 3))
    power = rng.uniform(0, 1, (50, 3))
    s = Signals(T[:50], y, w, f, np.tile(np.eye(3), (50, 1, 1)), 1.0, power)
    checks = [
        (make("vibration_rectification", coefficient=0.5), 0, 0.5 * power.sum(axis=1)),
        (make("vibration_rectification", coefficient=0.5, own=1.0), 1, 0.5 * power[:, 1]),
        (make("gravity_error", value=0.3), 2, np.full(50, -0.3)),
        (make("earth_rate", x=0.1, z=0.2), 2, np.full(50, 0.2)),
        (make("soft_iron", zx=0.1), 2, 0.1 * y[:, 0]),
        (make("nonlinearity", k2=0.2), 1, 0.2 * y[:, 1] ** 2),
    ]
    for effect, axis, expected in checks:
        np.testing.assert_allclose(effect.output(s, axis), expected, rtol=1e-12)


# Recordings.


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "start", "stop", "vector"),
    [
        ("33_disturbed_attached_magnet_2cm", 41.0, 99.0, (-3.1, -0.3, 26.9)),
        pytest.param(
            "36_disturbed_attached_magnet_5cm", 37.0, 100.0, (0.1, -0.2, -6.1), marks=pytest.mark.long
        ),
    ],
)
def test_the_magnet_of_a_recording(
    recording: Find, name: str, start: float, stop: float, vector: tuple[float, float, float]
) -> None:
    """Manifest: the vector and when it was there; the magnet comes and goes within two seconds."""
    log = read_log(recording(f"dynamic/broad_{name}.npz"))
    scene = motion_scene(log, noise_of("uT", 3e-7, "mag_x", "mag_y", "mag_z"))
    assert scene is not None
    bench = scene.bench([])
    span = best_span(bench.truth.t, bench.mag, bench.good, bench.truth.R_bn, in_body=True)
    assert span is not None
    assert span.start == pytest.approx(start, abs=2.0)
    assert span.stop == pytest.approx(stop, abs=2.0)
    np.testing.assert_allclose(1e6 * np.array(span.vector), vector, atol=0.4)
    (found,) = next(
        p
        for p in scene.candidates([])
        if getattr(p[0].effect, "duration", 0.0) and p[0].effect.name == "hard_iron"
    )
    _, theta, _, left = fit(scene, found)
    np.testing.assert_allclose(1e6 * theta, vector, atol=0.4)
    assert left < 0.5 * fit(scene)[3]


def test_any_channel_may_have_a_reference() -> None:
    """Metres of a laser against those of a tape: a scale, a delay, no axes to be misaligned."""
    tape = waves(15, 3.0, 0.5)[:, 0]
    laser = 1.01 * tape + white(16, 1e-3, (N,))
    log = Log(T, {"range": Channel.of(laser, "m"), "ref_range": Channel.of(tape, "m")})
    scene = motion_scene(log, noise_of("m", 1e-3, "range"))
    assert scene is not None
    _, (found,) = gains(scene)[0]
    assert (found.effect.name, found.where) == ("scale_factor", "range")
    assert "misalignment" not in {s[0].effect.name for s in scene.candidates([])}


def test_a_vibration_has_its_span() -> None:
    rng = np.random.default_rng(17)
    f = waves(18, 5.0) + 0.01 * rng.standard_normal((N, 3))
    on = (T >= 12.0) & (T < 31.0)
    f[on] += 0.5 * np.sin(2 * np.pi * 33.0 * T[on, None])
    ((start, stop),) = vibrations(T, f, 0.02, 20.0)
    assert start == pytest.approx(12.0, abs=0.6)
    assert stop == pytest.approx(31.0, abs=0.6)
    assert vibrations(T, waves(18, 5.0) + 0.01 * rng.standard_normal((N, 3)), 0.02, 20.0) == []


@pytest.mark.parametrize(
    ("name", "share"), [("25_disturbed_tapping_B", 0.5), ("27_disturbed_phone_vibration_B", 0.75)]
)
def test_the_vibration_of_a_recording(recording: Find, name: str, share: float) -> None:
    """Tapping and a phone: most of the time that the recording marks as motion; at rest before it, nothing."""
    path = recording(f"dynamic/broad_{name}.npz")
    log = read_log(path)
    f = np.array([log.values(f"accel_{a}") for a in AXES]).T
    early = log.t < 30.0
    noise = np.sqrt(0.5 * np.diff(f[early], axis=0).var(axis=0).sum())
    spans = vibrations(log.t, f, noise, 40.0, 3.0)
    with np.load(path) as data:
        moving = data["movement"]
    inside = np.zeros(log.n, dtype=bool)
    for start, stop in spans:
        inside |= (log.t >= start) & (log.t <= stop)
    assert inside[moving].mean() > share
    assert inside[~moving].mean() < 0.1


def test_a_rate_table_shows_a_misalignment_in_the_axis_that_does_not_turn() -> None:
    """Only x turns; y should read nothing and reads a part of it."""
    rng, n, N = np.random.default_rng(3), 4000, 1e-4
    t = np.arange(n) * 0.01
    x = np.sin(2 * np.pi * 0.2 * t) + 0.5 * np.sin(2 * np.pi * 0.7 * t)
    truth = np.array([x, np.zeros(n), np.zeros(n)])
    read = truth + N * 10.0 * rng.standard_normal((3, n))
    read[1] += 2e-3 * x
    channels = {f"gyro_{a}": Channel(v, "rad/s") for a, v in zip("xyz", read)}
    channels |= {f"ref_gyro_{a}": Channel(v, "rad/s") for a, v in zip("xyz", truth)}
    noise = ChannelNoise("rad/s", (Term(make("white_noise", N=N)),))
    scene = motion_scene(Log(t, channels), NoiseModel({f"gyro_{a}": noise for a in "xyz"}))
    assert scene is not None
    (found,) = scene_gap(scene).findings
    assert (found.effect.name, found.where) == ("misalignment", "gyro_y")
    lo, hi = found.ci95["yx"]
    assert lo < 2e-3 < hi


def test_motion_is_no_vibration() -> None:
    """White shaking of a known standard deviation on a slow swing five times as large: its own variance, within 5 %."""
    t = np.arange(20_000) * 0.01
    swing = 5.0 * np.sin(2 * np.pi * 0.3 * t)[:, None] * np.ones(3)
    shaken = swing + np.random.default_rng(4).standard_normal((t.size, 3))
    assert running_variance(shaken, 10, 100).mean(axis=0) == pytest.approx(np.ones(3), rel=0.05)

"""Proves that a model which is nowhere near its log is refused, and that running away explains nothing.

No statistics: a model of another plant, and simulations far beyond the data.
"""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from kfgen.core.errors import InputError
from kfgen.effects.plant.sensor import SensorLag
from kfgen.effects.plant.terms import CoulombFriction, ParameterError, QuadraticDrag, StateTerm
from kfgen.gap.plant.reach import does_drive
from kfgen.gap.plant.recorded_channel import check_near
from kfgen.gap.plant.scene import PlantScene
from kfgen.gap.scene import assumed_parameters
from kfgen.gap.scene.addition import ranked
from kfgen.gap.scene.assumed_parameters import Answered, answered, complete
from kfgen.gap.scene.explanation import Explained
from kfgen.gap.scene.newton import fitted
from kfgen.gap.scene.scene import Placed, ScenePoint, start_of
from kfgen.gap.scene.screen import Screened
from kfgen.log.log import Channel, Log
from kfgen.model.plant.file import parse_model
from kfgen.model.plant.plant import Plant

MOTOR = """format = "kfgen-model-1"
name = "motor"
[states]
omega = "rad/s"
[inputs]
u = "V"
[dynamics]
omega = "(15*u - omega)/0.12"
[measurements.speed]
unit = "rad/s"
expression = "omega"
effects = [ { effect = "white_noise", N = "0.04 rad/s/sqrt(Hz)" } ]
"""


@pytest.fixture
def scene() -> PlantScene:
    """A motor at rest that is not the one of the log: its speed is a slow wave."""
    t = np.arange(1000) * 0.01
    u = np.repeat(np.random.default_rng(1).uniform(-5.0, 5.0, 20), 50)
    speed = 40.0 * np.sin(0.9 * t) + 0.4 * np.random.default_rng(2).standard_normal(t.size)
    log = Log(t, {"u": Channel(u, "V"), "speed": Channel(speed, "rad/s")}, "log")
    return PlantScene.of(parse_model(MOTOR, "motor.toml"), log)


def test_a_simulation_that_runs_away_is_no_constant(scene: PlantScene) -> None:
    """Held beyond the data it stays far from them, whatever constant is subtracted."""
    recorded = scene.recorded["speed"]
    for far in (1e12, -1e12, np.nan, np.inf):
        left = recorded.left(np.full((1000, 1), far))[:, 0]
        assert np.std(left) > 100.0 * np.ptp(recorded.values)


def test_a_lag_longer_than_the_log_is_none(scene: PlantScene) -> None:
    base = fitted(scene, ScenePoint((), np.array([u.start for u in scene.unknowns])))
    for tau, kept in ((0.05, True), (1e6, False)):
        start = Placed(SensorLag(tau), "speed")
        trials = ranked(scene, base, [Screened(10.0, start, base.residual, np.zeros(0), (start,))])
        times = [float(t.placed.effect.tau) for t in trials]  # type: ignore[attr-defined]
        assert all(t <= 10.0 for t in times)
        assert bool(times) or not kept


def test_a_model_that_is_nowhere_near_is_refused(scene: PlantScene) -> None:
    values = scene.recorded["speed"].values
    near = {"speed": (values + 0.5 * np.std(values))[:, None]}
    check_near(scene.model, scene.recorded, near, "as it is")
    with pytest.raises(InputError, match=r"motor does not follow the log: as it is, .* nowhere near speed"):
        check_near(scene.model, scene.recorded, {"speed": near["speed"] + 3.0 * np.std(values)}, "as it is")


@pytest.mark.parametrize(
    ("effect", "drives"),
    [
        (CoulombFriction(-320.0), False),
        (CoulombFriction(-350.0), True),
        (QuadraticDrag(-0.2), False),
        (QuadraticDrag(-0.22), True),
    ],
)
def test_friction_may_be_less_than_that_of_the_model_and_does_not_drive(
    effect: StateTerm, drives: bool, scene: PlantScene
) -> None:
    """At 40 rad/s the motor's own friction is 40 / 0.12 = 333 rad/s^2."""
    plant = Plant(scene.model, ())
    assert does_drive(Placed(effect, "omega"), plant, (), np.array([40.0])) == drives


def test_what_drives_is_no_finding(scene: PlantScene) -> None:
    """Of whatever size: drag that is far more than what the motor loses."""
    assert "does not drive" in scene.unreached(Placed(QuadraticDrag(-100.0), "omega"))
    assert scene.unreached(Placed(QuadraticDrag(100.0), "omega")) == ""
    assert scene.unreached(Placed(QuadraticDrag(-1e-3), "omega")) == ""


def test_numbers_that_no_simulation_follows_as_assumed_stay_free(
    scene: PlantScene, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A number in question that is found late, with which held the model is nowhere near, costs no answer."""
    fit = fitted(scene, start_of(scene))
    found = Explained(fit, (), fit, scene)

    def held(_: PlantScene, names: set[str]) -> PlantScene:
        if "late" in names:
            raise InputError("motor does not follow the log")
        return scene

    monkeypatch.setattr(assumed_parameters, "explained", lambda *_, **__: found)
    monkeypatch.setattr(assumed_parameters, "moved_far", lambda *_: {"late"})
    monkeypatch.setattr(PlantScene, "refuted", lambda _: (Placed(ParameterError(0.0), "early"),))
    monkeypatch.setattr(PlantScene, "held", held)
    with pytest.raises(InputError, match="motor"):
        answered(scene, noise_first=False)
    late = iter([set[str](), {"late"}, {"late"}])
    monkeypatch.setattr(assumed_parameters, "moved_far", lambda *_: next(late))
    answer = answered(scene, noise_first=False)
    assert answer.scene is scene
    assert not answer.found.added


@pytest.mark.parametrize(("times", "kept"), [(1.0, False), (1.5, True)])
def test_freedom_with_which_a_fit_goes_astray_is_not_given(
    times: float, kept: bool, scene: PlantScene, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A number in question that nothing needs is free again, unless its fit then leaves more than twice the power."""
    fit = fitted(scene, start_of(scene))
    anew = replace(fit, residual=times * fit.residual)
    found = Explained(fit, (), fit, scene)
    monkeypatch.setattr(assumed_parameters, "explained", lambda *_, **__: found)
    monkeypatch.setattr(assumed_parameters, "fitted", lambda *_: anew)
    monkeypatch.setattr(assumed_parameters, "moved_far", lambda *_: set[str]())
    monkeypatch.setattr(PlantScene, "refuted", lambda _: (Placed(ParameterError(0.0), "early"),))
    monkeypatch.setattr(PlantScene, "held", lambda *_: scene)
    assert answered(scene, noise_first=False).fit is (fit if kept else anew)


@pytest.mark.parametrize(
    ("whole_left", "pieces_left", "asked", "kept"),
    [
        (0.05, 0.01, ["whole"], "whole"),
        (0.3, 0.2, ["whole", "pieces"], "pieces"),
        (0.3, 0.4, ["whole", "pieces"], "whole"),
    ],
)
def test_a_log_that_one_simulation_follows_is_not_cut(
    whole_left: float, pieces_left: float, asked: list[str], kept: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In pieces only where one simulation leaves more than a tenth of the log's power; then what leaves less is kept."""
    left = {"whole": whole_left, "pieces": pieces_left}

    class Pieces:
        def __init__(self, name: str) -> None:
            self.name = name

        def in_one_piece(self) -> Pieces | None:
            return Pieces("whole") if self.name == "pieces" else None

        def free_run(self, _: object) -> float:
            return left[self.name]

    names: list[str] = []

    def explain(scene: Pieces, **_: bool) -> SimpleNamespace:
        names.append(scene.name)
        return SimpleNamespace(name=scene.name, fit=SimpleNamespace(point=None))

    monkeypatch.setattr(assumed_parameters, "_answered", explain)
    answer: Any = answered(Pieces("pieces"))  # type: ignore[arg-type]
    assert (names, answer.name) == (asked, kept)


@pytest.mark.parametrize(("count", "asked", "grows"), [(3, False, False), (4, False, True), (3, True, True)])
def test_a_list_that_was_cut_short_grows_where_its_tests_pass(
    count: int, asked: bool, grows: bool, scene: PlantScene, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Four effects are as many as a first list has: more may be there; of three, only where that is asked for."""
    fit = fitted(scene, start_of(scene))
    found = Explained(fit, (SimpleNamespace(),) * count, fit, scene)  # type: ignore[arg-type]
    said: list[bool] = []

    def gone_through(of: Explained, *, grow: bool) -> Explained:
        said.append(grow)
        return replace(of, added=())

    monkeypatch.setattr(assumed_parameters, "completed", gone_through)
    assert not complete(Answered(scene, scene, found), grow=asked).found.added
    assert said == [grows]


def test_the_share_of_its_power_that_a_simulation_leaves(scene: PlantScene) -> None:
    """Nothing of itself, all of it of its mean, a quarter of half of it; of a constant channel, over its noise."""
    recorded = scene.recorded["speed"]
    mean, n = float(np.mean(recorded.values)), scene.log.n
    simulated = np.full((n, 1), mean)
    assert recorded.share_left(simulated) == pytest.approx(1.0)
    simulated[recorded.at, 0] = mean + 0.5 * (recorded.values - mean)
    assert recorded.share_left(simulated) == pytest.approx(0.25)
    still = replace(recorded, values=np.zeros_like(recorded.values))
    assert still.share_left(np.full((n, 1), 2.0 * still.noise)) == pytest.approx(4.0)

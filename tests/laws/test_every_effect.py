"""The law: an effect that is declared is known in every layer, or is refused there in words with a remedy.

The effects are those of the catalogue, each at a strong size; a new one without an entry in `strong_effects` fails here.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from in_part import in_part
from strong_effects import ABSTRACT, EVERY, FAULTS, INERTIAL, REFERENCE, REST, SHARED, Strong

from kfgen.core.errors import InputError
from kfgen.effects import catalogue
from kfgen.effects.filter_role import Use
from kfgen.effects.noise_model import ChannelNoise, NoiseModel, Term, noise_text, parse_noise
from kfgen.log.log import Log
from kfgen.model.discretise import DiscreteModel
from kfgen.model.filter import FilterModel
from kfgen.model.library import build
from kfgen.simulate.simulate import simulate

MODELS = ("ahrs6", "ins15")
RATE_HZ = 50.0
DURATION_S = 40.0
PLACES = [(s, w, m) for s in (*REST, *INERTIAL, *FAULTS) for w in s.where for m in MODELS]


@lru_cache
def bare(name: str) -> FilterModel:
    return build(name)


def simulated(model: FilterModel) -> Log:
    return simulate(DiscreteModel.at_rate(model, RATE_HZ), "generic", DURATION_S, np.random.default_rng(1))


@lru_cache
def without(name: str) -> Log:
    return simulated(bare(name))


def differ(model: FilterModel, a: Log, b: Log) -> bool:
    """Whether any sensor of a model, or the time, differs."""
    if a.n != b.n or not np.array_equal(a.t, b.t):
        return True
    pairs = [(a.channels[c].values, b.channels[c].values) for c in model.channel_units]
    return any(not np.array_equal(x, y, equal_nan=True) for x, y in pairs)


def label(value: object) -> str:
    return value.name if isinstance(value, Strong) else str(value)


def test_every_effect_of_the_catalogue_is_tried() -> None:
    assert {s.name for s in EVERY} | ABSTRACT == set(catalogue())


@pytest.mark.parametrize("strong", EVERY, ids=label)
def test_a_written_effect_reads_back_as_it_was(strong: Strong) -> None:
    channel = ChannelNoise("rad/s", (Term(strong.effect),))
    text = noise_text(NoiseModel({"gyro_x": channel}))
    (back,) = parse_noise(text, "written").channel("gyro_x").terms
    for p in strong.effect.parameters():
        assert getattr(back.effect, p.name) == pytest.approx(getattr(strong.effect, p.name), rel=1e-6)


@pytest.mark.parametrize(("strong", "where", "name"), PLACES, ids=label)
def test_an_effect_changes_the_simulation_and_the_filter_or_is_refused_in_words(
    strong: Strong, where: str, name: str
) -> None:
    model = bare(name)
    if not model.channels_of(where):
        pytest.skip(f"{name} has no {where}")
    changed = model.augment(where, strong.effect)
    assert differ(model, simulated(changed), without(name))
    left_out = [o for o in changed.omitted if (o.where, o.effect) == (where, strong.name)]
    assert left_out or changed.hash != model.hash  # the quicker one first
    for o in left_out:
        assert o.why.strip()
        assert o.instead.strip()
        assert strong.name in o.sentence
        assert where in o.sentence


@pytest.mark.parametrize("name", MODELS)
def test_noise_that_two_channels_share_is_simulated_and_in_the_filter(name: str) -> None:
    (shared,) = SHARED
    model = bare(name)
    changed = model.augment("gyro_x", shared.effect).augment("gyro_y", shared.effect)
    assert changed.hash != model.hash
    assert differ(model, simulated(changed), without(name))


@pytest.mark.parametrize("strong", REFERENCE, ids=label)
def test_a_fault_of_the_reference_is_refused_by_the_simulation_and_left_out_of_the_filter(
    strong: Strong,
) -> None:
    changed = bare("ahrs6").augment("gyro_x", strong.effect)
    with pytest.raises(InputError, match=strong.name) as refused:
        simulated(changed)
    assert "Take" in str(refused.value)
    assert [o.effect for o in changed.omitted] == [strong.name]


@pytest.mark.parametrize("strong", in_part([s for s in INERTIAL if s.name != "earth_rate"], 4), ids=label)
def test_as_a_state_an_error_of_a_sensor_that_moves_has_states_or_is_refused(strong: Strong) -> None:
    for where in strong.where:
        for name in MODELS:
            model = bare(name)
            if model.channels_of(where):
                changed = model.augment(where, strong.effect, Use(known=False))
                known = model.augment(where, strong.effect)
                assert len(changed.states) > len(model.states) or changed.omitted
                assert changed.hash != known.hash or changed.omitted


def test_an_effect_that_forgets_what_it_is_in_a_filter_does_not_import(tmp_path: Path) -> None:
    """Fails before: such an effect was ignored by every filter."""
    source = tmp_path / "scratch.py"
    source.write_text(
        "from dataclasses import dataclass\n"
        "from kfgen.effects.effect import AddsNothingAtRest\n"
        "@dataclass(frozen=True)\n"
        "class Scratch(AddsNothingAtRest):\n"
        "    name = 'scratch'\n"
        "    title = 'scratch'\n",
        encoding="utf-8",
    )
    with pytest.raises(TypeError, match="in_filter"):
        exec(compile(source.read_text(encoding="utf-8"), "scratch", "exec"), {"__name__": "scratch"})

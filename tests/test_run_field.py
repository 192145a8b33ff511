"""A magnetic field that the log's first second says is no exact one: `run` says so where its innovations are too large.

Flights come from `benchmarks/flight`, plain numpy that shares no code with kfgen. With the field known from a tilted start
the velocities of seed 0 have a mean NIS of more than twice their number of rows; with the field as states their mean is
that of a consistent filter. Seeds are fixed.
"""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from in_part import in_part

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks" / "flight"))

from trial import Case, log_of  # type: ignore[import-not-found]

from kfgen.model.build import build
from kfgen.report.filter import run_answer
from kfgen.run.run import FilterRun, run

SENSORS = ["gnss_position", "gnss_velocity", "mag", "barometer"]


def flown(**options: str) -> FilterRun:
    """The filter with these options over the flight."""
    return run(build("ins15", options=options, sensors=SENSORS), log_of(Case("wing", 0, 60.0), []))


def test_a_field_of_the_first_second_that_is_assumed_exact_is_cautioned_of() -> None:
    found = flown(left_out="false", biases="constant")
    assert found.sensors["gnss_velocity"].nis.mean() > 6.0
    (said,) = found.cautions
    assert "--set field=state" in said
    assert "mag_N 19.9 uT" in said or "mag_N 20" in said
    answer = run_answer(found)
    assert answer.warnings == found.cautions
    assert any(said in str(p) for p in answer.page.parts)


@pytest.mark.parametrize(
    "options", in_part([{"left_out": "false", "biases": "constant", "field": "state"}, {}])
)
def test_nothing_is_said_of_a_field_that_is_a_state_or_has_noise_for_its_errors(
    options: dict[str, str],
) -> None:
    found = flown(**options)
    assert found.cautions == ()
    lo, hi = found.sensors["gnss_velocity"].expected_nis95
    assert lo < found.sensors["gnss_velocity"].nis.mean() < hi

"""Whether the course that a random error of a filter took is as random as its name says, see `kfgen.gap.core.random_course`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from kfgen.gap.core.random_course import COURSE_POINTS, not_random
from kfgen.gap.flight.linear.linear_flight import LinearFlight
from kfgen.gap.flight.path import FlownPath
from kfgen.gap.flight.random.random_error import random_error_of
from kfgen.gap.motion.truth import Truth
from kfgen.gap.scene.scene import Placed

Array = NDArray[np.float64]

CHANCE_COURSES = 399
"""Courses of white innovations."""


def none_of_a_random_error(path: FlownPath, truth: Truth, placed: Placed) -> str:
    """In what the course of a random error of a filter is none of a random error; empty where in nothing.

    Parameters
    ----------
    path : FlownPath
        With the error among its random_errors.
    truth : Truth
        What its sensors should have read.
    placed : Placed
        The error.
    """
    index = [(w.effect.name, w.where) for w in path.random_errors].index((placed.effect.name, placed.where))
    orders = [random_error_of(w, path.log.dt).order for w in path.random_errors]
    column = path.equations.n + sum(orders[:index])
    step = max(1, path.log.t.size // COURSE_POINTS)
    rng, linear = np.random.default_rng(0), path.linear
    course = linear.smoothed()[::step, column]
    drawn = np.column_stack([_by_chance(linear, rng)[::step, column] for _ in range(CHANCE_COURSES)])
    return not_random(path.log.t[::step], course, drawn, _companions(path, truth, step))


def _by_chance(linear: LinearFlight, rng: np.random.Generator) -> Array:
    """A smoothed course of all states that white innovations give, shape (n, states)."""
    e = np.sqrt(linear.S) * rng.standard_normal(linear.S.size)
    return replace(linear, e=e, c=np.zeros_like(linear.c), x0=np.zeros_like(linear.x0)).smoothed()


def _companions(path: FlownPath, truth: Truth, step: int) -> dict[str, Array]:
    """What the vehicle does and what was recorded beside it, each of shape (points,)."""
    out: dict[str, Array] = dict(path.log.drive)
    for name, values in (("the rate of turn", truth.omega_b), ("the specific force", truth.f_b)):
        if values is not None:
            out[name] = np.linalg.norm(values, axis=1)
    if truth.speed_squared is not None:
        out["the speed"] = np.sqrt(np.maximum(truth.speed_squared, 0.0))
    if truth.R_bn is not None:
        out |= {
            "the cosine of the heading": truth.R_bn[:, 0, 0],
            "the sine of the heading": truth.R_bn[:, 0, 1],
        }
    out["time"] = path.log.t
    return {n: v[::step] for n, v in out.items() if float(np.ptp(v)) > 0.0}

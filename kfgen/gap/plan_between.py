"""The verb `plan_between`: which manoeuvre distinguishes two effects."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

import kfgen
from kfgen.core.errors import InputError
from kfgen.core.numbers import finite, is_sampling_rate
from kfgen.core.result import Result, ShortTable
from kfgen.core.units import display_unit
from kfgen.effects.inertial.inertial_error import free
from kfgen.gap.flight.distinguish import after_memory, expected_nats
from kfgen.gap.flight.expected_flight import ExpectedFlights
from kfgen.gap.flight.flight_scene import MIN_INERTIAL_RATE_HZ
from kfgen.gap.flight.named_effect import placed_effect
from kfgen.gap.scene.scene import Placed
from kfgen.manoeuvre.composed import Course, at_speed, course, followed_by
from kfgen.manoeuvre.library import LIBRARY
from kfgen.manoeuvre.manoeuvre import Manoeuvre
from kfgen.model.build import ModelSource, filter_of
from kfgen.model.filter import FilterModel
from kfgen.simulate.simulate import WARMTH

WANTED_NATS = 10.0
"""From which on one of two effects is named with certainty: odds of 22 000 to one."""
PROMISING_SHARE = 0.02
"""Share of the wanted nats that two manoeuvres have together, at least, for both one after the other to be tried."""
DAY_S = 86400.0
NEGLIGIBLE_NATS = 1e-9
"""What rounding leaves of nothing."""


@dataclass(frozen=True)
class ManoeuvreNats:
    """What one manoeuvre is expected to say.

    Parameters
    ----------
    name, title : str
    length : float
        [s].
    extent : float
        Largest horizontal distance between two of its points [m].
    if_first, if_second : float
        Expected log Bayes factor where the first, or the second effect is there [nats].
    """

    name: str
    title: str
    length: float
    extent: float
    if_first: float
    if_second: float

    @property
    def nats(self) -> float:
        """Whichever of the two is there."""
        return min(self.if_first, self.if_second)

    def seconds_for(self, wanted: float) -> float:
        """How long it has to be repeated [s]; infinite where it says nothing."""
        return self.length * max(1.0, wanted / self.nats) if self.nats > 0.0 else np.inf


@dataclass(frozen=True, repr=False)
class BetweenPlan(Result):
    """Which manoeuvre distinguishes two effects.

    Parameters
    ----------
    model : str
        Name of the filter.
    first, second : str
        The effects with their places and sizes, in words.
    rate : float
        Of the inputs [Hz].
    manoeuvres : tuple of ManoeuvreNats
        Those of the library, by length; then those of two, one after the other, that were tried.
    too_wide : tuple of (str, float)
        Those that need more room, with their extent [m].
    wanted : float
        Expected log Bayes factor that is asked for [nats].
    """

    model: str
    first: str
    second: str
    rate: float
    manoeuvres: tuple[ManoeuvreNats, ...]
    too_wide: tuple[tuple[str, float], ...] = ()
    wanted: float = WANTED_NATS

    @property
    def shortest(self) -> ManoeuvreNats | None:
        """The shortest that reaches what is wanted; None where none does."""
        enough = [m for m in self.manoeuvres if m.nats >= self.wanted]
        return min(enough, key=lambda m: m.length, default=None)

    @property
    def sentence(self) -> str:
        """The answer."""
        found = self.shortest
        if found is not None:
            return (
                f"The shortest manoeuvre that distinguishes {self.first} from {self.second}: {found.name}, "
                f"{found.length:.3g} s, {found.nats:.3g} nats expected"
            )
        best = min(self.manoeuvres, key=lambda m: m.seconds_for(self.wanted))
        said = f"No manoeuvre has {self.wanted:g} nats between {self.first} and {self.second}"
        if best.nats <= 0.0:
            return f"{said}: none of them shows both effects, however long"
        times, seconds = best.seconds_for(self.wanted) / best.length, best.seconds_for(self.wanted)
        return (
            f"{said}: {best.name} has {best.nats:.2g} in {best.length:.3g} s and would have to be repeated "
            f"{np.ceil(times):.0f} times, for about {seconds:.3g} s"
        )

    def summary(self) -> list[str]:
        """The answer, and what was left out."""
        wide = ", ".join(f"{name} ({extent:.3g} m)" for name, extent in self.too_wide)
        return [self.sentence, *([f"left out, for they need more room: {wide}"] if wide else [])]

    def short_table(self) -> ShortTable:
        """Every manoeuvre."""
        head = (
            "manoeuvre",
            "length",
            "extent",
            "nats if the first",
            "nats if the second",
            f"{self.wanted:g} nats take",
        )
        rows = [
            [
                m.name,
                f"{m.length:.3g} s",
                f"{m.extent:.3g} m",
                _nats(m.if_first),
                _nats(m.if_second),
                self._long(m),
            ]
            for m in self.manoeuvres
        ]
        return head, rows

    def _long(self, m: ManoeuvreNats) -> str:
        seconds = m.seconds_for(self.wanted)
        if not np.isfinite(seconds):
            return "never"
        return f"{seconds:.3g} s" if seconds < DAY_S else "more than a day"

    def to_dict(self) -> dict[str, Any]:
        """Every manoeuvre with its nats, and the shortest that has enough; null where none has."""
        found = self.shortest
        return {
            "format": "kfgen-plan-between-1",
            "kfgen": kfgen.__version__,
            "model": self.model,
            "first": self.first,
            "second": self.second,
            "rate_hz": self.rate,
            "wanted_nats": self.wanted,
            "shortest": None if found is None else found.name,
            "sentence": self.sentence,
            "manoeuvres": [
                {
                    "manoeuvre": m.name,
                    "length_s": m.length,
                    "extent_m": m.extent,
                    "nats_if_first": m.if_first,
                    "nats_if_second": m.if_second,
                    "repeated_for_s": finite(m.seconds_for(self.wanted)),
                }
                for m in self.manoeuvres
            ],
            "too_wide": [{"manoeuvre": name, "extent_m": extent} for name, extent in self.too_wide],
        }


def _nats(value: float) -> str:
    return f"{value:.3g}" if value >= 0.01 else "none" if value == 0.0 else "below 0.01"


def plan_between(
    between: str | Sequence[str],
    model: ModelSource,
    rate: float = 100.0,
    *,
    speed: float | None = None,
    room: float | None = None,
) -> BetweenPlan:
    """The shortest manoeuvre of the library, or two of them one after the other, that distinguishes two effects.

    Parameters
    ----------
    between : str or sequence of str
        Two effects with their places, separated by a comma: ``time_delay@gnss_v,bandwidth@gnss_v``. Of typical size, or
        of that which is said: ``time_delay@gnss_p=0.1 s``, of one number of several ``hard_iron@mag:x=3 uT``.
    model : FilterModel, str or Path
        A filter with an attitude and a velocity, as `kfgen.build` gives or takes it.
    rate : float
        Samples of the inertial sensors per second [Hz]; aiding sensors have their usual rates.
    speed : float, optional
        Of the manoeuvres that begin at a speed [m/s]; their own where left out.
    room : float, optional
        Manoeuvres whose largest horizontal extent exceeds it [m] are left out.

    Returns
    -------
    BetweenPlan
        Nats are the expected log Bayes factor of the innovations, whichever of the two is there, see
        `kfgen.gap.flight.distinguish`.

    Raises
    ------
    InputError
        Not two effects, or one that is unknown, random or nowhere; a filter that no manoeuvre moves; a rate, a speed or
        a room that is none, or no manoeuvre in that room; or the extra ``kfgen[fast]`` is not installed.
    """
    built = filter_of(model)
    _check(rate, speed, room)
    first, second = _two(between, built)
    flights = ExpectedFlights(built, rate, _drivers(first, second))
    known = {m.name: m if speed is None else at_speed(m, speed) for m in LIBRARY.values()}
    courses = {n: course(m) for n, m in known.items()}
    near = {n: m for n, m in known.items() if room is None or courses[n].extent <= room}
    wide = [(n, courses[n].extent) for n in known if n not in near]

    def said(m: ManoeuvreOnCourse) -> ManoeuvreNats:
        scene = after_memory(flights.scene(m.manoeuvre), (first, second))
        nats = [expected_nats(scene, *pair) for pair in ((first, second), (second, first))]
        a, b = (n if n > NEGLIGIBLE_NATS else 0.0 for n in nats)
        return ManoeuvreNats(m.manoeuvre.name, m.manoeuvre.title, m.manoeuvre.length, m.course.extent, a, b)

    singles = [said(ManoeuvreOnCourse(m, courses[n])) for n, m in near.items()]
    found = sorted(singles, key=lambda m: m.length)
    for pair in _pairs(near, courses, {m.name: m for m in singles}):
        if pair.manoeuvre.length >= min((m.length for m in found if m.nats >= WANTED_NATS), default=np.inf):
            break
        if room is None or pair.course.extent <= room:
            found.append(said(pair))
    words = [_words(p, built) for p in (first, second)]
    return BetweenPlan(built.name, words[0], words[1], rate, tuple(found), tuple(wide))


@dataclass(frozen=True)
class ManoeuvreOnCourse:
    """A manoeuvre, and where it leads."""

    manoeuvre: Manoeuvre
    course: Course


def _pairs(
    near: dict[str, Manoeuvre], courses: dict[str, Course], said: dict[str, ManoeuvreNats]
) -> Iterator[ManoeuvreOnCourse]:
    """Two manoeuvres of which the second can begin where the first ends, the shortest first.

    Those that hardly say anything one by one are left out: what two say together is mostly the sum.
    """
    moving = [n for n, m in near.items() if m.name != "static"]
    both = sorted((near[a].length + near[b].length, a, b) for a in moving for b in moving)
    for _, a, b in both:
        sums = (said[a].if_first + said[b].if_first, said[a].if_second + said[b].if_second)
        if min(sums) < PROMISING_SHARE * WANTED_NATS or not courses[a].leads_into(courses[b]):
            continue
        made = followed_by(near[a], near[b])
        yield ManoeuvreOnCourse(made, course(made))


def _check(rate: float, speed: float | None, room: float | None) -> None:
    """Raise `InputError` where a rate, a speed or a room is none."""
    if not is_sampling_rate(rate) or rate < MIN_INERTIAL_RATE_HZ:
        raise InputError(
            f"--rate must be {MIN_INERTIAL_RATE_HZ:g} Hz or more for a filter in flight (got {rate:g})",
            remedy="Give the rate of the inertial sensors, --rate 100 for example",
        )
    for name, value, unit in (("--speed", speed, "m/s"), ("--room", room, "m")):
        if value is not None and not 0.0 < value < np.inf:
            raise InputError(f"{name} must be positive (got {value:g})", remedy=f"Give it in {unit}")


def _two(between: str | Sequence[str], model: FilterModel) -> tuple[Placed, Placed]:
    """Two different effects."""
    names = between.split(",") if isinstance(between, str) else list(between)
    if len(names) != 2:
        raise InputError(
            f"a manoeuvre is planned between two effects, and {len(names)} were named",
            where="--between",
            remedy="Write --between time_delay@gnss_v,bandwidth@gnss_v for example",
        )
    first, second = (placed_effect(name, model, "--between") for name in names)
    same = type(first.effect) is type(second.effect) and first.where == second.where
    if same and {p.name for p in free(first.effect)} == {p.name for p in free(second.effect)}:
        raise InputError(
            f"{first.effect.name} of {first.where} is both effects",
            where="--between",
            remedy="Name two different ones",
        )
    return first, second


def _drivers(*placed: Placed) -> tuple[str, ...]:
    """What is logged beside the filter's own channels, for effects that follow it."""
    warm = [WARMTH for p in placed if "warmth" in getattr(p.effect, "needs", ())]
    return tuple(dict.fromkeys([*(p.effect.driver for p in placed if p.effect.driver), *warm]))


def _words(placed: Placed, model: FilterModel) -> str:
    """An effect with its place and sizes."""
    unit = display_unit(model.channel_units[model.channels_of(placed.where)[0]])
    row = placed.effect.row(unit)
    sizes = ", ".join(
        f"{p.name} = {row[p.name][0]:.3g} {row[p.name][1]}".rstrip() for p in free(placed.effect)
    )
    return f"{placed.effect.name} of {placed.where} ({sizes})"

"""Shows hostile inputs to parsers, readers and the command line: each refuses in words or answers in numbers, in time."""

from __future__ import annotations

import math
import signal
import traceback
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from types import FrameType

from hostile import KINDS, NO_NUMBER, Commands, Files, Texts
from typer.testing import Result

from kfgen.core.errors import KfgenError
from kfgen.core.expression import read_expression
from kfgen.core.units import parse_quantity, parse_unit
from kfgen.effects.noise_model import parse_noise
from kfgen.log.readers import read_log
from kfgen.manoeuvre.file import parse_manoeuvre
from kfgen.model.filter_file import parse_filter
from kfgen.model.plant.file import parse_model

Cli = Callable[..., Result]
LIMIT_S = 10
"""Seconds of the processor that a small input may take."""
RECORDINGS = {"BIN": "flights/ardupilot_1s.BIN", "ulg": "flights/px4_appended_multiple.ulg"}
"""Recordings whose beginnings are damaged, by suffix."""
BEGINNING_BYTES = 24_000


class Hang(BaseException):
    """An input that takes too long."""


def _alarm(_: int, __: FrameType | None) -> None:
    raise Hang


@contextmanager
def in_time() -> Iterator[None]:
    """Raises `Hang` in what takes longer than the limit."""
    before = signal.signal(signal.SIGPROF, _alarm)
    signal.setitimer(signal.ITIMER_PROF, LIMIT_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)


def wrong_with(call: Callable[[], str]) -> str:
    """What is wrong with a call that says itself what is wrong with its answer; nothing where it refuses in words."""
    try:
        with in_time(), warnings.catch_warnings():
            warnings.simplefilter("error", RuntimeWarning)
            return call()
    except KfgenError as error:
        return "" if str(error).strip() else "refuses without a word"
    except Hang:
        return "hangs"
    except Exception as error:
        place = traceback.extract_tb(error.__traceback__)[-1]
        where = next(
            (f for f in reversed(traceback.extract_tb(error.__traceback__)) if "/kfgen/" in f.filename), place
        )
        return f"{type(error).__name__} at {Path(where.filename).name}:{where.lineno}: {error}"[:300]


def _unit(texts: Texts) -> str:
    factor = parse_unit(texts.unit()).factor
    return "" if math.isfinite(factor) and factor > 0.0 else f"a factor of {factor}"


def _quantity(texts: Texts) -> str:
    value = parse_quantity(texts.quantity(), texts.often("rad/s", ("m", "s", "1"), 0.3))
    return "" if math.isfinite(value) else f"a value of {value}"


def _formula(texts: Texts) -> str:
    read_expression(texts.formula(), ("theta", "u", "omega"))
    return ""


def _noise(texts: Texts) -> str:
    for channel in parse_noise(texts.broken(texts.noise()), "n.toml").channels.values():
        for effect in channel.effects:
            numbers = [getattr(effect, p.name) for p in effect.parameters()]
            if not all(math.isfinite(v) for v in numbers if isinstance(v, float)):
                return f"an effect with {numbers}"
    return ""


def _model(texts: Texts) -> str:
    parse_model(texts.broken(texts.model()), "p.toml")
    return ""


def _filter(texts: Texts) -> str:
    parse_filter(texts.broken(texts.filter()), "f.toml")
    return ""


def _manoeuvre(texts: Texts) -> str:
    parse_manoeuvre(texts.broken(texts.manoeuvre()), "m.toml")
    return ""


TEXTS = {f.__name__[1:]: f for f in (_unit, _quantity, _formula, _noise, _model, _filter, _manoeuvre)}
"""What is shown to each parser, by kind."""


def _read(suffix: str, data: bytes) -> str:
    path = Path(f"hostile.{suffix}")
    path.write_bytes(data)
    read_log(path)
    return ""


def trials(kind: str, seed: int, count: int, data: Path | None = None) -> Iterator[str]:
    """What is wrong with each of so many inputs of a kind: of a text, or of a format, read in this folder."""
    if kind in TEXTS:
        texts = Texts(seed)
        yield from (wrong_with(partial(TEXTS[kind], texts)) for _ in range(count))
        return
    files, begun = Files(seed), b""
    if kind in RECORDINGS:
        assert data is not None
        begun = (data / RECORDINGS[kind]).read_bytes()[:BEGINNING_BYTES]
    for _ in range(count):
        content = files.damaged(begun, 0.0) if begun else files.file(kind)
        yield wrong_with(partial(_read, KINDS.get(kind, kind), content))


def wrong_command(kfgen: Cli, words: list[str]) -> str:
    """What is wrong with a command: a traceback, a number that is none, a refusal without a word."""

    def call() -> str:
        done = kfgen(*words)
        if done.exit_code not in (0, 1, 2):
            return f"exit status {done.exit_code}"
        if done.exit_code != 2 and (match := NO_NUMBER.search(done.stdout)):
            return f"says {match.group()}"
        return "refuses without a word" if done.exit_code == 2 and not str(done.exception) else ""

    return wrong_with(call)


def commands(kfgen: Cli, seed: int, count: int, of: type[Commands] = Commands) -> Iterator[str]:
    """What is wrong with each of so many commands."""
    inputs = of(seed)
    for _ in range(count):
        words = inputs.command()
        wrong = wrong_command(kfgen, words)
        yield f"{words}: {wrong}" if wrong else ""

"""The JSON schemas of kfgen's files: written from the code, true of every file that is shown, false of broken ones."""

from __future__ import annotations

import copy
import json
import re
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest

from kfgen.core.errors import InputError
from kfgen.effects import catalogue
from kfgen.effects.noise_model import parse_noise
from kfgen.manoeuvre.file import parse_manoeuvre
from kfgen.model.filter_file import parse_filter
from kfgen.model.plant.file import parse_model

jsonschema = pytest.importorskip("jsonschema")
ROOT = Path(__file__).resolve().parents[1]
SCHEMAS = ROOT / "docs" / "schemas"
READERS = {"noise": parse_noise, "model": parse_model, "filter": parse_filter, "manoeuvre": parse_manoeuvre}
SHOWN = [*sorted((ROOT / "examples").rglob("*.toml")), *sorted((ROOT / "docs").rglob("*.md"))]


def kind_of(text: str) -> str:
    """``noise`` of a text that begins with ``format = "kfgen-noise-1"``."""
    return str(tomllib.loads(text)["format"]).split("-")[1]


def texts() -> list[tuple[str, str]]:
    """Every file of ours that the examples have and the pages show, with where it is."""
    found = []
    for path in SHOWN:
        text = path.read_text(encoding="utf-8")
        blocks = re.findall(r"```toml\n(.*?)```", text, re.S) if path.suffix == ".md" else [text]
        found += [(path.name, b) for b in blocks if 'format = "kfgen-' in b]
    return found


def validator(kind: str) -> Any:
    """The validator of a format."""
    schema = json.loads((SCHEMAS / f"{kind}.schema.json").read_text(encoding="utf-8"))
    jsonschema.Draft7Validator.check_schema(schema)
    return jsonschema.Draft7Validator(schema)


def holds(kind: str, document: object) -> bool:
    return bool(validator(kind).is_valid(document))


def test_schemas_are_those_that_the_code_declares(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "tools"))
    import schemas

    assert {p.name for p in SCHEMAS.iterdir()} == set(schemas.texts())
    for name, text in schemas.texts().items():
        same = (SCHEMAS / name).read_text(encoding="utf-8") == text
        assert same, (
            f"{name} is not what the code declares; run: {Path(sys.executable).name} tools/schemas.py"
        )


@pytest.mark.parametrize(("name", "text"), texts(), ids=[f"{n}-{k}" for k, (n, _) in enumerate(texts())])
def test_what_is_shown_is_read_and_holds(name: str, text: str) -> None:
    kind = kind_of(text)
    READERS[kind](text, name)
    errors = [e.message for e in validator(kind).iter_errors(tomllib.loads(text))]
    assert errors == []


def test_every_format_is_among_the_examples() -> None:
    files = [p.read_text(encoding="utf-8") for p in (ROOT / "examples").rglob("*.toml")]
    assert {kind_of(f) for f in files} == set(READERS)
    assert all(f"{kind_of(f)}.schema.json" in f.splitlines()[0] for f in files)


BROKEN = [
    ("noise", 'N = "0.0035', 'M = "0.0035', "an unknown parameter"),
    ("noise", '"white_noise", N', '"white_nose", N', "an unknown effect"),
    ("noise", '{ effect = "white_noise", N = "120 ug/sqrt(Hz)" }', '{ effect = "white_noise" }', "no size"),
    ("noise", 'N = "120', 'N = "a hundred', "no number"),
    ("noise", 'unit = "m/s^2"\n', "", "no unit"),
    ("noise", 'as = "known"', 'as = "sure"', "an unknown use"),
    ("noise", 'adev_min = "3.8 deg/h", ', "", "neither sigma nor another name of it"),
    ("model", "[measurements.angle]", "[measurement.angle]", "an unknown table"),
    ("model", 'expression = "theta"\n', "", "no expression"),
    ("model", 'initial = "0.1 rad", ', "", "an sd without an initial value"),
    ("model", '"viscous_friction"', '"white_noise"', "an effect of a channel in the dynamics"),
    ("filter", 'model = "ins15"', 'model = "ins16"', "an unknown model"),
    ("filter", "[limits]", "[limit]", "an unknown table"),
    ("filter", 'value = "0 deg", ', "", "an initial sd without a value"),
    ("manoeuvre", "rate = [0, 0, ", "rate = [0, ", "two of three axes"),
    ("manoeuvre", 'duration = "10 s"\n', "", "no duration"),
    ("manoeuvre", "velocity", "speed", "an unknown key"),
]


@pytest.mark.parametrize(("kind", "old", "new", "what"), BROKEN, ids=[f"{k}: {w}" for k, _, _, w in BROKEN])
def test_a_broken_file_does_not_hold_and_is_refused(kind: str, old: str, new: str, what: str) -> None:
    files = [p.read_text(encoding="utf-8") for p in (ROOT / "examples" / "files").glob("*.toml")]
    (good,) = [f for f in files if kind_of(f) == kind]
    assert good.count(old) >= 1
    bad = good.replace(old, new, 1)
    assert not holds(kind, tomllib.loads(bad))
    if what != "an unknown model":  # said when it is built
        with pytest.raises(InputError):
            READERS[kind](bad, "bad.toml")


def test_every_effect_holds_as_it_is_written() -> None:
    """An entry with all parameters, of every effect: where the schema is stricter than the reader it is wrong."""
    check = validator("model")
    base = {"format": "kfgen-model-1", "name": "a"}
    own = {n: c for n, c in catalogue().items() if c.__module__.startswith("kfgen.")}
    for name, cls in own.items():
        entry = {"effect": name} | {p.name: 1.0 for p in cls.parameters()}
        on_channel = {"unit": "rad/s", "expression": "x", "effects": [entry]}
        places = ({"measurements": {"y": on_channel}}, {"dynamics_effects": {"x": [entry]}})
        held = [check.is_valid(base | place) for place in places]
        assert held.count(True) == 1, name
        wrong = copy.deepcopy(entry) | {"no_such": 1.0}
        assert not check.is_valid(base | {"dynamics_effects": {"x": [wrong]}})

"""Every message and every remedy fits into two lines of a terminal of 80 columns."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

pytestmark = pytest.mark.quick

CODE = sorted((Path(__file__).resolve().parents[1] / "kfgen").rglob("*.py"))
ERRORS = ("InputError", "MissingExtra")
MAX_CHARACTERS = 160
CHARACTERS_OF_A_VALUE = 8
"""That is put into a text when it is said."""


def characters(text: ast.expr) -> int:
    """Of a text as it stands in the code."""
    if isinstance(text, ast.Constant):
        return len(text.value) if isinstance(text.value, str) else CHARACTERS_OF_A_VALUE
    if isinstance(text, ast.JoinedStr):
        return sum(characters(v) for v in text.values)
    if isinstance(text, ast.BinOp):
        return characters(text.left) + characters(text.right)
    if isinstance(text, ast.IfExp):
        return max(characters(text.body), characters(text.orelse))
    return CHARACTERS_OF_A_VALUE


def too_long(code: str) -> list[int]:
    """Lines of errors whose message or remedy is longer."""
    found = []
    for call in ast.walk(ast.parse(code)):
        if isinstance(call, ast.Call) and isinstance(call.func, ast.Name) and call.func.id in ERRORS:
            texts = [*call.args[:1], *(k.value for k in call.keywords if k.arg in ("message", "remedy"))]
            if any(characters(t) > MAX_CHARACTERS for t in texts):
                found.append(call.lineno)
    return found


def test_messages_are_short() -> None:
    assert {str(p): lines for p in CODE if (lines := too_long(p.read_text(encoding="utf-8")))} == {}


def test_a_long_message_is_found() -> None:
    assert too_long(f'raise InputError("{161 * "a"}")') == [1]
    assert too_long(f'raise InputError("short", remedy=f"{{x}}{155 * "a"}")') == [1]
    assert not too_long(f'raise InputError("{160 * "a"}")')

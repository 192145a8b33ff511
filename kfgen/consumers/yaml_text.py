"""Parameters as lines of YAML that every reader takes for numbers."""

from __future__ import annotations

from collections.abc import Mapping

from kfgen.consumers.base import Value


def real(number: float) -> str:
    """A number that every YAML reader takes for one: with a point and a signed exponent."""
    mantissa, e, exponent = f"{number:.7g}".partition("e")
    return f"{mantissa if '.' in mantissa else mantissa + '.0'}{e}{exponent}"


def yaml_lines(values: Mapping[str, Value], indent: str = "") -> list[str]:
    """A line for each parameter: the key, its number or its list, and the words as a comment.

    Parameters
    ----------
    values : mapping of str to Value
        By key; one without numbers becomes a comment.
    indent : str
        Before each line.

    Returns
    -------
    list of str
    """
    lines = []
    for name, v in values.items():
        if not v.numbers:
            lines.append(f"{indent}# {name}: {v.words}")
            continue
        shown = real(v.numbers[0]) if len(v.numbers) == 1 else f"[{', '.join(map(real, v.numbers))}]"
        lines.append(f"{indent}{name}: {shown}  # [{v.unit}] {v.words}")
    return lines

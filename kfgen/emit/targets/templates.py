"""Where the templates are, and how they are filled: layout only, no arithmetic in them."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import jinja2


@cache
def template_folder() -> Path:
    """The folder of the templates: in the installed package, else beside it in the checkout."""
    package = Path(__file__).resolve().parents[2]
    inside = package / "templates"
    return inside if inside.is_dir() else package.parent / "templates"


@cache
def _environment(markup: bool) -> jinja2.Environment:
    return jinja2.Environment(
        loader=jinja2.FileSystemLoader(template_folder()),
        autoescape=markup,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )


def render(template: str, *, markup: bool = False, **values: Any) -> str:
    """Fill a template.

    Parameters
    ----------
    template : str
        Path below the templates' folder.
    markup : bool
        Escape values for HTML.
    """
    return _environment(markup).get_template(template).render(**values)

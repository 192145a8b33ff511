"""Late import of statsmodels, the library of time series (the extra ``kfgen[arma]``)."""

from __future__ import annotations

import importlib
from typing import Any

from kfgen.core.errors import MissingExtra


def statsmodels(module: str) -> Any:
    """A module of statsmodels, as ``statsmodels("tsa.stattools")``.

    Raises
    ------
    MissingExtra
        It is not installed.
    """
    try:
        return importlib.import_module(f"statsmodels.{module}")
    except ImportError:
        raise MissingExtra(
            "time series need statsmodels, which is not installed",
            remedy="Install it with: pip install 'kfgen[arma]'",
        ) from None

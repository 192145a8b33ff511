"""Late import of statsmodels, the library of time series (the extra ``kfgen[arma]``)."""

from __future__ import annotations

from typing import Any

from kfgen.core.optional_library import optional_library


def statsmodels(module: str) -> Any:
    """A module of statsmodels, as ``statsmodels("tsa.stattools")``.

    Raises
    ------
    MissingExtra
        It is not installed.
    """
    return optional_library(f"statsmodels.{module}", "arma", "time series need")

"""What the tests share: where recordings are, and the command line in process."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

DATA = Path(os.environ.get("KFGEN_DATA") or Path(__file__).resolve().parents[2] / "shared" / "data")


QUICK = {
    *(
        "test_units",
        "test_expression",
        "test_linear",
        "test_norm",
        "test_npy",
        "test_noise_file",
        "test_user_model",
    ),
    *("test_gap_search", "test_simulate", "test_readers"),
    *("test_effects", "test_every_effect", "test_core_formulas"),
}
"""Modules that `make test-quick` runs: a part of every layer, within a minute on two cores."""


LIBRARIES = ("test_reader", "test_arma", "test_contents")
"""How modules begin whose tests lean on the libraries of extras."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark what is quick, and what the lowest versions must pass."""
    for item in items:
        if item.path.stem in QUICK:
            item.add_marker(pytest.mark.quick)
        if item.path.stem in QUICK or item.path.stem.startswith(LIBRARIES):
            item.add_marker(pytest.mark.lowest)


@pytest.fixture(scope="session")
def recording() -> Callable[[str], Path]:
    """The path of a real recording; skips, saying so, where it is absent."""

    def find(name: str) -> Path:
        path = DATA / name
        if not path.is_file():
            pytest.skip(f"the recording {name} is not here (set KFGEN_DATA)")
        return path

    return find


@pytest.fixture
def kfgen() -> Callable[..., Result]:
    """The command line: returns exit status and output; errors of kfgen become its exit status."""
    from kfgen.cli.app import app
    from kfgen.core.errors import KfgenError

    def call(*words: object) -> Result:
        result = CliRunner().invoke(app, [str(w) for w in words])
        if isinstance(result.exception, KfgenError):
            result.exit_code = result.exception.exit_status
        elif result.exception is not None and not isinstance(result.exception, SystemExit):
            raise result.exception
        return result

    return call

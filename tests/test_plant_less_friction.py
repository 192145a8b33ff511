"""Proves that friction of which a model has too much is named, by records that are no simulation of kfgen's.

A cart on a spring by the closed solution of its equation, one record each with a seed that is fixed.
"""

from __future__ import annotations

from pathlib import Path

import driven_cart
import numpy as np
import pytest
from in_part import in_part

FRICTION = {
    "quadratic_drag": ("0.8*v*abs(v)", "coefficient", 0.8),
    "coulomb_friction": ("0.4*tanh(1000*v)", "level", 0.4),
}


@pytest.mark.parametrize("name", in_part(FRICTION))
def test_friction_that_a_model_has_and_the_plant_lacks(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With its size, to a twentieth; fails before: it was refused, and other effects stood in for it."""
    words, parameter, size = FRICTION[name]
    model = driven_cart.CART.replace("(u - k*q - c*v)/m", f"(u - k*q - c*v)/m - {words}")
    monkeypatch.setattr(driven_cart, "CART", model)
    found = driven_cart.gap_of(tmp_path, *driven_cart.cart(np.random.default_rng(7)))
    assert found.verdict == "effects_found"
    (finding,) = found.findings
    assert (finding.name, finding.where) == (name, "v")
    assert getattr(finding.effect, parameter) == pytest.approx(-size, rel=0.05)

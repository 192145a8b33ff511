"""kfgen: from a log of a real sensor to a Kalman filter that is proven on its target.

The conventions of the whole package are stated here and nowhere else.

Units
    SI and radians inside. Units are converted where data comes in (`readers`,
    files) and where it goes out (`report`, the command line), by `kfgen.core.units`.
Frames
    ``b`` body (x forward, y right, z down), ``n`` navigation: local level,
    north-east-down. A vector carries its frame as suffix, ``v_n``. A rotation
    ``R_nb`` takes body coordinates to navigation coordinates: ``v_n = R_nb v_b``.
Quaternions
    Scalar first, Hamilton product, ``q_nb`` body to navigation frame.
Errors
    true = estimate "plus" error: additive for vectors, ``R_nb = Exp(phi) R_nb_hat``
    for attitudes, so that ``phi`` has navigation axes (the phi-angle convention).
    Other conventions are chosen by name (`kfgen.model.symbols.convention`); so are Earth
    axes as navigation axes, in which ``n`` stands for them.
Noise
    Densities are two-sided (IEEE Std 952-1997, annex C): white noise ``N`` has the
    power spectral density ``N**2`` and, sampled every ``dt``, the standard
    deviation ``N / sqrt(dt)``.
Paper letters
    ``F`` dynamics, ``G`` noise input, ``H`` measurement, ``P`` covariance, ``Phi``
    transition, ``Qd`` discrete process noise, ``R`` measurement noise,
    ``S`` innovation covariance, ``K`` gain; ``n`` samples, ``dt`` sampling period.
Verbs
    ``import kfgen as kf``: ``kf.identify``, ``kf.build``, ``kf.emit`` ... are functions, each in its own folder; what
    they give back is frozen, with a short ``repr``, ``to_dict()`` (the JSON of the command) and ``plot()``.
"""

from __future__ import annotations

import importlib
import sys
from types import ModuleType
from typing import Any

__version__ = "0.2.0"

VERBS = {
    "audit": "kfgen.run.audit",
    "build": "kfgen.model.build",
    "calibrate": "kfgen.calibrate.calibrate",
    "contents": "kfgen.log.contents",
    "convert": "kfgen.consumers",
    "denoise": "kfgen.run.adaptive.denoise_log",
    "derive": "kfgen.model.derive",
    "emit": "kfgen.emit.emit",
    "find_gap": "kfgen.gap.find_gap",
    "fleet": "kfgen.fleet.fleet",
    "identify": "kfgen.identify.identify_log",
    "judge": "kfgen.gap.judge.judge",
    "list_all": "kfgen.catalogue",
    "load": "kfgen.model.files",
    "plan": "kfgen.identify.plan",
    "plan_between": "kfgen.gap.plan_between",
    "read_log": "kfgen.log.readers",
    "run": "kfgen.run.run",
    "save": "kfgen.model.files",
    "simulate": "kfgen.simulate.simulate_log",
    "tune": "kfgen.gap.flight.noise.tune",
    "verify": "kfgen.verify.compare",
    "write_log": "kfgen.log.readers",
}
"""Verbs, and the module of each; a module is imported when its verb is first named."""
TYPES = {"Channel": "kfgen.log.log", "Log": "kfgen.log.log", "NoiseModel": "kfgen.effects.noise_model"}
"""The types that a caller makes, and the module of each."""

__all__ = ["__version__", *sorted(VERBS | TYPES)]  # noqa: PLE0604 - from the tables


def __getattr__(name: str) -> Any:
    """A verb or type, imported when it is first named (PEP 562): ``import kfgen`` alone is light."""
    home = (VERBS | TYPES).get(name)
    if home is None:
        raise AttributeError(f"module 'kfgen' has no attribute '{name}'")
    found = getattr(importlib.import_module(home), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


class _Package(ModuleType):
    """`kfgen` itself, in which a verb is not hidden by the package of the same name (``kfgen.audit``).

    Modules of such a package are imported as ``from kfgen.audit import degree``.
    """

    def __setattr__(self, name: str, value: Any) -> None:
        if not (name in VERBS and isinstance(value, ModuleType)):  # what the import system binds
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package

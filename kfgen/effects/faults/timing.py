"""A wrong sampling rate, where the header of a log contradicts its own number of samples."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from kfgen.effects.effect import parameter
from kfgen.effects.faults.samples import Fault
from kfgen.effects.series import DetectedFault, RawSamples
from kfgen.log.log import RATE_RELATIVE_TOLERANCE


@dataclass(frozen=True)
class SampleRateError(Fault):
    """Samples came `factor` times as fast as the log's times say."""

    factor: Any = parameter("", "size")

    name: ClassVar[str] = "sample_rate_error"
    title: ClassVar[str] = "a wrong sampling rate"
    sentence_template: ClassVar[str] = (
        "was sampled {factor} times as fast as its times say: give the true rate"
    )

    @classmethod
    def detect_fault(cls, raw: RawSamples) -> DetectedFault | None:
        """More or fewer samples than fit into the time that the log says it lasted."""
        factor = raw.n * raw.dt / raw.stated if raw.stated > 0.0 else 1.0
        return (
            DetectedFault(cls(factor), float(raw.n)) if abs(factor - 1.0) > RATE_RELATIVE_TOLERANCE else None
        )

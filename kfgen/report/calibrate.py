"""The answer of ``calibrate``: text and page of a `Calibration`."""

from __future__ import annotations

from kfgen.calibrate.result import CalibratedSensor, Calibration
from kfgen.report.page import Answer, Page, columns, heading, sentence, table, text

HEAD = ("where", "effect", "parameter", "value", "95 % interval")


def calibrate_answer(found: Calibration) -> Answer:
    """Text, JSON and page of what was calibrated."""
    lines, parts = [], []
    for sensor in found.sensors:
        rows = _rows(sensor)
        lines += ["", sensor.sentence, columns(rows)]
        parts += [
            heading(sensor.sensor),
            sentence(f"{sensor.sentence}."),
            table(HEAD, rows),
            *(text(w) for w in sensor.warnings),
        ]
    page = Page(f"Calibration from {found.logs[0][0].rsplit('/', 1)[-1]}", tuple(parts))
    return Answer("\n".join(lines).lstrip("\n"), found.to_dict(), page, warnings=found.warnings)


def _rows(sensor: CalibratedSensor) -> list[list[str]]:
    """A row for each number."""
    return [
        [e.where, e.effect, e.parameter, f"{value:.4g} {unit}", f"95 % {lo:.4g} to {hi:.4g}"]
        for e, value, lo, hi, unit in sensor.rows()
    ]

"""Rest found from inertial samples, and v = 0 fused while it lasts: the sensor ``zero_velocity``, without a caller.

A body rests where samples have been quiet for `ALIGN_TIME` in a row, as alignment has it (`kfgen.emit.watch.quiet`), and the
filter's own speed is below `REST_MAX_SPEED`: an accelerometer cannot tell rest from uniform motion, the filter can as
long as it knows its velocity [1]_. The means forget after twice that time. Then the sensor ``zero_velocity`` is given
zeros every `REST_SPACING`, with its own noise and gate: what shakes a body at rest is not new with each sample.

References
----------
.. [1] P. Geneva, K. Eckenhoff, W. Lee, Y. Yang, G. Huang, OpenVINS: a research platform for visual-inertial
   estimation, IEEE International Conference on Robotics and Automation, 2020 (its update has a largest speed too).
"""

from __future__ import annotations

from kfgen.emit.align import ALIGN_TIME_S, Alignment
from kfgen.model.filter import FilterModel
from kfgen.model.parts.aiding import ZeroVelocity
from kfgen.model.parts.constant import Constant
from kfgen.model.parts.motion import ACCEL, GYRO
from kfgen.model.parts.sensors import Sensor

ROUTINE = "detect_rest"
PLACES = (
    ("AT_REST", "rest: for so long [s]; 0 where the body moves"),
    ("REST_REASON", "rest: why the body was not at rest last, a kf_reason_t"),
    ("REST_WAITED", "rest: since v = 0 was given last [s]"),
    ("REST_GATHERED", "rest: quiet for so long, as far as the means remember [s]"),
    ("REST_COUNT", "rest: samples in the means"),
    *((f"REST_FORCE_{a}", f"rest: sum of the specific force, {a.lower()}") for a in "XYZ"),
)
SETTINGS = (
    Constant("REST_MAX_SPEED", "m/s", 0.5, "a body that the filter thinks faster is not at rest"),
    Constant("REST_SPACING", "s", 0.2 * ALIGN_TIME_S, "at rest v = 0 is fused once in so long"),
)
TEXT = (
    "An inertial sample, after its prediction: where the body has been at rest for ALIGN_TIME (AT_REST is not zero), "
    "v = 0 is fused every REST_SPACING, and the status is that of the update; OK elsewhere."
)


def resting(model: FilterModel) -> Sensor | None:
    """The sensor that shows v = 0 of a body at rest; None of a filter without it, or without inertial inputs."""
    inputs = {i.name for i in model.motion.inputs}
    if not (Alignment(model).possible and inputs >= {ACCEL.name, GYRO.name}):
        return None
    return next((s for s in model.sensors if s.name == ZeroVelocity.name), None)

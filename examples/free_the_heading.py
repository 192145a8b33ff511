"""What an inertial filter with GNSS cannot see at rest, and whether a manoeuvre of one's own would show it.

The manoeuvre is written as in a file for `kfgen audit --manoeuvre`: ten seconds of speeding up to the north, ten of a
turn. The answer is exact, whatever the noise; how well the heading then shows is another question, and is answered too.
"""

from __future__ import annotations

import math

from kfgen.audit.audit import audit
from kfgen.audit.degree import Horizon
from kfgen.manoeuvre.file import parse_manoeuvre
from kfgen.manoeuvre.library import LIBRARY
from kfgen.model.library import build

LEAVE = """
format = "kfgen-manoeuvre-1"
name = "leave"
[[segment]]
duration = "10 s"
acceleration = ["1 m/s^2", 0, 0]
[[segment]]
duration = "10 s"
rate = [0, 0, "9 deg/s"]
body_acceleration = [0, "10*9*pi/180", 0]
"""

model = build("ins15")
answer = audit(model, (LIBRARY["static"], parse_manoeuvre(LEAVE, "leave.toml")), Horizon(20.0, 10.0))
print("at rest:")
for direction in answer.first.directions:
    print(f"  {direction.sentence}; made observable by {', '.join(direction.freed_by)}")

leave = answer.audits[1]
heading = [s.name for s in model.states].index("phi_D")
sigma = math.degrees(leave.degree.sigma[-1, heading])
print(f"leave: {leave.nullity} of {leave.states} hidden; heading to {sigma:.2f} deg after 20 s")

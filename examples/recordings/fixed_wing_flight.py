"""The same fixed wing without a reference: what the innovations of its filter say of its receiver.

Recording: P. Riseborough, InertialNav (BSD-3), who gives 0.23 s as the delay of its velocity and 0.21 s of its position.
Its magnetometer follows the motor, whose current is not in the log, and is left out.
"""

from pathlib import Path

from common import Case, main, of_log
from fixed_wing import flight as flown

import kfgen as kf
from kfgen.effects import make
from kfgen.effects.noise_model import ChannelNoise, NoiseModel, Term

NOISE = NoiseModel(
    {
        "gyro": ChannelNoise("rad/s", (Term(make("white_noise", N=5e-3)),)),
        "accel": ChannelNoise("m/s^2", (Term(make("white_noise", N=0.1)),)),
        "gnss_p": ChannelNoise("m", (Term(make("sample_noise", sd=2.0)),)),
        "gnss_v": ChannelNoise("m/s", (Term(make("sample_noise", sd=0.3)),)),
    }
)


def flight(file: Path) -> Case:
    """A receiver that is late in velocity and position."""
    log, _ = flown(file)
    return of_log(log, kf.build("ins15", noise=NOISE))


if __name__ == "__main__":
    main(str(__doc__), {"fixed-wing": ("dynamic/inertialnav_swisslog1.npz", flight)})

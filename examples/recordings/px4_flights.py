"""Two PX4 logs without a GNSS fix: what the innovations of a filter with barometer and magnetometer say of these two.

Recordings: PX4 flight-review-rs (MIT). One has a GNSS receiver that is jammed and has no fix, one has no receiver and ends
as its battery does; neither has a reference. What is missing from this filter nobody knows: no name may be certain.
"""

from pathlib import Path

from common import Case, main, of_log

import kfgen as kf
from kfgen.effects import make
from kfgen.effects.noise_model import ChannelNoise, NoiseModel, Term

NOISE = NoiseModel(
    {
        "gyro": ChannelNoise("rad/s", (Term(make("white_noise", N=5e-3)),)),
        "accel": ChannelNoise("m/s^2", (Term(make("white_noise", N=0.1)),)),
        "baro": ChannelNoise("m", (Term(make("sample_noise", sd=0.3)),)),
        "mag": ChannelNoise("T", (Term(make("sample_noise", sd=1e-6)),)),
    }
)


def flight(file: Path) -> Case:
    """Height by the barometer, heading by the magnetometer."""
    return of_log(kf.read_log(file), kf.build("ins23", noise=NOISE, sensors=["barometer", "mag"]))


if __name__ == "__main__":
    main(
        str(__doc__),
        {
            "jammed": ("flights/px4_gps_interference.ulg", flight),
            "brown-out": ("flights/px4_battery_brownout.ulg", flight),
        },
    )

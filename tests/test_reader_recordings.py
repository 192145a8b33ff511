"""Proves that every native recording is read without ``--columns``, or is asked for once what no file can say.

A question is answered as it is printed. That the numbers are those of the twins in NPZ is proven beside each reader.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from conftest import DATA

from kfgen.core.errors import InputError
from kfgen.log.log import Log
from kfgen.log.readers import read_log

ASKED = {
    "mpu6050_static.csv": "no unit",  # raw counts
    "rtk_walk_imu.csv": "no names",  # no header at all
}
"""Recordings that do not say what their columns are, and what is asked."""
NO_LOG = ("ecl_LICENSE", "rtk_walk_config.txt")


def files() -> list[Path]:
    return [p for name in ("native", "flights") for p in sorted((DATA / name).glob("*")) if p.is_file()]


def answered(path: Path, error: InputError) -> Log:
    """The log with what the message says to type."""
    command = re.search(r"--columns '([^']+)'", str(error))
    assert command, str(error)
    return read_log(path, columns=command.group(1))


@pytest.mark.skipif(not files(), reason="the recordings are not here (set KFGEN_DATA)")
@pytest.mark.parametrize("path", files(), ids=lambda p: p.name)
def test_a_recording_is_read_as_it_is(path: Path) -> None:
    if path.name in NO_LOG:
        with pytest.raises(InputError):
            read_log(path)
        return
    if path.name in ASKED:
        with pytest.raises(InputError, match=ASKED[path.name]) as caught:
            read_log(path)
        log = answered(path, caught.value)
    else:
        log = read_log(path)
    assert log.n > 40
    assert np.all(np.diff(log.t) > 0.0)
    assert all(np.isfinite(c.values).any() for c in log.channels.values())

"""Proves that every native recording is read without ``--columns``; that the numbers are those of the twins in NPZ is proven beside each reader."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from conftest import DATA

from kfgen.core.errors import InputError
from kfgen.log.readers import read_log

NO_LOG = ("ecl_LICENSE", "rtk_walk_config.txt")


def files() -> list[Path]:
    return [p for name in ("native", "flights") for p in sorted((DATA / name).glob("*")) if p.is_file()]


@pytest.mark.skipif(not files(), reason="the recordings are not here (set KFGEN_DATA)")
@pytest.mark.parametrize("path", files(), ids=lambda p: p.name)
def test_a_recording_is_read_as_it_is(path: Path) -> None:
    if path.name in NO_LOG:
        with pytest.raises(InputError):
            read_log(path)
        return
    log = read_log(path)
    assert log.n > 40
    assert np.all(np.diff(log.t) > 0.0)
    assert all(np.isfinite(c.values).any() for c in log.channels.values())

"""What `kfgen run -o` writes: states, standard deviations, innovations and NIS, as a log that every command reads."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import kfgen as kf
from kfgen.log.readers import write_log
from kfgen.model.discretise import DiscreteModel
from kfgen.run.estimates import estimates
from kfgen.run.run import run
from kfgen.simulate.simulate import simulate


@pytest.mark.parametrize("suffix", ["csv", "npz"])
def test_the_estimates_of_a_run_are_a_log(suffix: str, tmp_path: Path) -> None:
    model = kf.build("ins15")
    log = simulate(DiscreteModel.at_rate(model, 50.0), "generic", 5.0, np.random.default_rng(1))
    result = run(model, log)
    path = tmp_path / f"estimates.{suffix}"
    write_log(estimates(result, model), path)
    read = kf.read_log(path)
    names = result.names
    assert np.allclose(read.channels["v_N"].values, result.estimate[:, names.index("v_N")], atol=1e-6)
    sd = [s.name for s in model.states].index("phi_D")
    assert np.allclose(read.channels["sd_phi_D"].values, result.deviation[:, sd], rtol=1e-6)
    seen = result.sensors["gnss_position"]
    east = read.channels["innovation_gnss_p_E"].values
    assert np.allclose(east[np.isfinite(east)], seen.innovation[:, 1], rtol=1e-6)
    nis = read.channels["nis_gnss_position"].values
    assert np.isfinite(nis).sum() == seen.nis.size

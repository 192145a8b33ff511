"""Proves the parameters of emitted filters: in C compiled in or in flight, in Python by name, a gate for each sensor."""

from __future__ import annotations

import math
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from kfgen.emit.reference import Machine
from kfgen.emit.routines import Program
from kfgen.emit.targets import filterpy, plain
from kfgen.emit.targets.c import header
from kfgen.emit.targets.loaded import loaded
from kfgen.model.discretise import DiscreteModel
from kfgen.model.library import build
from kfgen.verify.host import FLAGS

ACCEL, MAG = [0.1, -0.2, -9.7], [20e-6, 1e-6, 43e-6]

PROGRAM = """
#include <stdio.h>
#include "ahrs6.h"
int main(void)
{
    static ahrs6_t kf[2];
    static ahrs6_parameters_t own;
    const float accel[3] = { 0.1f, -0.2f, -9.7f }, gyro[3] = { 0.01f, 0.0f, -0.02f };
    own = ahrs6_defaults;
    for (int i = 0; i < 2; i++) {
#ifdef AHRS6_RUNTIME_PARAMETERS
        kf[i].parameters = (i == 1) ? &own : 0;
#endif
        (void)ahrs6_init(&kf[i]);
    }
    (void)own;
    own.sd_accel_x = 0.5f;
    own.N_gyro = 0.01f;
    for (int i = 0; i < 2; i++) {
        (void)ahrs6_predict(&kf[i], gyro, 0.01f);
        (void)ahrs6_update_accel(&kf[i], accel);
        for (int k = 0; k < AHRS6_NX; k++) { printf("%.9g ", (double)kf[i].x[k]); }
        for (int k = 0; k < AHRS6_NP; k++) { printf("%.9g ", (double)kf[i].UD[k]); }
        printf("\\n");
    }
    return 0;
}
"""


def program(form: str = "ud") -> Program:
    return Program(DiscreteModel(build("ahrs6")), form)


def flown(folder: Path, *flags: str) -> list[np.ndarray]:
    """State and factors of the two filters of `PROGRAM` as C prints them."""
    if shutil.which("gcc") is None:
        pytest.skip("there is no gcc on this machine")
    (folder / "ahrs6.h").write_text(header(program()), encoding="utf-8")
    (folder / "use.c").write_text(PROGRAM, encoding="utf-8")
    words = ["gcc", "-std=c99", *FLAGS, *flags, "-ffp-contract=off", "use.c", "-o", "use", "-lm"]
    subprocess.run(words, cwd=folder, check=True)
    said = subprocess.run([str(folder / "use")], check=True, capture_output=True, text=True).stdout
    return [np.array(line.split(), np.float32) for line in said.splitlines()]


def wanted(**values: float) -> np.ndarray:
    """The same of the emitted numpy module, with these settings."""
    module = loaded(plain.module(program()))
    for name, value in values.items():
        setattr(module, name, np.float32(value))
    kf = module.Ahrs6()
    kf.predict([0.01, 0.0, -0.02], 0.01)
    kf.update_accel(ACCEL)
    return np.concatenate([kf.x, kf.UD])


def test_parameters_in_flight_belong_to_each_filter(tmp_path: Path) -> None:
    """The one that points to its own differs, and both are the Python module's to the last bit."""
    usual, own = flown(tmp_path, "-DAHRS6_RUNTIME_PARAMETERS")
    assert (usual == wanted()).all()
    assert (own == wanted(SD_ACCEL_X=0.5, N_GYRO=0.01)).all()
    assert not np.allclose(usual, own, rtol=1e-4)


@pytest.mark.long
def test_parameters_that_are_compiled_in(tmp_path: Path) -> None:
    for found in flown(tmp_path):
        assert (found == wanted()).all()
    for found in flown(tmp_path, "-DAHRS6_SD_ACCEL_X=0.5f", "-DAHRS6_N_GYRO=0.01f"):
        assert (found == wanted(SD_ACCEL_X=0.5, N_GYRO=0.01)).all()


def test_every_setting_is_a_member_with_its_unit_and_default() -> None:
    text = header(program())
    for s in program().settings.values():
        assert f"#define AHRS6_{s.name} " in text
        assert f"[{s.unit}] */" in text
    for member in ("N_gyro", "left_out_gyro", "sd_mag_x", "prior_phi_N".lower(), "max_gyro", "align_time"):
        assert f"float {member};" in text


def test_noise_is_by_its_letter_and_its_square_is_that_of_the_model() -> None:
    d = program().discrete
    value = {n: c.value for n, c in program().settings.items()}
    density = float(d.named_noise[1]["gyro"][1])
    assert value["N_GYRO"] ** 2 + value["LEFT_OUT_GYRO"] ** 2 == pytest.approx(density, rel=1e-12)
    for s in d.model.sensors:
        for c in s.channels:
            left = value[f"LEFT_OUT_{s.name.upper()}"] ** 2 * d.rate
            assert value[f"SD_{c.upper()}"] ** 2 + left == pytest.approx(
                d.measurement_variance(s, c), rel=1e-12
            )


@pytest.mark.parametrize("form", ["p", "ud"])
def test_each_sensor_has_its_gate(form: str) -> None:
    """Closed for one sensor it rejects that one's samples alone; at N standard deviations, what is beyond them."""
    machine = Machine(program(form), np.float64)
    machine.call("init")
    names = [c.name for c in machine.program.constants]
    machine.arrays["k"][names.index("gate_accel")] = 0.0
    assert machine.call("update_accel", [ACCEL]) == "GATED"
    assert machine.call("update_mag", [MAG]) == "OK"
    machine.arrays["k"][names.index("gate_accel")] = math.inf
    assert machine.call("update_accel", [ACCEL]) == "OK"
    for share, status in ((1.001, "OK"), (0.999, "GATED")):
        machine.call("init")
        machine.arrays["k"][names.index("gate_accel")] = math.inf
        machine.call("update_accel", [ACCEL])
        sigmas = math.sqrt(machine.arrays["nis"][0])
        machine.call("init")
        machine.arrays["k"][names.index("gate_accel")] = share * sigmas
        assert machine.call("update_accel", [ACCEL]) == status


def test_filterpy_has_the_same() -> None:
    module = loaded(filterpy.module(program("p")))
    kf = module.Ahrs6()
    assert kf.gates == {"accel": 10.0, "mag": 10.0}
    kf.gates["accel"] = 0.0
    assert kf.update_accel(np.array(ACCEL)).name == "GATED"
    assert kf.update_mag(np.array(MAG)).name == "OK"
    other = module.Ahrs6()
    module.SD_MAG_X = 1e-3
    other.update_mag(np.array(MAG))
    assert other.variance[0] > 1e-6

"""The verbs of ``import kfgen as kf``: each once, and the chain from a log to a filter on its target."""

from __future__ import annotations

import ast
import dataclasses
import importlib
import inspect
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import kfgen as kf
from kfgen.core.errors import InputError
from kfgen.core.result import Result

RATE_HZ = 50.0


def known(verb: str) -> bool:
    """Whether the module of a verb is there."""
    try:
        return hasattr(importlib.import_module(kf.VERBS[verb]), verb)
    except ModuleNotFoundError:
        return False


def bench(seed: int = 0, n: int = 6000) -> kf.Log:
    """A gyro axis at rest: white noise and a bias."""
    rng = np.random.default_rng(seed)
    y = 1e-3 + 6e-4 * rng.standard_normal(n)
    return kf.Log(np.arange(n) / RATE_HZ, {"gyro_x": kf.Channel(y, "deg/s")}, "bench")


@pytest.fixture
def noise(tmp_path: Path) -> Path:
    path = tmp_path / "noise.toml"
    path.write_text(
        'format = "kfgen-noise-1"\n[gyro_x]\nunit = "deg/s"\neffects = [\n'
        '{ effect = "white_noise", N = "0.0035 deg/s/sqrt(Hz)" },\n'
        '{ effect = "gauss_markov", sigma = "0.002 deg/s", tau = "100 s" } ]\n',
        encoding="utf-8",
    )
    return path


def sound(result: Result) -> None:
    """What every result keeps: frozen, a short repr, the JSON, a table for notebooks."""
    assert dataclasses.is_dataclass(result)
    with pytest.raises(dataclasses.FrozenInstanceError):
        setattr(result, dataclasses.fields(result)[0].name, None)
    assert 1 <= len(repr(result).splitlines()) <= 5
    data = json.loads(json.dumps(result.to_dict(), allow_nan=False))
    assert data["format"].startswith("kfgen-")
    assert data["kfgen"] == kf.__version__
    assert result._repr_html_().startswith("<p>")


def test_import_is_light_and_names_are_there() -> None:
    script = "import sys, kfgen; print([m for m in ('numpy', 'sympy', 'typer') if m in sys.modules], len(dir(kfgen)))"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.startswith("[] ")
    assert set(kf.VERBS) | set(kf.TYPES) <= set(dir(kf)) & set(kf.__all__)
    with pytest.raises(AttributeError, match="no attribute 'guess'"):
        _ = kf.guess


def test_a_verb_is_not_hidden_by_the_package_of_its_name() -> None:
    import kfgen.audit.degree
    import kfgen.emit.folder  # noqa: F401

    assert inspect.isfunction(kf.audit)
    assert inspect.isfunction(kf.emit)
    from kfgen.emit import targets

    assert "c" in targets()


def test_the_stub_says_what_the_table_says() -> None:
    tree = ast.parse(Path(kf.__file__).with_suffix(".pyi").read_text(encoding="utf-8"))
    stub = {a.name: n.module for n in tree.body if isinstance(n, ast.ImportFrom) for a in n.names}
    assert stub == kf.VERBS | kf.TYPES


@pytest.mark.parametrize("verb", sorted(kf.VERBS))
def test_every_argument_of_a_verb_is_described(verb: str) -> None:
    if not known(verb):
        pytest.skip(f"{verb} is not there yet")
    doc = inspect.getdoc(getattr(kf, verb)) or ""
    for name in inspect.signature(getattr(kf, verb)).parameters:
        assert f"\n{name}" in doc or f", {name}" in doc or f"\n**{name}" in doc, (
            f"{verb} does not say what {name} is"
        )


def test_read_and_write_a_log(tmp_path: Path) -> None:
    kf.write_log(bench(), tmp_path / "log.csv")
    text = (tmp_path / "log.csv").read_text(encoding="utf-8").replace("gyro_x [deg/s]", "g")
    (tmp_path / "foreign.csv").write_text(text, encoding="utf-8")
    log = kf.read_log(tmp_path / "foreign.csv", columns="gyro_x=g [deg/s]")
    np.testing.assert_allclose(log.values("gyro_x"), bench().values("gyro_x"), rtol=1e-6)


def test_load_and_save(noise: Path, tmp_path: Path) -> None:
    model = kf.load(noise)
    kf.save(model, tmp_path / "again.toml")
    assert kf.load(tmp_path / "again.toml") == model
    (tmp_path / "other.toml").write_text('format = "other"', encoding="utf-8")
    with pytest.raises(InputError, match="kfgen-noise-1"):
        kf.load(tmp_path / "other.toml")
    with pytest.raises(InputError, match=r"write_log"):
        kf.save(bench(), tmp_path / "log.toml")  # type: ignore[arg-type]


def test_build(noise: Path) -> None:
    model = kf.build("ins15", options={"frame": "ecef"}, sensors=["gnss_position", "barometer"])
    assert [s.name for s in model.sensors] == ["gnss_position", "barometer"]
    assert len(repr(model).splitlines()) <= 5
    assert kf.build("gyro-static", noise).noise == kf.build("gyro-static", kf.load(noise)).noise
    with pytest.raises(InputError, match="--set sensors"):
        kf.build("ins15", options={"sensors": "mag"}, sensors=["mag"])
    with pytest.raises(InputError, match=r"kfgen\.build"):
        kf.derive(model, noise)


def test_derive(noise: Path) -> None:
    found = kf.derive("gyro-static", noise, rate=RATE_HZ)
    sound(found)
    assert found.matrices["Phi"].shape == (2, 2)
    assert set(found.to_dict()["matrices"]) == set(found.matrices)


def test_audit_along_manoeuvres() -> None:
    found = kf.audit("ahrs6", ["static", "generic"], duration=5.0, want=["phi_D=1 deg"])
    sound(found)
    assert list(found.to_dict()["manoeuvres"]) == ["static", "generic"]


def test_simulate_run_and_audit_of_a_log(tmp_path: Path) -> None:
    log = kf.simulate("ahrs6", "generic", duration=5.0, seed=3)
    kf.write_log(log, tmp_path / "log.npz")
    found = kf.run("ahrs6", tmp_path / "log.npz")
    sound(found)
    assert found.attitude is not None
    assert found.to_dict()["attitude_error"]["samples"] == log.n
    assert kf.run("ahrs6", log, adaptive="sage-husa").estimate.shape == found.estimate.shape
    seen = kf.audit("ahrs6", log=tmp_path / "log.npz")
    sound(seen)
    assert seen.first.recorded
    with pytest.raises(InputError, match="own motion"):
        kf.audit("ahrs6", ["static"], log=log)


def test_denoise_plan_and_convert(noise: Path) -> None:
    log = bench(n=3000)
    found = kf.denoise(log, "iae")
    sound(found)
    assert found.log.values("gyro_x").std() < log.values("gyro_x").std()
    plan = kf.plan(noise, rate=RATE_HZ, wanted=0.1)
    sound(plan)
    sheet = kf.convert(noise, "table")
    sound(sheet)
    assert sheet.to_dict()["sha256"]
    assert sheet.text == kf.convert(kf.load(noise), "table", origin=noise.name).text


def test_list_all() -> None:
    found = kf.list_all()
    sound(found)
    assert "ins15" in found.to_dict()["models"]


def test_the_chain_from_noise_to_a_proven_filter(noise: Path, tmp_path: Path) -> None:
    model = kf.build("gyro-static", noise)
    emitted = kf.emit(model, tmp_path / "filter", rate=RATE_HZ)
    sound(emitted)
    assert {"gyro_static.h", "noise.toml", "kfgen.json"} <= set(emitted.files)
    proof = kf.verify(tmp_path / "filter")
    sound(proof)
    assert proof.ok
    assert repr(proof).startswith("Bit-exact on host")
    module = kf.emit(model, tmp_path / "numpy", "numpy", rate=RATE_HZ)
    over = kf.verify(module, log=kf.simulate(model, duration=2.0, rate=RATE_HZ))
    sound(over)
    assert over.on_log is not None


def test_a_filter_file_goes_into_its_folder(tmp_path: Path) -> None:
    path = tmp_path / "quad.toml"
    path.write_text(
        'format = "kfgen-filter-1"\nname = "tilt"\nmodel = "ahrs6"\nsensors = ["accel"]\n'
        '[noise.gyro_x]\nunit = "rad/s"\neffects = [ { effect = "white_noise", N = "1e-4 rad/s/sqrt(Hz)" } ]\n',
        encoding="utf-8",
    )
    emitted = kf.emit(path, tmp_path / "c", noise=None)
    assert kf.load(tmp_path / "c" / "filter.toml") == kf.load(path)
    again = kf.verify(tmp_path / "c")
    assert again.ok
    assert again.model_hash == emitted.model_hash


@pytest.mark.skipif(not known("identify"), reason="identify is not there yet")
def test_ten_lines_from_a_log_to_an_updated_filter(tmp_path: Path) -> None:
    found = kf.identify(bench())
    sound(found)
    model = kf.build("gyro-static", noise=found.noise)
    assert kf.emit(model, tmp_path / "filter", rate=RATE_HZ).files
    if not known("find_gap"):
        pytest.skip("find_gap is not there yet")
    gap = kf.find_gap(bench(1), found.noise)
    sound(gap)
    assert kf.emit(kf.build("gyro-static", noise=gap.improved), tmp_path / "better").files
    assert gap.to_dict()["verdict"] == "no_gap"


@pytest.mark.skipif(not known("fleet"), reason="fleet is not there yet")
def test_fleet() -> None:
    logs = [dataclasses.replace(bench(seed), source=f"log {seed}", sha256=f"{seed}") for seed in range(3)]
    found = kf.fleet(logs, jobs=1)
    sound(found)
    assert len(found.done) == 3

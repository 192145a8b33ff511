"""The wheel carries its templates and works outside the checkout."""

from __future__ import annotations

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from kfgen.effects.noise_model import read_noise

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    subprocess.run(
        [sys.executable, "-m", "build", "--wheel", "--no-isolation", "-o", str(folder), str(ROOT)],
        check=True,
        capture_output=True,
    )
    return next(folder.glob("*.whl"))


def test_templates_are_inside(wheel: Path) -> None:
    names = set(zipfile.ZipFile(wheel).namelist())
    here = {f"kfgen/templates/{p.relative_to(ROOT / 'templates')}" for p in (ROOT / "templates").rglob("*.*")}
    assert here
    assert here <= names


@pytest.mark.long
def test_demo_from_the_wheel(wheel: Path, tmp_path: Path) -> None:
    target = tmp_path / "site"
    subprocess.run(
        [
            sys.executable,
            "-m",
            "pip",
            "install",
            "-q",
            "--no-deps",
            "--no-index",
            "--target",
            str(target),
            str(wheel),
        ],
        check=True,
        capture_output=True,
    )
    env = {**os.environ, "PYTHONPATH": str(target)}
    code = "import kfgen, sys; sys.exit(0 if kfgen.__file__.startswith(sys.argv[1]) else 9)"
    assert (
        subprocess.run(
            [sys.executable, "-c", code, str(target)], cwd=tmp_path, env=env, check=False
        ).returncode
        == 0
    )
    done = subprocess.run(
        [sys.executable, "-m", "kfgen", "demo", "--out", "out"],
        cwd=tmp_path,
        env=env,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    added = read_noise(tmp_path / "out" / "improved.toml").channels["gyro_x"].effects[2:]
    assert [e.name for e in added] == ["sinusoid", "temperature"]  # as it was simulated
    last = done.stdout.strip().splitlines()[-1]
    assert last.startswith("report: ")
    page = Path(last.removeprefix("report: ")).read_text(encoding="utf-8")
    assert "<script src" not in page
    assert "http://" not in page.replace("http://www.w3.org/", "")
    assert "<svg" in page
    assert "<math" in page

"""Proves that the emitted Python runs where kfgen is not: a fresh environment with filterpy and numpy alone."""

from __future__ import annotations

import os
import subprocess
import sys
from importlib import metadata
from pathlib import Path
from typing import Any

import pytest
from in_part import in_part
from packaging.requirements import Requirement

from kfgen.emit.folder import write_folder
from kfgen.emit.routines import Program
from kfgen.model.discretise import DiscreteModel
from kfgen.model.library import build

CASES = [("filterpy", "ins15"), ("filterpy", "ahrs6"), ("numpy", "ahrs6")]


@pytest.fixture(scope="module")
def python(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The interpreter of a new environment with the files of filterpy and of what it needs, and of nothing else."""
    home = tmp_path_factory.mktemp("alone") / "env"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", home], check=True, capture_output=True)
    found = home / ("Scripts" if os.name == "nt" else "bin") / "python"
    where = [found, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))"]
    site = Path(subprocess.run(where, check=True, capture_output=True, text=True).stdout.strip())
    for path in sorted({file for name in distributions("filterpy") for file in placed(name)}):
        (site / path.name).symlink_to(path)
    return found


def distributions(name: str) -> set[str]:
    """A distribution and what it needs, by name."""
    found, left = set(), [name]
    while left:
        one = left.pop()
        if one not in found:
            found.add(one)
            needed = [Requirement(r) for r in metadata.requires(one) or ()]
            left += [r.name for r in needed if r.marker is None or r.marker.evaluate({"extra": ""})]
    return found


def placed(name: str) -> set[Path]:
    """What a distribution has put at the top of the library."""
    distribution = metadata.distribution(name)
    tops = {file.parts[0] for file in distribution.files or ()} - {"..", "__pycache__"}
    return {Path(str(distribution.locate_file(top))) for top in tops}


def run(python: Path, folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """In an empty place, without this process's paths."""
    env = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")} | {"PYTHONNOUSERSITE": "1"}
    return subprocess.run([python, *words], cwd=folder, env=env, capture_output=True, text=True, check=False)


@pytest.fixture
def emitted(tmp_path: Path) -> Any:
    def write(target: str, name: str) -> Path:
        write_folder(Program(DiscreteModel(build(name))), target, None, tmp_path / "f")
        return tmp_path / "f"

    return write


@pytest.mark.parametrize("module", ["kfgen", "sympy"])
def test_the_environment_has_nothing_else(module: str, python: Path, tmp_path: Path) -> None:
    done = run(python, tmp_path, "-c", f"import {module}")
    assert done.returncode == 1
    assert f"No module named '{module}'" in done.stderr


@pytest.mark.parametrize(("target", "name"), in_part(CASES))
def test_its_self_test_passes(target: str, name: str, python: Path, emitted: Any) -> None:
    folder = emitted(target, name)
    p = Program(DiscreteModel(build(name)))
    done = run(python, folder, "selftest.py")
    assert done.returncode == 0, done.stderr
    assert done.stdout == f"{p.word_count} numbers, 0 differing\n"


def test_its_self_test_fails_where_it_leans_on_kfgen(python: Path, emitted: Any) -> None:
    path = emitted("filterpy", "ahrs6") / "ahrs6.py"
    path.write_text(path.read_text().replace("import numpy as np\n", "import kfgen\nimport numpy as np\n", 1))
    done = run(python, path.parent, "selftest.py")
    assert done.returncode == 1
    assert "No module named 'kfgen'" in done.stderr


@pytest.mark.parametrize(
    ("target", "old", "new"),
    in_part([("filterpy", "P_", "P_"), ("numpy", "F(0.5)", "F(0.5001)"), ("filterpy", "0.5", "0.5001")]),
    ids=["whole", "numpy", "filterpy"],
)
def test_its_self_test_finds_an_altered_number(target: str, old: str, new: str, emitted: Any) -> None:
    """Run by this interpreter, which has both libraries; an unaltered module passes."""
    path = emitted(target, "ahrs6") / "ahrs6.py"
    head, body = path.read_text().split("def predict" if target == "numpy" else "def _step", 1)
    path.write_text(head + ("def predict" if target == "numpy" else "def _step") + body.replace(old, new, 1))
    done = run(Path(sys.executable), path.parent, "selftest.py")
    assert done.returncode == int(old != new), done.stderr
    assert done.stdout.endswith(" 0 differing\n") == (old == new)

"""The README's install lines and its five minutes on a machine that has nothing: no variables, an empty home."""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest
from test_newcomer import SECTION, at_rest, typed
from test_reader_folders import euroc
from written_logs import write_bag, write_ulog

import kfgen as kf

ROOT = Path(__file__).resolve().parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
LIMIT_S = 300.0
"""Five minutes [s], without the installation."""

pytestmark = pytest.mark.long


@pytest.fixture
def place(tmp_path: Path) -> Path:
    """A checkout of what git lists, and an index of packages that answers without settings of a user."""
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=False)
    if listed.returncode:
        pytest.skip("the project is no git checkout")
    for name in listed.stdout.splitlines():
        if (ROOT / name).is_file():
            (tmp_path / "kfgen" / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, tmp_path / "kfgen" / name)
    (tmp_path / "home").mkdir()
    (tmp_path / "probe").mkdir()
    asked = typed_there(
        tmp_path / "probe", shlex.split("python -m pip download -q --no-deps packaging"), tmp_path
    )
    if asked.returncode:
        pytest.skip("no index of packages answers here")
    return tmp_path / "kfgen"


def typed_there(folder: Path, words: list[str], top: Path) -> subprocess.CompletedProcess[str]:
    """A command in a folder, with an empty home and no variable but the path of this Python and of the system."""
    path = f"{Path(sys.base_prefix) / 'bin'}:/usr/local/bin:/usr/bin:/bin"
    env = {"HOME": str(top / "home"), "PATH": path}
    if words[0] == "python":
        words = [shutil.which("python", path=path) or "python3", *words[1:]]
    return subprocess.run(words, cwd=folder, env=env, capture_output=True, text=True, check=False)


def by_hand() -> list[list[str]]:
    """The three lines of the README for who has no make."""
    (line,) = re.findall(r"^Without make: (.*?)\.$", README, re.M)
    return [shlex.split(words) for words in re.findall(r"`([^`]+)`", line)]


def logs(folder: Path) -> None:
    """The logs that the five minutes speak of."""
    flown = kf.simulate("ins15", "figure-8", duration=12.0, rate=100.0, seed=3, rates={"gnss": 5.0})
    write_ulog(flown, folder / "flight.ulg")
    write_bag(at_rest(), folder / "rest.bag")
    euroc(folder / "calib-imu-static2")


def test_make_demo_ends_at_a_report(place: Path) -> None:
    done = typed_there(place, ["make", "demo"], place.parent)
    assert done.returncode == 0, done.stderr
    assert Path(done.stdout.rsplit("report: ", 1)[1].strip()).is_file()
    assert not list((place.parent / "home").glob("[!.]*"))


def test_by_hand_and_the_five_minutes(place: Path) -> None:
    """The lines without make; then what can be typed for one's own log, with the two extras that are named there."""
    top = place.parent
    lines = by_hand()
    assert [words[0] for words in lines] == ["python", ".venv/bin/pip", ".venv/bin/kfgen"]
    (extras,) = re.findall(r"by hand, `(pip install [^`]+)`", SECTION.group(1) if SECTION else "")
    lines[1] = [".venv/bin/pip", *shlex.split(extras)[1:]]
    for words in lines:
        done = typed_there(place, words, top)
        assert done.returncode == 0, (words, done.stderr)
    logs(place)
    begun = time.monotonic()
    answers = []
    for words in typed("kfgen list flight.ulg", 5):
        done = typed_there(place, [".venv/bin/kfgen", *words[1:]], top)
        # A short rest shows no random walk: the file that lacks its keys is written with exit status 1.
        assert done.returncode == (1 if "kalibr" in words else 0), (words, done.stderr)
        answers.append(done.stdout)
    assert time.monotonic() - begun < LIMIT_S
    assert "sensor_combined" in answers[0]
    assert "accel_z" in answers[1]
    for page in ("noise.html", "allan.html"):
        assert "<svg" in (place / page).read_text(encoding="utf-8")
    assert "gyroscope_noise_density" in (place / "imu.yaml").read_text(encoding="utf-8")

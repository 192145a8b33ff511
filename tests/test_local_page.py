"""Proves the local page: who is served, what is taken and refused, that its buttons run the commands; in a real browser too."""

from __future__ import annotations

import asyncio
import io
import json
import subprocess
import sys
import time
import zipfile
from collections.abc import AsyncIterator, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser import CHROMIUM, Browser, browser

from kfgen.core.errors import InputError, MissingExtra
from kfgen.local_page import work_folder
from kfgen.local_page.buttons import command_of
from kfgen.local_page.local_page import LocalPage, open_page
from kfgen.local_page.work_folder import WorkFolder, plain_name

pytest.importorskip("starlette", reason="starlette of the extra open is not installed")
pytest.importorskip("uvicorn", reason="uvicorn of the extra open is not installed")
TestClient = pytest.importorskip("starlette.testclient", reason="httpx is not installed").TestClient

PORT, TOKEN = 8765, "the-secret-of-this-page"
HOME = f"http://127.0.0.1:{PORT}"
T = np.arange(3000) / 100.0
MODEL = """format = "kfgen-noise-1"
[gyro_x]
unit = "deg/s"
effects = [ { effect = "white_noise", N = "0.005 deg/s/sqrt(Hz)" } ]
"""


def log_text() -> bytes:
    y = np.random.default_rng(2).normal(0.0, 0.05, T.size)
    out = io.BytesIO()
    np.savetxt(out, np.column_stack([T, y]), delimiter=",", header="t [s],gyro_x [deg/s]", comments="")
    return out.getvalue()


@pytest.fixture
def page(tmp_path: Path) -> Iterator[Any]:
    """A client that has opened the address of the page; its folder is `work` of the test's own."""
    with TestClient(LocalPage(WorkFolder(tmp_path / "work")).app(PORT, TOKEN), base_url=HOME) as client:
        assert client.get(f"/?token={TOKEN}").status_code == 200
        yield client


def ended(page: Any, job: dict[str, Any], seconds: float = 120.0) -> dict[str, Any]:
    """A job when it has ended."""
    ends = time.monotonic() + seconds
    while job["state"] in ("waiting", "running") and time.monotonic() < ends:
        time.sleep(0.1)
        job = page.get(f"/jobs/{job['id']}").json()
    return job


def everything(folder: Path) -> set[str]:
    return {str(p.relative_to(folder)) for p in folder.rglob("*")}


# Who is served.


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({}, 200),
        ({"origin": HOME}, 200),
        ({"host": f"localhost:{PORT}", "cookie": f"kfgen-{PORT}={TOKEN}"}, 200),
        ({"host": "evil.example"}, 403),  # a name that points here (DNS rebinding)
        ({"host": f"evil.example:{PORT}"}, 403),
        ({"host": "127.0.0.1:80"}, 403),
        ({"origin": "https://evil.example"}, 403),
        ({"origin": "null"}, 403),
        ({"origin": "http://127.0.0.1:1"}, 403),
        ({"sec-fetch-site": "cross-site"}, 403),
        ({"sec-fetch-site": "same-site"}, 403),
        ({"cookie": f"kfgen-{PORT}=guessed"}, 401),
        ({"cookie": ""}, 401),
    ],
)
@pytest.mark.parametrize(("method", "path"), [("GET", "/"), ("POST", "/files/a.csv"), ("POST", "/jobs")])
def test_only_the_page_itself_is_served(
    page: Any, method: str, path: str, headers: dict[str, str], status: int
) -> None:
    body = b"{}" if path == "/jobs" else b"t,x\n"
    found = page.request(method, path, headers=headers, content=body if method == "POST" else None)
    assert found.status_code == (400 if status == 200 and path == "/jobs" else status)


def test_the_address_without_its_token_opens_nothing(tmp_path: Path) -> None:
    with TestClient(LocalPage(WorkFolder(tmp_path / "work")).app(PORT, TOKEN), base_url=HOME) as stranger:
        for path in ("/", "/?token=guessed", f"/page.js?token={TOKEN}", "/jobs/001"):
            assert stranger.get(path).status_code == 401
        kept = stranger.get(f"/?token={TOKEN}", follow_redirects=False).headers["set-cookie"]
    assert "HttpOnly" in kept
    assert "SameSite=Strict" in kept


def test_pages_may_ask_nobody_else(page: Any) -> None:
    policy = page.get("/").headers["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "http" not in policy
    assert page.get("/page.js").headers["x-content-type-options"] == "nosniff"


# What is taken.


@pytest.mark.parametrize(
    ("name", "kept"),
    [
        ("log.csv", "log.csv"),
        ("../../etc/passwd", "passwd"),
        ("C:\\logs\\a b.ulg", "a_b.ulg"),
        (".bashrc", "bashrc"),
        ("--output=x.csv", "output_x.csv"),
        ("\x00\x1b[31m.csv", "31m.csv"),
        ("..", "log"),
        ("é" * 300 + ".npz", "npz"),
        ("a" * 300 + ".npz", "a" * 96 + ".npz"),
    ],
)
def test_names_are_plain(name: str, kept: str) -> None:
    assert plain_name(name) == kept


@pytest.mark.parametrize("path", ["/files/..%2F..%2Fx.csv", "/files/%2Fetc%2Fx.csv", "/files/x.csv"])
def test_nothing_is_written_outside_the_folder(page: Any, tmp_path: Path, path: str) -> None:
    answer = page.post(path, content=log_text())
    assert answer.status_code in (200, 404)
    assert {p.split("/")[0] for p in everything(tmp_path)} == {"work"}


def test_a_file_that_is_too_large_is_refused_and_leaves_nothing(
    page: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By what it says, and by what it sends."""
    monkeypatch.setattr(work_folder, "MOST_BYTES", 1000)
    said = page.post("/files/a.csv", content=b"x" * 1001)

    def parts() -> Iterator[bytes]:
        yield from [b"x" * 400] * 3

    sent = page.post("/files/b.csv", content=parts())
    huge = page.post("/files/c.csv", headers={"content-length": str(3 * 10**9)}, content=b"")
    for answer in (said, sent, huge):
        assert answer.status_code == 413
        assert "GB here" in answer.json()["error"]
    assert everything(tmp_path) == {"work"}
    assert page.post("/files/a.csv", content=b"x" * 1000).status_code == 200


def test_all_files_together_are_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(work_folder, "MOST_BYTES_IN_ALL", 1000)
    folder = WorkFolder(tmp_path / "work")

    async def body() -> AsyncIterator[bytes]:
        yield b"x" * 600

    asyncio.run(folder.receive("a.csv", body()))
    with pytest.raises(InputError, match="all together"):
        asyncio.run(folder.receive("b.csv", body()))


def test_an_upload_that_breaks_off_leaves_nothing(tmp_path: Path) -> None:
    folder = WorkFolder(tmp_path / "work")

    async def body() -> AsyncIterator[bytes]:
        yield b"x" * 600
        raise ConnectionError

    with pytest.raises(ConnectionError):
        asyncio.run(folder.receive("a.csv", body()))
    assert everything(tmp_path) == {"work"}
    assert folder.received == 0


def test_folders_of_earlier_sessions_stay(tmp_path: Path) -> None:
    (tmp_path / "007").mkdir()
    (tmp_path / "notes").mkdir()
    assert WorkFolder(tmp_path).next().name == "008"


@pytest.mark.parametrize(
    "body", [b"", b"[1]", b"{" * 60000, b"x" * 70000, b'{"action": "rm"}', b'{"action": "list"}']
)
def test_a_request_that_is_none_is_refused(page: Any, body: bytes) -> None:
    answer = page.post("/jobs", content=body)
    assert answer.status_code == 400
    assert answer.json()["error"]


@pytest.mark.parametrize(
    ("path", "status"), [("/files/001/none.csv", 400), ("/files/..%2F001/a", 404), ("/jobs/9", 400)]
)
def test_what_the_page_was_not_given_it_does_not_give(page: Any, path: str, status: int) -> None:
    assert page.get(path).status_code in (status, 400)


@pytest.mark.parametrize(
    "given",
    [
        {"action": "identify", "log": "001/log.csv", "channels": "--output /etc/x;"},
        {"action": "identify", "log": "001/log.csv", "rate": "-5"},
        {"action": "identify", "log": "001/log.csv", "rate": "nan"},
        {"action": "identify", "log": "001/log.csv", "columns": "a\nb"},
        {"action": "identify", "log": "/etc/passwd"},
        {"action": "audit", "model": "/etc/passwd"},
        {"action": "audit", "model": ""},
        {"action": "gap", "log": "001/log.csv", "model": "--help"},
    ],
)
def test_what_a_button_sends_is_checked(tmp_path: Path, given: dict[str, object]) -> None:
    folder = WorkFolder(tmp_path)
    (folder.next() / "log.csv").write_bytes(log_text())
    folder.add(tmp_path / "001" / "log.csv")
    assert command_of({"action": "list", "log": "001/log.csv"}, folder).words[:2] == (
        "list",
        "../001/log.csv",
    )
    with pytest.raises(InputError):
        command_of(given, folder)


# What the buttons do.


@pytest.mark.long
def test_a_log_becomes_a_noise_file_and_c(page: Any, tmp_path: Path) -> None:
    key = page.post("/files/log.csv", content=log_text()).json()["key"]
    found = ended(page, page.post("/jobs", json={"action": "identify", "log": key}).json())
    assert found["state"] == "done", found
    assert found["command"].startswith("kfgen identify ../001/log.csv")
    names = {k.split("/")[1]: k for k in found["files"]}
    noise = page.get(f"/files/{names['noise.toml']}")
    assert "attachment" in noise.headers["content-disposition"]
    assert b"white_noise" in noise.content
    report = page.get(f"/files/{names['report.html']}")
    assert "sandbox" in report.headers["content-security-policy"]
    assert b"Sensor noise in log.csv" in report.content
    asked = {"action": "emit", "model": "gyro-static", "noise": names["noise.toml"]}
    code = ended(page, page.post("/jobs", json=asked).json())
    (archive,) = (k for k in code["files"] if k.endswith(".zip"))
    with zipfile.ZipFile(io.BytesIO(page.get(f"/files/{archive}").content)) as packed:
        assert any(name.endswith(".h") for name in packed.namelist())
    assert {p.split("/")[0] for p in everything(tmp_path)} == {"work"}


def test_a_wrong_log_is_said_in_words(page: Any) -> None:
    key = page.post("/files/log.csv", content=b"t [s],gyro_x [deg/s]\n0,1\n1,x\n2,3\n").json()["key"]
    found = ended(page, page.post("/jobs", json={"action": "identify", "log": key}).json())
    assert found["state"] == "failed"
    assert "line 3, column 2" in found["said"]
    assert found["files"] == []


def test_a_command_can_be_stopped(page: Any) -> None:
    key = page.post("/files/log.csv", content=log_text()).json()["key"]
    jobs = [page.post("/jobs", json={"action": "identify", "log": key}).json() for _ in range(2)]
    for job in reversed(jobs):  # the second waits for the first
        assert page.delete(f"/jobs/{job['id']}").json()["state"] == "stopped"
    assert page.get(f"/jobs/{jobs[0]['id']}").json()["files"] == []


def test_what_is_missing_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(sys.modules, "uvicorn", None)
    with pytest.raises(MissingExtra, match=r"kfgen\[open\]"):
        open_page(tmp_path, 0, print, show=False)


def test_a_port_in_use_is_refused(tmp_path: Path) -> None:
    import socket

    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        with pytest.raises(InputError, match="cannot be used"):
            open_page(tmp_path, other.getsockname()[1], print, show=False)


@contextmanager
def ended_at_last(process: subprocess.Popen[str]) -> Iterator[None]:
    try:
        yield
    finally:
        process.terminate()


def field_text() -> bytes:
    """Two minutes of that sensor beside a fan."""
    t = np.arange(24000) / 200.0
    y = np.random.default_rng(3).normal(0.0, 0.05, t.size) + 0.02 * np.sin(2.0 * np.pi * 7.3 * t)
    out = io.BytesIO()
    np.savetxt(out, np.column_stack([t, y]), delimiter=",", header="t [s],gyro_x [deg/s]", comments="")
    return out.getvalue()


@contextmanager
def opened(folder: Path) -> Iterator[tuple[Browser, str]]:
    """The page in a browser, and its address."""
    words = [sys.executable, "-m", "kfgen", "open", "--no-browser", "--folder", str(folder / "work")]
    with (
        subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as server,
        ended_at_last(server),
        browser(folder) as page,
    ):
        assert server.stdout is not None
        address = server.stdout.readline().strip()
        page.call("Page.navigate", url=address)
        page.until("document.readyState === 'complete' && document.querySelector('#choose')")
        yield page, address.split("?")[0]
        assert page.wrong() == []
        home = address.split("?")[0]
        assert [a for a in page.asked() if a.startswith("http") and not a.startswith(home)] == []


def fits(page: Browser, folder: Path, name: str) -> None:
    """Nothing sticks out at 1200 and at 390 px."""
    for width in (1200, 390):
        page.picture(folder / f"{name}-{width}.png", width, 900)
        assert page.run("document.documentElement.scrollWidth") <= width


def links(page: Browser) -> list[str]:
    return page.run("[...document.querySelectorAll('.job:first-child a')].map(a => a.innerText)")


@pytest.mark.long
@pytest.mark.skipif(CHROMIUM is None, reason="Chromium is not installed")
def test_the_page_in_a_browser(tmp_path: Path) -> None:
    """A log is chosen, looked at and identified; the model of this noise is audited."""
    log = tmp_path / "bench.csv"
    log.write_bytes(log_text())
    with opened(tmp_path) as (page, _):
        page.choose("#choose", log)
        page.until("document.querySelector('.job.done iframe')")
        assert "bench.csv" in page.run("document.querySelector('.job h3').innerText")
        page.run("document.querySelector('[data-action=identify]').click()")
        page.until("document.querySelector('#noise').selectedOptions[0].text.startsWith('noise.toml')", 240)
        assert links(page) == ["noise file", "report", "JSON"]
        page.run("document.querySelector('#model').value = 'gyro-static'")
        page.run("document.querySelector('[data-action=audit]').click()")
        page.until("document.querySelector('.job.done h3')?.innerText.startsWith('audit')", 240)
        assert links(page) == ["report", "JSON"]
        fits(page, tmp_path, "audit")
    assert json.loads((tmp_path / "work" / "003" / "answer.json").read_text())["channels"]["gyro_x"]
    assert json.loads((tmp_path / "work" / "004" / "answer.json").read_text())["format"].startswith(
        "kfgen-audit"
    )


@pytest.mark.long
@pytest.mark.skipif(CHROMIUM is None, reason="Chromium is not installed")
def test_a_gap_in_a_browser(tmp_path: Path) -> None:
    """The progress is seen while it works, the updated model is at hand when it ends."""
    log, model = tmp_path / "field.csv", tmp_path / "model.toml"
    log.write_bytes(field_text())
    model.write_text(MODEL)
    with opened(tmp_path) as (page, _):
        page.choose("#choose", model)
        page.until("document.querySelector('#models option')")
        page.choose("#choose", log)
        page.until("document.querySelector('.job.done iframe')")
        page.run("document.querySelector('[data-action=gap]').click()")
        page.until("document.querySelector('.job.running progress')")
        page.until("/\\d+ s/.test(document.querySelector('.job.running p')?.innerText)")
        fits(page, tmp_path, "running")
        page.until("document.querySelector('.job.done h3')?.innerText.startsWith('gap')", 240)
        assert links(page) == ["updated model", "report", "JSON"]
        assert "improved.toml" in page.run("document.querySelector('#noise').innerText")
        fits(page, tmp_path, "gap")
    assert "sinusoid" in (tmp_path / "work" / "004" / "improved.toml").read_text()

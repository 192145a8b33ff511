"""`open_page`: the local page, served to this machine only."""

from __future__ import annotations

import asyncio
import json
import secrets
import socket
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import kfgen
from kfgen.core.elapsed import end_elapsed_time
from kfgen.core.errors import InputError
from kfgen.core.optional_library import optional_library
from kfgen.emit.targets.templates import render, template_folder
from kfgen.local_page.buttons import command_of
from kfgen.local_page.page_job import PageJob, PageJobs
from kfgen.local_page.request_guard import RequestGuard
from kfgen.local_page.work_folder import MOST_BYTES, WorkFolder, too_large
from kfgen.model.library import LIBRARY

HOST = "127.0.0.1"
MOST_BYTES_OF_A_REQUEST = 65536
"""Of what a button sends; files are sent by themselves."""
REPORT_POLICY = (
    "sandbox allow-scripts; default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'"
)
"""Of reports, whose script is inside them and needs nothing else: they can ask this page for nothing."""


@dataclass
class LocalPage:
    """What the page serves.

    Parameters
    ----------
    folder : WorkFolder
    jobs : PageJobs
    """

    folder: WorkFolder
    jobs: PageJobs = field(init=False)

    def __post_init__(self) -> None:
        self.jobs = PageJobs(self.folder)

    def app(self, port: int, token: str) -> RequestGuard:
        """The application behind its guard.

        Parameters
        ----------
        port : int
        token : str
            The secret in the address of the page.

        Returns
        -------
        RequestGuard

        Raises
        ------
        MissingExtra
            The web framework is not installed.
        """
        applications = optional_library("starlette.applications", "open", "the local page is served by")
        from starlette.routing import Route

        @asynccontextmanager
        async def lifespan(_: Any) -> AsyncIterator[None]:
            yield
            await self.jobs.stop_all()

        routes = [
            Route("/", self.page),
            Route("/page.js", self.script),
            Route("/files/{name}", _answered(self.receive), methods=["POST"]),
            Route("/files/{place}/{name}", _answered(self.file)),
            Route("/jobs", _answered(self.start), methods=["POST"]),
            Route("/jobs/{place}", _answered(self.job)),
            Route("/jobs/{place}", _answered(self.stop), methods=["DELETE"]),
        ]
        return RequestGuard(applications.Starlette(routes=routes, lifespan=lifespan), port, token)

    async def page(self, _: Any) -> Any:
        """The page itself."""
        from starlette.responses import HTMLResponse

        shown = {"models": list(LIBRARY), "folder": str(self.folder.root), "most": MOST_BYTES / 1e9}
        return HTMLResponse(render("open/page.html.j2", markup=True, version=kfgen.__version__, **shown))

    async def script(self, _: Any) -> Any:
        """Its script."""
        from starlette.responses import FileResponse

        return FileResponse(template_folder() / "open" / "page.js", media_type="text/javascript")

    async def receive(self, request: Any) -> dict[str, Any]:
        """A file that was dropped."""
        name = str(request.path_params["name"])
        if int(request.headers.get("content-length", "0") or 0) > MOST_BYTES:
            raise too_large(name[:80])
        kept = await self.folder.receive(name, request.stream())
        return {"key": kept.key, "name": kept.name}

    async def file(self, request: Any) -> Any:
        """A file of the page; reports are shown, everything else is a download."""
        from starlette.responses import FileResponse

        kept = self.folder.find(f"{request.path_params['place']}/{request.path_params['name']}")
        if kept.path.suffix == ".html" and kept.path.parent.name in self.jobs.jobs:
            return FileResponse(
                kept.path, media_type="text/html", headers={"content-security-policy": REPORT_POLICY}
            )
        return FileResponse(kept.path, filename=kept.name, media_type="application/octet-stream")

    async def start(self, request: Any) -> dict[str, Any]:
        """A button."""
        body = b""
        async for part in request.stream():
            body += part
            if len(body) > MOST_BYTES_OF_A_REQUEST:
                raise InputError("the request is too long", remedy="Shorten the map of columns")
        try:
            given = json.loads(body)
        except (ValueError, RecursionError):
            given = None
        if not isinstance(given, dict):
            raise InputError("the request is no JSON object", remedy="Use the page")
        return self.jobs.start(command_of(given, self.folder)).to_dict()

    async def job(self, request: Any) -> dict[str, Any]:
        """How far a command is."""
        return self._job(request).to_dict()

    async def stop(self, request: Any) -> dict[str, Any]:
        """End a command."""
        job = self._job(request)
        await self.jobs.stop(job)
        return job.to_dict()

    def _job(self, request: Any) -> PageJob:
        job = self.jobs.jobs.get(str(request.path_params["place"]))
        if job is None:
            raise InputError("this command did not run on this page", remedy="Run it again")
        return job


def _answered(serve: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """What serves a request; an error of the user becomes an answer in words."""

    async def answered(request: Any) -> Any:
        from starlette.responses import JSONResponse, Response

        try:
            found = await serve(request)
        except InputError as error:
            return JSONResponse({"error": str(error)}, 413 if "GB" in error.what else 400)
        return found if isinstance(found, Response) else JSONResponse(found)

    return answered


def open_page(folder: Path, port: int, say: Callable[[str], None], show: bool = True) -> None:
    """Serve the page until it is ended by Ctrl-C.

    Parameters
    ----------
    folder : Path
        Takes everything that is dropped and made.
    port : int
        0 for one that is free.
    say : callable
        Takes the address of the page.
    show : bool
        Open it in the browser.

    Raises
    ------
    InputError
        The folder cannot be made, or the port is in use.
    MissingExtra
        The web framework is not installed.
    """
    uvicorn = optional_library("uvicorn", "open", "the local page is served by")
    listener = socket.socket()
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((HOST, port))
    except (OSError, OverflowError):
        raise InputError(f"the port {port} cannot be used", where="--port", remedy="Leave it out") from None
    port, token = int(listener.getsockname()[1]), secrets.token_urlsafe(24)
    app = LocalPage(WorkFolder(folder)).app(port, token)
    end_elapsed_time()
    address = f"http://{HOST}:{port}/?token={token}"
    say(address)
    if show:
        import webbrowser

        webbrowser.open(address)
    config = uvicorn.Config(app, log_level="error", lifespan="on", ws="none", server_header=False)
    asyncio.run(uvicorn.Server(config).serve(sockets=[listener]))

"""`RequestGuard`: only the person who started the page is served, from the page itself.

Another site in the same browser may send requests to 127.0.0.1, and under a name that it controls (DNS rebinding) read
the answers. Therefore the host must be this machine's, a stated origin must be the page's own, and every request brings
the token that was printed when the page was opened.
"""

from __future__ import annotations

import hmac
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import parse_qs

Send = Callable[[dict[str, Any]], Awaitable[None]]
Receive = Callable[[], Awaitable[dict[str, Any]]]

HOSTS = ("127.0.0.1", "localhost")
"""Names under which the page may be asked for."""
HEADERS = {
    "content-security-policy": "default-src 'none'; script-src 'self'; style-src 'unsafe-inline'; connect-src 'self'; "
    "frame-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'self'",
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cache-control": "no-store",
    "cross-origin-resource-policy": "same-origin",
}
"""Of every answer that states no other."""


@dataclass(frozen=True)
class RequestGuard:
    """An application of ASGI behind its guard.

    Parameters
    ----------
    app : callable
        What serves a request that is let in.
    port : int
        Of the page.
    token : str
        The secret of this page.
    """

    app: Callable[[dict[str, Any], Receive, Send], Awaitable[None]]
    port: int
    token: str

    @property
    def cookie(self) -> str:
        """The name under which a browser keeps the token; pages on other ports have their own."""
        return f"kfgen-{self.port}"

    async def __call__(self, scope: dict[str, Any], receive: Receive, send: Send) -> None:
        """Serve, refuse, or take the token of an address for a cookie."""
        if scope["type"] != "http":
            if scope["type"] == "lifespan":
                await self.app(scope, receive, send)
            return
        headers = {k.decode("latin-1").lower(): v.decode("latin-1") for k, v in scope["headers"]}
        refused = self.refused(headers)
        if refused:
            return await _say(send, 403, refused)
        given = parse_qs(scope["query_string"].decode("latin-1")).get("token", [""])[0]
        if scope["path"] == "/" and self._is_token(given):
            kept = f"{self.cookie}={self.token}; HttpOnly; SameSite=Strict; Path=/"
            return await _say(send, 303, "", {"location": "/", "set-cookie": kept})
        if not self._is_token(self._kept(headers)):
            return await _say(
                send, 401, "Open the address that 'kfgen open' printed: it ends with ?token=...\n"
            )
        await self.app(scope, receive, _with_headers(send))

    def refused(self, headers: Mapping[str, str]) -> str:
        """Why a request is refused by where it comes from; empty where it is not.

        Parameters
        ----------
        headers : mapping of str to str
            By small names.

        Returns
        -------
        str
        """
        hosts = {f"{name}:{self.port}" for name in HOSTS}
        if headers.get("host", "") not in hosts:
            return f"This page is served under 127.0.0.1:{self.port} only.\n"
        origin = headers.get("origin")
        if origin is not None and origin not in {f"http://{host}" for host in hosts}:
            return "Another site asked for this; only the page itself may.\n"
        if headers.get("sec-fetch-site", "none") not in ("none", "same-origin"):
            return "Another site asked for this; only the page itself may.\n"
        return ""

    def _kept(self, headers: Mapping[str, str]) -> str:
        try:
            kept = SimpleCookie(headers.get("cookie", "")).get(self.cookie)
        except CookieError:
            return ""
        return kept.value if kept is not None else ""

    def _is_token(self, given: str) -> bool:
        return hmac.compare_digest(given.encode(), self.token.encode())


def _with_headers(send: Send) -> Send:
    """The same, with `HEADERS` where an answer has no others of those names."""

    async def sent(message: dict[str, Any]) -> None:
        if message["type"] == "http.response.start":
            there = {k.decode("latin-1").lower() for k, _ in message["headers"]}
            more = [(k.encode(), v.encode()) for k, v in HEADERS.items() if k not in there]
            message = {**message, "headers": [*message["headers"], *more]}
        await send(message)

    return sent


async def _say(send: Send, status: int, words: str, headers: Mapping[str, str] | None = None) -> None:
    """A short answer in plain text."""
    lines = {"content-type": "text/plain; charset=utf-8", **HEADERS, **(headers or {})}
    own = [(k.encode(), v.encode()) for k, v in lines.items()]
    await send({"type": "http.response.start", "status": status, "headers": own})
    await send({"type": "http.response.body", "body": words.encode()})

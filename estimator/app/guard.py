"""Who may talk to the app: this machine, with the token, from the app's own page. Knows HTTP, no recording.

A page of another origin can make the browser send requests to 127.0.0.1. It does not know the token, its Origin is
another, and a name that was made to point to 127.0.0.1 (DNS rebinding) is another Host: each alone is refused.
"""

from __future__ import annotations

import secrets
from typing import Any

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self';"
    " font-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
HEADERS = {
    "Content-Security-Policy": POLICY,
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cache-Control": "no-store",
}
NO_TOKEN = "This address has no valid token. Open the one that fmu-estimator app has printed."
STRANGER = "This request comes from another page than the app's own, and is refused."


class Guard:
    """Lets requests through that carry the token as the first part of their path; sets the headers of all answers.

    Parameters
    ----------
    app : ASGI application
        Sees paths without the token: it is the application's root path.
    token : str
    port : int
        On which the server listens.
    """

    def __init__(self, app: ASGIApp, *, token: str, port: int) -> None:
        self._app, self._token = app, token
        self._hosts = {f"{name}:{port}" for name in ("127.0.0.1", "localhost")}
        self._origins = {f"http://{host}" for host in self._hosts}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer, or refuse with status 403."""
        if refusal := self._refusal(scope):
            await PlainTextResponse(refusal, status_code=403, headers=HEADERS)(scope, receive, send)
            return

        async def with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in HEADERS.items():
                    headers.setdefault(name, value)
            await send(message)

        await self._app({**scope, "root_path": f"/{self._token}"}, receive, with_headers)

    def _refusal(self, scope: Scope) -> str | None:
        headers = Headers(scope=scope)
        given = scope["path"].split("/", 2)
        if len(given) < 3 or not secrets.compare_digest(given[1].encode(), self._token.encode()):
            return NO_TOKEN
        if headers.get("host") not in self._hosts:
            return STRANGER
        origin: Any = headers.get("origin")
        if origin is not None and origin not in self._origins:
            return STRANGER
        if headers.get("sec-fetch-site") in ("cross-site", "same-site") and headers.get("sec-fetch-mode") != "navigate":
            return STRANGER
        return None

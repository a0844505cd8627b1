"""The app's server: addresses, answers and errors, on 127.0.0.1 only. Knows HTTP; leaves the work to the others."""

from __future__ import annotations

import contextlib
import json
import os
import secrets
import signal
import socket
import sys
import traceback
import webbrowser
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any
from urllib.parse import quote

import uvicorn
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import Route
from starlette.types import ASGIApp

from estimator.app.guard import Guard
from estimator.app.request_values import names_of, number_of, object_of, text_of
from estimator.app.series import Series, nearest, view
from estimator.app.service import Service
from estimator.app.workspace import Outdated, start_case
from estimator.errors import EstimatorError, InputError
from estimator.results.result_json import json_ready

PAGE = Path(__file__).parent / "page"
TYPES = {".html": "text/html", ".css": "text/css", ".js": "text/javascript", ".svg": "image/svg+xml"}
LOOPBACK = "127.0.0.1"
DEBUG = "FMU_ESTIMATOR_DEBUG"  # as in cli.py
# A report brings its own style and script. It gets an origin of its own, and can fetch nothing.
REPORT_POLICY = (
    "sandbox allow-scripts; default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; img-src data:"
)

Work = Callable[[Service, Request, Any], Any]


def _state(service: Service, request: Request, body: Any) -> Any:
    return service.state()


def _revision(service: Service, request: Request, body: Any) -> Any:
    return {"revision": service.workspace.revision, "runs": service.runs.listed(), "files": service.stamp()}


def _change(service: Service, request: Request, body: Any) -> Any:
    body = object_of(body)
    try:
        service.workspace.change(body.get("revision"), body.get("changes"))
    except Outdated:
        raise HTTPException(409, "the case was changed in another tab; this one now shows it") from None
    return service.state()


def _open(service: Service, request: Request, body: Any) -> Any:
    service.workspace.open(text_of(body, "name"))
    return service.state()


def _save(service: Service, request: Request, body: Any) -> Any:
    return {"name": service.workspace.save(text_of(body, "name"))}


def _upload(service: Service, request: Request, body: Any) -> Any:
    return {"name": service.place.receive(request.query_params.get("name", ""), body)}


def _bare(service: Service, request: Request, body: Any) -> Any:
    return service.bare(request.query_params.get("name", ""))


def _recording(service: Service, request: Request, body: Any) -> Any:
    query = request.query_params
    return service.recording_facts(query.get("name", ""), int(number_of(query.get("part", "0"))))


def _check(service: Service, request: Request, body: Any) -> Any:
    return service.checked(request.query_params.get("name", ""))


def _inspect(service: Service, request: Request, body: Any) -> Any:
    return service.inspected(request.query_params.get("fmu", ""))


def _picture(service: Service, request: Request, body: Any) -> Any:
    made = service.picture(request.query_params)
    return {
        "recordings": [
            {"name": name, "begin": s.time[0], "end": s.time[-1], "signals": list(s.signals), "transient": movement}
            for name, s, movement in zip(made.names, made.recordings, made.transients, strict=True)
        ],
        "units": made.units,
        "fit_percent": made.fit_percent,
    }


def _view(service: Service, request: Request, body: Any) -> Response:
    query = request.query_params
    series = service.series(query)
    wanted = query.get("signals")
    if wanted is not None:
        names = [name for name in series.signals if name in names_of(wanted)]
        series = Series(series.time, {name: series.signals[name] for name in names})
    start = number_of(query["from"]) if "from" in query else float(series.time[0])
    end = number_of(query["to"]) if "to" in query else float(series.time[-1])
    content = view(series, start=start, end=end, buckets=int(number_of(query.get("buckets", "1500"))))
    return Response(content, media_type="application/octet-stream")


def _sample(service: Service, request: Request, body: Any) -> Any:
    time, values = nearest(service.series(request.query_params), number_of(request.query_params.get("at", "0")))
    return {"time": time, "values": values}


def _start(service: Service, request: Request, body: Any) -> Any:
    service.runs.check_free()
    service.workspace.plan()  # says what is wrong before a case file is written
    name, case = service.workspace.snapshot("run")
    return service.runs.start(name, case).state()


def _run(service: Service, request: Request, body: Any) -> Any:
    return service.runs.run(request.path_params["name"]).state()


def _stop(service: Service, request: Request, body: Any) -> Any:
    run = service.runs.run(request.path_params["name"])
    run.stop()
    return run.state()


def _outcome(service: Service, request: Request, body: Any) -> Any:
    return service.outcomes.outcome(request.query_params.get("name", ""))


def _compare(service: Service, request: Request, body: Any) -> Any:
    return service.outcomes.compared(names_of(request.query_params.get("names", "[]")))


def _ripple(service: Service, request: Request, body: Any) -> Any:
    query = request.query_params
    return service.outcomes.ripple(query.get("name", ""), int(number_of(query.get("recording", "0"))))


def _file(service: Service, request: Request, body: Any) -> Response:
    query = request.query_params
    path, kind = service.outcomes.file(query.get("name", ""), query.get("file", ""))
    headers = {} if "download" not in query else _attachment(path.name)
    if path.suffix in (".html", ".svg"):
        headers["Content-Security-Policy"] = REPORT_POLICY
    return FileResponse(path, media_type=kind, headers=headers)


def _export(service: Service, request: Request, body: Any) -> Response:
    query = request.query_params
    name, content = service.outcomes.export(query.get("name", ""), query.get("format", ""))
    return Response(content, media_type="application/octet-stream", headers=_attachment(name))


ROUTES: tuple[tuple[str, str, Work], ...] = (
    ("GET", "/api/state", _state),
    ("GET", "/api/revision", _revision),
    ("POST", "/api/change", _change),
    ("POST", "/api/open", _open),
    ("POST", "/api/save", _save),
    ("POST", "/api/upload", _upload),
    ("GET", "/api/recording", _recording),
    ("GET", "/api/bare", _bare),
    ("GET", "/api/check", _check),
    ("GET", "/api/inspect", _inspect),
    ("GET", "/api/picture", _picture),
    ("GET", "/api/view", _view),
    ("GET", "/api/sample", _sample),
    ("POST", "/api/runs", _start),
    ("GET", "/api/runs/{name}", _run),
    ("POST", "/api/runs/{name}/stop", _stop),
    ("GET", "/api/result", _outcome),
    ("GET", "/api/compare", _compare),
    ("GET", "/api/ripple", _ripple),
    ("GET", "/api/file", _file),
    ("GET", "/api/export", _export),
)


def application(service: Service, *, token: str, port: int) -> ASGIApp:
    """Return the app as an ASGI application, guarded."""
    routes = [Route(path, _endpoint(service, work), methods=[method]) for method, path, work in ROUTES]
    routes += [Route("/", partial(_asset, "index.html")), Route("/page/{name}", _named_asset)]
    app = Starlette(routes=routes, exception_handlers={HTTPException: _http_error})
    return Guard(app, token=token, port=port)


def serve(folder: str | Path, *, port: int, browser: bool, say: Callable[[str], None]) -> int:
    """Serve until Ctrl-C; print the address first, and open a browser there if one is wanted.

    Raises
    ------
    InputError
        There is no such folder, or the port is taken.
    """
    with socket.socket() as listener:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listener.bind((LOOPBACK, port))
        except (OSError, OverflowError) as error:
            raise InputError(f"port {port} cannot be had ({error}); give another --port, or none") from None
        port = listener.getsockname()[1]
        token = secrets.token_urlsafe(24)
        service = Service(folder)
        start_case(service.workspace)
        app = application(service, token=token, port=port)
        listener.listen()
        address = f"http://{LOOPBACK}:{port}/{token}/"
        # What goes wrong is told to the page, and what is not foreseen to the terminal too.
        quiet: dict[str, Any] = {"log_level": "critical", "access_log": False, "ws": "none", "lifespan": "off"}
        server = _Server(uvicorn.Config(app, timeout_graceful_shutdown=2, **quiet), service)
        with contextlib.suppress(KeyboardInterrupt), server.ended_by_interrupt():
            say(f"{address}\nThe bench of {Path(folder).resolve()}. Ctrl-C ends it.\n")
            if browser:
                webbrowser.open(address)
            server.run(sockets=[listener])
    return 0


class _Server(uvicorn.Server):
    """A server that ends what is running before it waits for the answers that need it."""

    def __init__(self, config: uvicorn.Config, service: Service) -> None:
        super().__init__(config)
        self._service = service

    @contextlib.contextmanager
    def ended_by_interrupt(self) -> Iterator[None]:
        """Let Ctrl-C end the server from here on, also before it listens to signals itself."""
        before = signal.signal(signal.SIGINT, self.handle_exit)
        try:
            yield
        finally:
            signal.signal(signal.SIGINT, before)

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """End the runs, then the server."""
        await run_in_threadpool(self._service.close)
        await super().shutdown(sockets=sockets)


def _endpoint(service: Service, work: Work) -> Callable[[Request], Any]:
    async def answer(request: Request) -> Response:
        body: Any = None
        if request.method == "POST":
            body = await request.body()
            if work is not _upload:
                try:
                    body = json.loads(body or b"{}")
                except (ValueError, RecursionError):
                    raise HTTPException(400, "the request is no JSON") from None
        try:
            made = await run_in_threadpool(work, service, request, body)
        except HTTPException:
            raise
        except EstimatorError as error:
            raise HTTPException(400, str(error)) from None
        except json.JSONDecodeError:
            raise HTTPException(400, "the request is no JSON") from None
        except FileNotFoundError as error:
            raise HTTPException(400, f"there is no file {error.filename}") from None
        except OSError as error:
            raise HTTPException(400, f"{error.filename or ''}: {error.strerror or error}") from None
        except Exception as error:
            complain(f"internal error, {type(error).__name__}: {error}")
            if os.environ.get(DEBUG):
                traceback.print_exc()
            raise HTTPException(500, f"internal error, {type(error).__name__}: {error}") from None
        return made if isinstance(made, Response) else JSONResponse(json_ready(made))

    return answer


async def _http_error(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    return JSONResponse({"error": error.detail}, status_code=error.status_code)


async def _asset(name: str, request: Request) -> Response:
    path = PAGE / name
    if not path.is_file() or path.suffix not in TYPES or path.parent != PAGE:
        raise HTTPException(404, "there is no such page")
    return FileResponse(path, media_type=TYPES[path.suffix])


async def _named_asset(request: Request) -> Response:
    return await _asset(request.path_params["name"], request)


def complain(sentence: str) -> None:
    """Write one sentence to stderr."""
    with contextlib.suppress(OSError, ValueError):
        print(f"fmu-estimator: {' '.join(sentence.split())}", file=sys.stderr)


def _attachment(name: str) -> dict[str, str]:
    return {"Content-Disposition": f"attachment; filename*=UTF-8''{quote(name, safe='')}"}

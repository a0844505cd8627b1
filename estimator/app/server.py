"""The app's server: addresses, answers and errors, on 127.0.0.1 only. Knows HTTP; leaves the work to the others."""

from __future__ import annotations

import contextlib
import json
import os
import secrets
import shlex
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

from estimator.app import program
from estimator.app.guard import Guard
from estimator.app.outcomes import Outcomes
from estimator.app.place import Place
from estimator.app.preview import Picture, Previews
from estimator.app.reading import bare_facts, facts, reading_options, series_of
from estimator.app.runs import Runs
from estimator.app.series import Series, nearest, view
from estimator.app.workspace import Outdated, Workspace, start_case
from estimator.errors import EstimatorError, InputError
from estimator.results.result_json import json_ready

PAGE = Path(__file__).parent / "page"
TYPES = {".html": "text/html", ".css": "text/css", ".js": "text/javascript", ".svg": "image/svg+xml"}
LOOPBACK = "127.0.0.1"
INSPECTION_LIMIT, CHECK_LIMIT = 90.0, 90.0  # s
DEBUG = "FMU_ESTIMATOR_DEBUG"  # as in cli.py
# A report brings its own style and script. It gets an origin of its own, and can fetch nothing.
REPORT_POLICY = (
    "sandbox allow-scripts; default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; img-src data:"
)

Work = Callable[["Service", Request, Any], Any]


class Service:
    """What answers are made of: the folder, the case under way, its runs, pictures and results."""

    def __init__(self, folder: str | Path) -> None:
        self.place = Place(folder)
        self.workspace = Workspace(self.place)
        self.runs = Runs(self.place)
        self.outcomes = Outcomes(self.place)
        self.previews = Previews()
        self._facts: dict[tuple[Path, int], Any] = {}
        self._checked: dict[tuple[str, float], Any] = {}
        self._inspected: dict[tuple[str, float], Any] = {}

    def close(self) -> None:
        """End what is running."""
        program.end_all()
        self.runs.close()
        self.previews.close()

    def state(self) -> dict[str, Any]:
        """Return all that the page shows but long signals."""
        import fmu_build

        files = self.place.listed()
        return {
            **self.workspace.state(),
            "folder": str(self.place.path),
            "stamp": self.stamp(),
            "files": files,
            "models": fmu_build.bundled_names(),
            "runs": self.runs.listed(),
            "results": [self.outcomes.summary(name) for name in files["results"]],
        }

    def stamp(self) -> str:
        """Return a text that changes when a file or a result comes or goes."""
        files = self.place.listed()
        return repr((files, [self.outcomes.written(name) for name in files["results"]]))

    def recording_facts(self, name: str, part: int) -> Any:
        """Return what was read from a recording's file, or what is wrong with it."""
        path = self.place.inside(name)
        if not path.is_file():
            raise InputError(f"there is no recording {name!r}")
        recording = self.workspace.recording(path, part)
        key = (path, id(recording))
        if key not in self._facts:
            self._facts = {k: v for k, v in self._facts.items() if k[0] != path}
            self._facts[key] = facts(recording, written=self.workspace.written(path, part))
        parts = len(self.workspace.recordings(path))
        return {
            **self._facts[key],
            "parts": parts,
            "tests": self.workspace.tests(path),
            "motors": list(self.workspace.motors(path)),
        }

    def bare(self, name: str) -> Any:
        """Return what a file holds that cannot be read as it is, and what it lacks."""
        path = self.place.inside(name)
        if not path.is_file():
            raise InputError(f"there is no recording {name!r}")
        return bare_facts(*self.workspace.bare(path))

    def checked(self, name: str) -> Any:
        """Return what the command `check` says of a recording, and the command."""
        path = self.place.inside(name)
        options = reading_options(self.workspace.read_as(path))
        key = (shlex.join([name, *options]), path.stat().st_mtime)
        if key not in self._checked:
            arguments = ["check", "--json", *options, "--", name]
            self._checked[key] = json.loads(program.output_of(arguments, folder=self.place.path, limit=CHECK_LIMIT))
        return {"check": self._checked[key], "command": program.shown(["check", name, *options])}

    def inspected(self, fmu: str) -> Any:
        """Return what the command `inspect` says of an FMU, and the command."""
        import fmu_build

        bundled = fmu in fmu_build.bundled_names()
        stamp = 0.0 if bundled else self.place.inside(fmu).stat().st_mtime
        if (fmu, stamp) not in self._inspected:
            text = program.output_of(["inspect", fmu, "--json"], folder=self.place.path, limit=INSPECTION_LIMIT)
            self._inspected[fmu, stamp] = json.loads(text)
        return {"inspection": self._inspected[fmu, stamp], "command": program.shown(["inspect", fmu])}

    def picture(self, query: Any) -> Picture:
        """Return the picture that a request means: a start of the case, or the best candidate of a run."""
        if query.get("of") == "run":
            run = self.runs.run(query.get("name", ""))
            return self.previews.picture(("run", run.name), partial(self.workspace.plan_of, run.case), run.best)
        given = _object(json.loads(query.get("values") or "{}"))
        values = {name: _number(value) for name, value in given.items()}
        return self.previews.picture(("case", self.workspace.revision), self.workspace.plan, values)

    def series(self, query: Any) -> Series:
        """Return the signals that a request means."""
        number = int(_number(query.get("recording", "0")))
        if query.get("of") == "recording":
            path = self.place.inside(query.get("name", ""))
            if not path.is_file():
                raise InputError(f"there is no recording {query.get('name')!r}")
            return series_of(self.workspace.recording(path, int(_number(query.get("part", "0")))))
        if query.get("of") == "result":
            return self.outcomes.series(query.get("name", ""), number)
        recordings = self.picture(query).recordings
        if not 0 <= number < len(recordings):
            raise InputError(f"there is no recording number {number}; there are {len(recordings)}, counted from 0")
        return recordings[number]


def _state(service: Service, request: Request, body: Any) -> Any:
    return service.state()


def _revision(service: Service, request: Request, body: Any) -> Any:
    return {"revision": service.workspace.revision, "runs": service.runs.listed(), "files": service.stamp()}


def _change(service: Service, request: Request, body: Any) -> Any:
    body = _object(body)
    try:
        service.workspace.change(body.get("revision"), body.get("changes"))
    except Outdated:
        raise HTTPException(409, "the case was changed in another tab; this one now shows it") from None
    return service.state()


def _open(service: Service, request: Request, body: Any) -> Any:
    service.workspace.open(_text(body, "name"))
    return service.state()


def _save(service: Service, request: Request, body: Any) -> Any:
    return {"name": service.workspace.save(_text(body, "name"))}


def _upload(service: Service, request: Request, body: Any) -> Any:
    return {"name": service.place.receive(request.query_params.get("name", ""), body)}


def _bare(service: Service, request: Request, body: Any) -> Any:
    return service.bare(request.query_params.get("name", ""))


def _recording(service: Service, request: Request, body: Any) -> Any:
    query = request.query_params
    return service.recording_facts(query.get("name", ""), int(_number(query.get("part", "0"))))


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
        names = [name for name in series.signals if name in _names(wanted)]
        series = Series(series.time, {name: series.signals[name] for name in names})
    start = _number(query["from"]) if "from" in query else float(series.time[0])
    end = _number(query["to"]) if "to" in query else float(series.time[-1])
    content = view(series, start=start, end=end, buckets=int(_number(query.get("buckets", "1500"))))
    return Response(content, media_type="application/octet-stream")


def _sample(service: Service, request: Request, body: Any) -> Any:
    time, values = nearest(service.series(request.query_params), _number(request.query_params.get("at", "0")))
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
    return service.outcomes.compared(_names(request.query_params.get("names", "[]")))


def _ripple(service: Service, request: Request, body: Any) -> Any:
    query = request.query_params
    return service.outcomes.ripple(query.get("name", ""), int(_number(query.get("recording", "0"))))


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
                except ValueError:
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


def _object(body: Any) -> dict[str, Any]:
    if not isinstance(body, dict):
        raise InputError("the request must be an object")
    return body


def _text(body: Any, key: str) -> str:
    text = _object(body).get(key)
    if not isinstance(text, str) or not text:
        raise InputError(f"the request must have a text {key!r}")
    return text


def _names(text: str) -> list[str]:
    names = json.loads(text)
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise InputError("names must be a list of texts")
    return names


def _number(value: Any) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError):
        raise InputError(f"{value!r} is no number; give one, such as 0.5") from None
    if number - number != 0:
        raise InputError(f"{value!r} is no finite number; give one, such as 0.5")
    return number

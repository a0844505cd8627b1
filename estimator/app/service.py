"""What the app's answers are made of: the folder, the case under way, its runs and results. Knows no HTTP."""

from __future__ import annotations

import json
import shlex
from functools import partial
from pathlib import Path
from typing import Any

from estimator.app import program
from estimator.app.outcomes import Outcomes
from estimator.app.place import Place
from estimator.app.preview import Picture, Previews
from estimator.app.reading import bare_facts, facts, reading_options, series_of
from estimator.app.request_values import number_of, object_of
from estimator.app.runs import Runs
from estimator.app.series import Series
from estimator.app.workspace import Workspace
from estimator.errors import InputError

INSPECTION_LIMIT, CHECK_LIMIT = 90.0, 90.0  # s


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
        given = object_of(json.loads(query.get("values") or "{}"))
        values = {name: number_of(value) for name, value in given.items()}
        return self.previews.picture(("case", self.workspace.revision), self.workspace.plan, values)

    def series(self, query: Any) -> Series:
        """Return the signals that a request means."""
        number = int(number_of(query.get("recording", "0")))
        if query.get("of") == "recording":
            path = self.place.inside(query.get("name", ""))
            if not path.is_file():
                raise InputError(f"there is no recording {query.get('name')!r}")
            return series_of(self.workspace.recording(path, int(number_of(query.get("part", "0")))))
        if query.get("of") == "result":
            return self.outcomes.series(query.get("name", ""), number)
        recordings = self.picture(query).recordings
        if not 0 <= number < len(recordings):
            raise InputError(f"there is no recording number {number}; there are {len(recordings)}, counted from 0")
        return recordings[number]

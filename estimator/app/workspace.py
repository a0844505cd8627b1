"""The case under way in the app: its recordings, its FMU, its plan, its file. Knows no HTTP; simulates nothing.

Every change is written to the folder as a case file at once, so that a restart, a reload and a second tab go on from
the same place. A change that was made from an older state than the present one is refused.
"""

from __future__ import annotations

import contextlib
import dataclasses
import shlex
import tempfile
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from estimator.app.case_json import (
    kind_of,
    parameters_shown,
    recordings_shown,
    with_mapping,
    with_parameters,
    with_recordings,
    with_search,
)
from estimator.app.place import DRAFT, Place
from estimator.cases.case import Case, RunSpec, read_case
from estimator.cases.init_case import case_text
from estimator.cases.si_units import in_si_units
from estimator.cases.strict_toml import CASE_SUFFIX
from estimator.cases.written_case import write_case
from estimator.errors import EstimatorError, InputError, suggestion
from estimator.fmus.fmu import FmuDescription, describe, with_kind
from estimator.fmus.probe import driven
from estimator.motor.names import has_motor
from estimator.plans.plan import Plan
from estimator.plans.planning import plan_case
from estimator.plans.planning import read_case as read_recordings_of
from estimator.recordings.files import recordings_in
from estimator.recordings.headers import ROLE_TITLE, parse_header
from estimator.recordings.made_columns import motors
from estimator.recordings.motor_columns import motor_columns
from estimator.recordings.read_as import AS_WRITTEN, ReadAs
from estimator.recordings.recording import Recording

KEPT_RECORDINGS = 12
PARTS = ("recordings", "fmu", "kind", "mapping", "parameters", "search")  # of a case, that the page changes
BARE = (  # ways to read a file that lacks something, with any clock
    (ReadAs(rate=1.0), ("time",)),
    (ReadAs(rate=1.0, columns={"v": "1"}), ("header", "time")),
)


class Outdated(Exception):
    """A change was made from a state that another tab has changed since."""


class Workspace:
    """The case under way.

    Parameters
    ----------
    place : Place
    """

    def __init__(self, place: Place) -> None:
        self.place = place
        self.lock = threading.RLock()
        self.revision = 0
        self.case = Case()
        self.off: dict[Path, RunSpec] = {}
        self._read: dict[tuple[Path, str], tuple[tuple[int, int], list[Recording]]] = {}
        self._described: dict[tuple[str, str | None, int], FmuDescription] = {}
        self._planned: tuple[int, Plan | None, str | None] = (-1, None, None)
        draft = place.path / DRAFT
        if draft.is_file():
            with contextlib.suppress(EstimatorError):  # changed by hand, or its recordings have gone: begin anew
                self.case = read_case(draft)

    def change(self, revision: Any, changes: Any) -> None:
        """Change parts of the case: "recordings", "mapping", "parameters", "search", "fmu" and "kind".

        Parameters
        ----------
        revision : int
            The state from which the change was made.

        Raises
        ------
        Outdated
            It is not the present one.
        InputError
            A part is not what it should be; nothing is changed then.
        """
        if not isinstance(changes, Mapping):
            raise InputError("a change must be an object")
        unknown = [key for key in changes if key not in PARTS]
        if unknown:
            raise InputError(f"a case has no part {unknown[0]!r}{suggestion(str(unknown[0]), PARTS)}")
        with self.lock:
            if revision != self.revision:
                raise Outdated
            case, off = self.case, self.off
            if "recordings" in changes:
                case, off = with_recordings(case, changes["recordings"], self.place, off=off)
            if "fmu" in changes:
                case = self._with_fmu(case, str(changes["fmu"]), kind_of(changes.get("kind")))
            if "mapping" in changes:
                case = with_mapping(case, changes["mapping"])
            if "parameters" in changes:
                case = with_parameters(case, changes["parameters"], in_si_units(self.description(case)))
            if "search" in changes:
                case = with_search(case, changes["search"])
            self._keep(case, off)

    def open(self, name: str) -> None:
        """Take a case file of the folder as the case under way; the file itself stays as it is."""
        case = read_case(self.place.inside(name))
        with self.lock:
            self._keep(case, {})

    def save(self, name: str) -> str:
        """Write the case under way under a name of its own, which must be new; return the name."""
        name = name if name.endswith(CASE_SUFFIX) else f"{name}{CASE_SUFFIX}"
        path = self.place.inside(name)
        if path.exists():
            raise InputError(f"{name} is there already; give another name")
        with self.lock:
            self._check_recordings()
            write_case(self.case, path)
        return name

    def snapshot(self, stem: str) -> tuple[str, Case]:
        """Write the case for a run of its own; return the run's name and the case as it reads back."""
        with self.lock:
            self._check_recordings()
            name = self.place.free_name(stem)
            path = self.place.path / f"{name}{CASE_SUFFIX}"
            write_case(self.case, path)
            return name, read_case(path)

    def recordings(self, path: Path, read_as: ReadAs | None = None) -> list[Recording]:
        """Return the recordings that a file holds, mostly one, from memory if it has not changed since.

        Parameters
        ----------
        read_as : how it is read; None: as the case says

        Raises
        ------
        InputError
            It cannot be read: one sentence.
        """
        read_as = self.read_as(path) if read_as is None else read_as
        status = path.stat()
        stamp, key = (status.st_mtime_ns, status.st_size), (path, repr(read_as))
        with self.lock:
            known = self._read.pop(key, None)
            if known is None or known[0] != stamp:
                known = (stamp, recordings_in(path, read_as))
            self._read[key] = known
            while len(self._read) > KEPT_RECORDINGS:
                del self._read[next(iter(self._read))]
        return known[1]

    def recording(self, path: Path, part: int = 0) -> Recording:
        """Return one of the recordings that a file holds, read as the case says.

        Raises
        ------
        InputError
            It cannot be read, or there is no such one.
        """
        found = self.recordings(path)
        if not 0 <= part < len(found):
            raise InputError(f"{path.name} holds no test number {part}; there are {len(found)}, counted from 0")
        return found[part]

    def written(self, path: Path, part: int) -> Mapping[str, str]:
        """Return each column's header as it stands in the file, where the case says other units."""
        read_as = self.read_as(path)
        if not read_as.units:
            return {}
        try:
            found = self.recordings(path, dataclasses.replace(read_as, units={}))
        except EstimatorError:  # it cannot be read as it is written
            return {}
        return found[part].headers if part < len(found) else {}

    def bare(self, path: Path) -> tuple[Recording, tuple[str, ...]]:
        """Return a file read whatever it lacks, and what that is: "time", or "header" and "time".

        Raises
        ------
        InputError
            It holds no columns of numbers.
        """
        try:
            return self.recordings(path, AS_WRITTEN)[0], ()
        except EstimatorError as error:
            reason = error
        for read_as, lacks in BARE:
            with contextlib.suppress(EstimatorError):
                return self.recordings(path, read_as)[0], lacks
        raise reason

    def tests(self, path: Path) -> list[str]:
        """Return the names of the tests that a file holds, whichever the case takes; empty for one."""
        every = self.recordings(path, dataclasses.replace(self.read_as(path), test=None))
        return [r.name.removeprefix(f"{path.stem} ") for r in every] if len(every) > 1 else []

    def motors(self, path: Path) -> tuple[str, ...]:
        """Return the motors whose signals lie side by side in a file, whichever the case takes."""
        return motors(self.recordings(path, dataclasses.replace(self.read_as(path), motor=None))[0])

    def read_as(self, path: Path) -> ReadAs:
        """Return how the case says that a file is read."""
        with self.lock:
            runs = {
                **self.off,
                **dict(zip(self.case.recordings, self.case.runs_of(len(self.case.recordings)), strict=True)),
            }
        return runs[path].read_as if path in runs else AS_WRITTEN

    def description(self, case: Case) -> FmuDescription:
        """Return what a case's FMU says of itself, and how it is driven; a worker process probes it once."""
        path = Path(case.fmu)
        stamp = path.stat().st_mtime_ns if path.is_absolute() and path.is_file() else 0
        key = (case.fmu, case.kind, stamp)
        with self.lock:
            if key not in self._described:
                self._described[key] = driven(with_kind(describe(case.fmu), case.kind))
            return self._described[key]

    def plan(self) -> Plan:
        """Return the case made concrete.

        Raises
        ------
        InputError
            Something in it is wrong: one sentence.
        """
        with self.lock:
            if self._planned[0] != self.revision:
                try:
                    self._planned = (self.revision, self.plan_of(self.case), None)
                except EstimatorError as error:
                    self._planned = (self.revision, None, str(error))
            _, plan, problem = self._planned
        if plan is None:
            raise InputError(problem or "")
        return plan

    def plan_of(self, case: Case) -> Plan:
        """Return a case made concrete, its recordings from memory."""
        if not case.recordings:
            raise InputError("no recording is chosen to fit to; drop one here, or choose one of the folder's")
        case, recordings = read_recordings_of(case, read=self.recordings)
        return plan_case(case, self.description(case), recordings=recordings)

    def state(self) -> dict[str, Any]:
        """Return all that the page shows of the case."""
        with self.lock:
            plan, problem, description = None, None, None
            try:
                description = in_si_units(self.description(self.case))
                plan = self.plan()
            except EstimatorError as error:
                problem = str(error)
            return {
                "revision": self.revision,
                "fmu": self.case.fmu if not Path(self.case.fmu).is_absolute() else self.place.name_of(self.case.fmu),
                "kind": self.case.kind,
                "recordings": recordings_shown(self.case, self.off, self.place),
                "mapping": self._mapping(),
                "mapped": bool(self.case.inputs or self.case.outputs),
                "targets": self._targets(description),
                "parameters": [] if description is None else parameters_shown(self.case, description, plan),
                "explicit": self._is_explicit(description),
                "search": {
                    "method": self.case.search.method,
                    "seed": self.case.search.seed,
                    "loss": self.case.search.loss,
                },
                "problem": problem,
                "notes": [] if plan is None else list(plan.notes),
                "observed": [] if plan is None else [o.recording.title for o in plan.observed],
                "text": self.text(),
                "command": shlex.join(["fmu-estimator", "estimate", DRAFT]) if self.case.recordings else "",
            }

    def text(self) -> str:
        """Return the text of the case file."""
        path = self.place.path / DRAFT
        return path.read_text(encoding="utf-8") if self.case.recordings and path.is_file() else ""

    def _keep(self, case: Case, off: dict[Path, RunSpec]) -> None:
        """Write the case, see that it reads back, and take it."""
        path = self.place.path / DRAFT
        before = path.read_bytes() if path.is_file() else None
        if case.recordings and not all(case.run(k).validate for k in range(len(case.recordings))):
            write_case(case, path)
            try:
                case = read_case(path)
            except EstimatorError:
                if before is None:
                    path.unlink()
                else:
                    path.write_bytes(before)
                raise
        elif not case.recordings:
            path.unlink(missing_ok=True)
        self.case, self.off = case, off
        self.revision += 1

    def _with_fmu(self, case: Case, fmu: str, kind: str | None) -> Case:
        """Return the case with another FMU; what names variables of the one before is left behind."""
        import fmu_build

        bundled = fmu in fmu_build.bundled_names()
        path = fmu if bundled else str(self.place.inside(fmu))
        changed = Case(fmu=path, kind=kind, recordings=case.recordings, runs=case.runs, search=case.search)
        description = self.description(changed)
        if has_motor({v.name for v in description.of_causality("parameter")}) or not case.recordings:
            return changed
        with tempfile.TemporaryDirectory() as folder:
            guess = Path(folder) / f"guess{CASE_SUFFIX}"
            text = case_text(description, self.recording(case.recordings[0]), fmu=path, folder=Path(folder))
            guess.write_text(text, encoding="utf-8")
            try:
                guessed = read_case(guess)
            except EstimatorError:
                return changed
        parts = ("inputs", "input_variables", "outputs", "parameters", "fixed")
        return dataclasses.replace(changed, **{part: getattr(guessed, part) for part in parts})

    def _mapping(self) -> dict[str, dict[str, str]]:
        """Return which column is on which input and output: as the case says, else by the usual names."""
        if self.case.inputs or self.case.outputs:
            return {
                "inputs": dict(self.case.inputs),
                "outputs": {name: spec.column for name, spec in self.case.outputs.items()},
            }
        for path in self.case.recordings:
            try:
                recording = self.recording(path)
                found = motor_columns(recording, required=[])
            except (EstimatorError, OSError):
                continue
            written = {role: parse_header(recording.headers[column]).text for role, column in found.items()}
            return {
                "inputs": {role: written[role] for role in ("v", "load") if role in written},
                "outputs": {role: written[role] for role in ("i", "w", "angle") if role in written},
            }
        return {"inputs": {}, "outputs": {}}

    def _targets(self, description: FmuDescription | None) -> list[dict[str, str]]:
        """Return what a column can be put on: the case's names, then the FMU's inputs and outputs."""
        if description is None:
            return []
        own = {name: ("input", self.case.input_variables.get(name, name)) for name in self.case.inputs}
        own |= {name: ("output", spec.fmu or name) for name, spec in self.case.outputs.items()}
        taken = {variable for _, variable in own.values()}
        for causality in ("input", "output"):
            own |= {
                v.name: (causality, v.name)
                for v in description.of_causality(causality)
                if v.is_real and v.name not in taken
            }
        units = {v.name: v.unit for v in description.variables}
        return [
            {
                "name": name,
                "causality": causality,
                "variable": variable,
                "unit": units.get(variable, ""),
                "title": ROLE_TITLE.get(name, ""),
            }
            for name, (causality, variable) in own.items()
        ]

    def _is_explicit(self, description: FmuDescription | None) -> bool:
        """Whether the case says itself which parameters are free."""
        inputs = set() if description is None else {v.name for v in description.of_causality("input")}
        return bool(self.case.parameters) or not set(self.case.fixed) <= inputs

    def _check_recordings(self) -> None:
        if not self.case.recordings:
            raise InputError("no recording is chosen to fit to; drop one here, or choose one of the folder's")


def start_case(workspace: Workspace) -> None:
    """Take the only recording of a folder that has one, no case under way and no case file."""
    files = workspace.place.listed()
    if workspace.case.recordings or len(files["recordings"]) != 1:
        return
    row = {"file": files["recordings"][0], "role": "fit"}
    with contextlib.suppress(InputError):
        workspace.change(workspace.revision, {"recordings": [row]})

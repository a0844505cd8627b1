"""The probe's stages, in a worker process: one FMU made to run, repeat, reset and step. Knows no verdicts.

A stage may crash or hang this process; its owner (probe.py) draws the conclusion. Trajectories are compared bit by bit.
"""

from __future__ import annotations

import contextlib
import ctypes
import math
import time
from collections.abc import Mapping, Sequence
from ctypes import CFUNCTYPE, POINTER, c_char_p, c_double, c_int, c_size_t, c_uint32, c_void_p
from typing import Any

from estimator.stepping.fmu_instance import FmuInstance
from estimator.stepping.layout import JobLayout, positions, status_name

LEAST_STEPS = 10  # of a run that ends early, to be one
Rows = list[list[float]]

_PROTOTYPES: dict[str, tuple[Any, ...]] = {
    "instantiate": (c_void_p, c_char_p, c_int, c_char_p, c_char_p, c_void_p, c_int, c_int),
    "free_instance": (None, c_void_p),
    "reset": (c_int, c_void_p),
    "setup_experiment": (c_int, c_void_p, c_int, c_double, c_double, c_int, c_double),
    "enter_initialization": (c_int, c_void_p),
    "exit_initialization": (c_int, c_void_p),
    "set_real": (c_int, c_void_p, POINTER(c_uint32), c_size_t, POINTER(c_double)),
    "get_real": (c_int, c_void_p, POINTER(c_uint32), c_size_t, POINTER(c_double)),
    "do_step": (c_int, c_void_p, c_double, c_double, c_int),
}


class Refused(Exception):
    """The FMU answered with a status that is no success."""


class Prober:
    """One FMU in this process, and what its first run showed.

    Parameters
    ----------
    order : the job's layout without experiments, and "values", "other", "inputs", "start", "h", "horizon", "patience"
    """

    def __init__(self, order: Mapping[str, Any]) -> None:
        job = dict(order["job"])
        for name in ("settings", "scale", "types", "counts", "experiments"):
            job[name] = tuple(tuple(x) if isinstance(x, list) else x for x in job.get(name, ()))
        self.loaded = FmuInstance(JobLayout(**job), 0)
        fmu = self.loaded.fmu
        self.call = {name: CFUNCTYPE(*types)(getattr(fmu, name)) for name, types in _PROTOTYPES.items()}
        layout = self.loaded.layout
        if layout.is_fast:
            self.references = (layout.parameter_references, layout.input_references, layout.output_references)
        else:
            self.references = positions(layout)
        self.values: list[float] = order["values"]
        self.other: list[float] = order["other"]
        self.inputs: list[float] = order["inputs"]
        self.start, self.h, self.horizon = float(order["start"]), float(order["h"]), float(order["horizon"])
        self.patience = float(order["patience"])
        self.steps = order.get("steps")
        self.first: Rows | None = None
        self.component: int | None = None
        self.stopped = ""  # why the first run ended early
        self.volatile = frozenset(order.get("volatile", ()))  # columns that are different in every run

    def stage(self, name: str) -> dict[str, Any]:
        """Run one stage."""
        found: dict[str, Any] = getattr(self, f"_{name}")()
        return found

    # The stages

    def _run(self) -> dict[str, Any]:
        began = time.perf_counter()
        rows = self._baseline()
        seconds = time.perf_counter() - began
        finite = all(math.isfinite(y) for row in rows for y in row)
        moves = any(row != rows[0] for row in rows)
        columns = list(zip(*rows, strict=True))
        return {
            "steps": len(rows) - 1,
            "seconds": seconds,
            "finite": finite,
            "moves": moves,
            "stopped": self.stopped,
            "digest": [y.hex() for y in rows[-1]],
            "last": [y if math.isfinite(y) else None for y in rows[-1]],
            "span": [max(c) - min(c) if all(map(math.isfinite, c)) else None for c in columns],
            "words": self.loaded.log.last.decode("utf-8", "replace"),
        }

    def _samples(self) -> dict[str, Any]:
        rows = self._baseline()
        return {"rows": [row for row in rows if all(map(math.isfinite, row))]}

    def _reset(self) -> dict[str, Any]:
        rows = self._baseline()
        self._disturb()
        self._check("reset", self.call["reset"](self.component))
        return {"honoured": self._same(self._simulate(None), rows)}

    def _reinstantiate(self) -> dict[str, Any]:
        rows = self._baseline()
        self._instantiate()
        with contextlib.suppress(Refused):
            self._simulate(self.other)
        self._instantiate()
        return {"honoured": self._same(self._simulate(None), rows)}

    def _apart(self) -> dict[str, Any]:
        rows = self._baseline()
        self._instantiate()
        one, self.component = self.component, None
        try:
            self._instantiate()
        except Refused:
            return {"second": False}
        two = self.component
        self.component = one
        self._begin(None)
        self.component = two
        self._begin(self.other)
        found = [self._read(one)]
        for k in range(len(rows) - 1):
            self._step(two, k, self.h)
            self._step(one, k, self.h)
            found.append(self._read(one))
        return {"second": True, "honoured": self._same(found, rows)}

    def _parameters(self) -> dict[str, Any]:
        rows = self._baseline()
        answers = []
        began = time.perf_counter()
        for j, value in enumerate(self.other):
            if time.perf_counter() - began > self.patience:
                break
            if value == self.values[j]:
                answers.append("not tried")
                continue
            try:
                self._instantiate()
                self._initialise([self.references[0][j]], [value])
                kept = self._get(self.component, [self.references[0][j]])[0]
                changed = not self._same(self._follow(len(rows) - 1, self.h), rows)
            except Refused:
                answers.append("refused")
                continue
            same = abs(kept - value) <= 1e-12 * abs(value)
            answers.append("taken" if changed else "no effect" if same else "ignored")
        return {"answers": answers}

    def _step_size(self) -> dict[str, Any]:
        rows = self._baseline()
        steps = len(rows) - 1
        self._instantiate()
        self._begin(None)
        fine = [self._read(self.component)]
        began = time.perf_counter()
        for k in range(10 * steps):
            try:
                self._step(self.component, k, self.h / 10)
            except Refused as error:
                return {"refused": str(error)}
            fine.append(self._read(self.component))
            if time.perf_counter() - began > self.patience:
                break
        moves = any(not self._same([row], rows[:1]) for row in rows)
        if moves and fine[: steps + 1] == rows[: len(fine)]:
            return {"ignored": True}
        worst = 0.0
        common = range(len(fine[::10]))
        for j in range(len(rows[0])):
            column = [rows[k][j] for k in common]
            span = max(column) - min(column)
            if span > 0 and j not in self.volatile:
                worst = max(worst, max(abs(rows[k][j] - fine[10 * k][j]) for k in common) / span)
        return {"change": worst if math.isfinite(worst) else None, "moves": moves}

    # How they are made

    def _baseline(self) -> Rows:
        if self.first is None:
            self._instantiate()
            self.first = self._simulate(None)
        return self.first

    def _same(self, rows: Rows, others: Rows) -> bool:
        """Whether two runs read the same, but for what differs in every run; what is no number in both is the same."""
        kept = [j for j in range(len(others[0])) if j not in self.volatile]
        return len(rows) == len(others) and all(
            r[j] == o[j] or (math.isnan(r[j]) and math.isnan(o[j]))
            for r, o in zip(rows, others, strict=True)
            for j in kept
        )

    def _disturb(self) -> None:
        """Run with other parameters, so that there is something to forget."""
        self._check("reset", self.call["reset"](self.component))
        with contextlib.suppress(Refused):
            self._simulate(self.other)

    def _simulate(self, values: Sequence[float] | None) -> Rows:
        self._begin(values)
        wanted = self.steps if self.steps is not None else max(1, round(self.horizon / self.h))
        rows = self._follow(wanted, self.h)
        self.steps = len(rows) - 1
        return rows

    def _follow(self, steps: int, h: float) -> Rows:
        self._check("setReal", self._set(self.references[1], self.inputs))
        rows = [self._read(self.component)]
        began = time.perf_counter()
        for k in range(steps):
            try:
                self._step(self.component, k, h)
            except Refused as refusal:
                if self.first is not None or k < LEAST_STEPS:
                    raise
                self.stopped = str(refusal)
                break
            rows.append(self._read(self.component))
            if self.first is None and time.perf_counter() - began > self.patience:
                break
        return rows

    def _begin(self, values: Sequence[float] | None) -> None:
        self._initialise(self.references[0] if values is not None else (), values or ())
        self._check("setReal", self._set(self.references[1], self.inputs))

    def _initialise(self, references: Sequence[int], values: Sequence[float]) -> None:
        """Initialise in the stepping loop's order: some FMUs forget what is set before the experiment is set up."""
        component = self.component
        stop = self.start + self.horizon + self.h
        self._check("setupExperiment", self.call["setup_experiment"](component, 0, 0.0, self.start, 1, stop))
        self._check("setReal", self._set(references, values))
        self._check("enterInitializationMode", self.call["enter_initialization"](component))
        self._check("exitInitializationMode", self.call["exit_initialization"](component))

    def _instantiate(self) -> None:
        fmu = self.loaded.fmu
        if self.component:
            self.call["free_instance"](self.component)
            self.component = None
        asked = fmu.instance_name, 1, fmu.guid, fmu.resources, fmu.callbacks, 0
        self.component = self.call["instantiate"](*asked, 0)
        if not self.component:
            if not self._words() and (other := self.call["instantiate"](*asked, 1)):  # with logging: some say why then
                self.call["free_instance"](other)
            raise Refused(f"instantiate gave no instance{self._words()}")

    def _step(self, component: int | None, k: int, h: float) -> None:
        at = self.start + k * h
        status = self.call["do_step"](component, at, h, 1)
        if status > 1:
            raise Refused(f"doStep returned {status_name(status)} at t = {at:g} s{self._words()}")

    def _set(self, references: Sequence[int], values: Sequence[float]) -> int:
        n = len(references)
        if n == 0:
            return 0
        return int(self.call["set_real"](self.component, (c_uint32 * n)(*references), n, (c_double * n)(*values)))

    def _read(self, component: int | None) -> list[float]:
        return self._get(component, self.references[2])

    def _get(self, component: int | None, references: Sequence[int]) -> list[float]:
        n = len(references)
        values = (c_double * max(1, n))()
        if n:
            status = self.call["get_real"](component, (c_uint32 * n)(*references), n, values)
            self._check("getReal", status)
        return list(values)[:n]

    def _check(self, what: str, status: int) -> None:
        if status > 1:
            raise Refused(f"{what} returned {status_name(status)}{self._words()}")

    def _words(self) -> str:
        words = self.loaded.log.last.decode("utf-8", "replace").strip()
        return f": {words}" if words else ""


assert ctypes.sizeof(c_size_t) == 8, "the probe needs a 64-bit platform"

"""The probe's stages, seen from their owner: their process, their time limit, what they need. Draws no conclusion.

``probing.py`` is the other side: what a stage does, in its process.
"""

from __future__ import annotations

import contextlib
import dataclasses
import math
import queue
import time
from collections.abc import Sequence
from typing import Any

from estimator.fmus.archive import extract
from estimator.fmus.fmu import FmuDescription
from estimator.fmus.mailbox import Mailbox
from estimator.fmus.process import Process, how_it_ended
from estimator.fmus.run_folder import RunFolder
from estimator.fmus.variable import Variable
from estimator.stepping.layout import JobLayout, types_of

HORIZON = 1.0  # s simulated where the FMU states no stop time
PATIENCE = 3.0  # s of a run, then it is cut
STAGE_LIMIT = 8.0  # s of a stage, then its process is ended
START_LIMIT = 60.0  # s until a process of ours speaks
MAX_VARIABLES = 40
USUAL_STEPS, MOST_STEPS = 1000, 100_000  # of a run


class Stopped(Exception):
    """A stage that gave no answer: the reason."""


class Stages:
    """The process in which the stages run, started again after each that ends it."""

    def __init__(self, description: FmuDescription, folder: RunFolder, *, until: float) -> None:
        self.until, self.folder = until, folder
        extracted = folder.path / "fmu"
        extracted.mkdir()
        extract(description.path, extracted)
        self.order = order_of(description, str(extracted))
        self.process: Process | None = None
        self.messages: Mailbox[Process] = Mailbox()
        self.generation = 0

    def __enter__(self) -> Stages:
        return self

    def __exit__(self, *_: object) -> None:
        self.end()

    def end(self) -> None:
        """End the process, so that the next stage begins in a fresh one."""
        if self.process is not None:
            self.process.end(politely=False)
            self.process = None

    def stage(self, name: str, *, limit: float | None = None) -> dict[str, Any]:
        """Run a stage and return what it found; {"refused": why} if the FMU answered that it cannot."""
        left = min(limit or STAGE_LIMIT, self.until - time.monotonic())
        if left <= 0:
            raise Stopped("there was no time left to try it")
        if self.process is None:
            self.generation += 1
            self.process = Process(0, self.generation, self.folder.path, self.messages)
            self._wait_until_started(self.process)
            self.process.send({"prepare": self.order})
        assert self.process is not None
        self.process.send({"probe": name})
        deadline = time.monotonic() + left
        while True:
            try:
                sender, message = self.messages.get(timeout=max(0.0, deadline - time.monotonic()))
            except queue.Empty:
                self.end()
                raise Stopped(f"it does not come back within {left:.0f} s") from None
            if sender is not self.process:
                continue
            if message is None:
                code = sender.reap()
                self.process = None
                raise Stopped(how_it_ended(code).replace("the FMU", "it"))
            if "error" in message:
                self.end()
                raise Stopped(str(message["error"]))
            if "stage" in message:
                return dict(message["stage"])

    def _wait_until_started(self, process: Process) -> None:
        """Wait for a process's first word: what an interpreter takes to start is not the FMU's time."""
        began = time.monotonic()
        with contextlib.suppress(queue.Empty):
            while time.monotonic() - began < START_LIMIT:
                sender, message = self.messages.get(timeout=START_LIMIT)
                if sender is process:
                    if message is None:
                        self.messages.put(sender, message)
                    break
        self.until += time.monotonic() - began


def order_of(description: FmuDescription, folder: str) -> dict[str, Any]:
    """Return what the stages need: variables, values, inputs, step."""
    parameters = [v for v in description.of_causality("parameter") if v.is_real and isinstance(v.start, float)]
    parameters = parameters[:MAX_VARIABLES]
    inputs = [v for v in description.of_causality("input") if v.is_real][:MAX_VARIABLES]
    shown = [v for v in description.of_causality("output") if v.is_real]
    shown = (shown or [v for v in description.of_causality("local") if v.is_real])[:MAX_VARIABLES]
    layout = JobLayout(
        folder=folder,
        identifier=description.library or "",
        guid=description.guid,
        reinstantiate=False,
        parameter_references=tuple(v.value_reference for v in parameters),
        input_references=tuple(v.value_reference for v in inputs),
        output_references=tuple(v.value_reference for v in shown),
        sensors=(0,) * len(shown),
        experiments=(),
        version=description.fmi_version,
        kind=description.kind,
        types=types_of([v.type for v in (*parameters, *inputs, *shown)]),
        counts=description.counts,
    )
    start, h, horizon = _clock(description)
    return {
        "job": dataclasses.asdict(layout),
        "names": [v.name for v in parameters],
        "shown": [v.name for v in shown],
        "values": [_start(v) for v in parameters],
        "other": [_other(v) for v in parameters],
        "inputs": _drive(inputs),
        "start": start,
        "h": h,
        "horizon": horizon,
        "patience": PATIENCE,
    }


def _clock(description: FmuDescription) -> tuple[float, float, float]:
    """Return start, step and length of a run, s: as the FMU states them, with no more steps than can be waited for."""
    stated = description.default_experiment
    start, stop, h = stated["start_time"] or 0.0, stated["stop_time"], stated["step_size"]
    length = stop - start if stop is not None and stop > start else HORIZON
    if h is None or not 0 < h <= length:
        h = length / USUAL_STEPS
    return start, h, min(length, MOST_STEPS * h)


def _start(variable: Variable) -> float:
    return variable.start if isinstance(variable.start, float) else 0.0


def _other(variable: Variable) -> float:
    """Return another value than the start, 10 % off, within the limits."""
    start = _start(variable)
    for value in (1.1 * start, start / 1.1):
        low = variable.minimum is None or value >= variable.minimum
        high = variable.maximum is None or value <= variable.maximum
        if start != 0 and low and high and math.isfinite(value):
            return value
    return start


def _drive(inputs: Sequence[Variable]) -> list[float]:
    """Return what the inputs are held at: 10 V, or the nominal value, where it is a voltage or the only input."""
    values = []
    for variable in inputs:
        value = _start(variable)
        if value == 0 and (variable.unit == "V" or len(inputs) == 1):
            value = variable.nominal or (10.0 if variable.unit == "V" else 1.0)
            value = value if variable.maximum is None else min(value, variable.maximum)
        values.append(value)
    return values

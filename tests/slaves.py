"""Instances of an FMU, with variables by name: fmpy loads, calls and raises. Knows nothing of the estimator."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Self

import fmpy
import numpy as np
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Slave, fmi2CallbackFunctions, fmi2CallbackLoggerTYPE
from numpy.typing import NDArray

OK, DISCARD, ERROR = 0, 2, 3


class Slave:
    """One instance of an extracted co-simulation FMU, with variables by name."""

    def __init__(self, folder: str, *, guid: str | None = None, logs: list[tuple[int, str, str]] | None = None) -> None:
        self.description = fmpy.read_model_description(folder, validate=False)
        self.references = {v.name: v.valueReference for v in self.description.modelVariables}
        self.fmi = FMU2Slave(
            guid=guid or self.description.guid,
            unzipDirectory=folder,
            modelIdentifier=self.description.coSimulation.modelIdentifier,
            instanceName="motor",
        )
        self._callbacks = fmi2CallbackFunctions()
        if logs is not None:

            def log(_environment, _name, status, category, message) -> None:  # type: ignore[no-untyped-def]
                logs.append((status, category.decode(), message.decode()))

            self._callbacks.logger = fmi2CallbackLoggerTYPE(log)
        self.fmi.instantiate(callbacks=self._callbacks, loggingOn=logs is not None)

    def set(self, **values: float) -> None:
        self.fmi.setReal([self.references[name] for name in values], list(values.values()))

    def get(self, *names: str) -> list[float]:
        return list(self.fmi.getReal([self.references[name] for name in names]))

    def start(self, *, stop: float | None = None, time: float = 0.0, **values: float) -> None:
        """Set up, set values, initialise."""
        self.fmi.setupExperiment(startTime=time, stopTime=stop)
        self.set(**values)
        self.fmi.enterInitializationMode()
        self.fmi.exitInitializationMode()

    def step(self, time: float, step: float) -> None:
        self.fmi.doStep(currentCommunicationPoint=time, communicationStepSize=step)

    def run(
        self, inputs: dict[str, Sequence[float]], outputs: Sequence[str], *, step: float, start: float = 0.0
    ) -> NDArray[np.float64]:
        """Hold the k-th inputs over the k-th step; return the outputs after each step, [steps, outputs]."""
        rows = []
        for k, held in enumerate(zip(*inputs.values(), strict=True)):
            self.set(**dict(zip(inputs, held, strict=True)))
            self.step(start + k * step, step)
            rows.append(self.get(*outputs))
        return np.array(rows)


def status(call, *arguments, **keywords) -> int:  # type: ignore[no-untyped-def]
    """Return the FMI status with which a call fails; OK if it does not."""
    try:
        call(*arguments, **keywords)
    except FMICallException as error:
        return error.status
    return OK


class Opened:
    """An extracted FMU and its instances, which are freed together."""

    def __init__(self, fmu: Path) -> None:
        self.folder = fmpy.extract(str(fmu))
        self._slaves: list[Slave] = []

    def slave(self, **keywords) -> Slave:  # type: ignore[no-untyped-def]
        slave = Slave(self.folder, **keywords)
        self._slaves.append(slave)
        return slave

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, value: object, traceback: TracebackType | None) -> None:
        for slave in self._slaves:
            slave.fmi.fmi2FreeInstance(slave.fmi.component)
        shutil.rmtree(self.folder, ignore_errors=True)

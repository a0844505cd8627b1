"""Instances of an FMU, with variables by name: fmpy loads, calls and raises. Knows nothing of the estimator."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import fmpy
import numpy as np
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Slave, fmi2CallbackFunctions, fmi2CallbackLoggerTYPE
from fmpy.fmi3 import FMU3Slave, fmi3LogMessageCallback
from numpy.typing import NDArray

OK, DISCARD, ERROR = 0, 2, 3


class FmuInstance:
    """One instance of an extracted co-simulation FMU of FMI 2.0, with variables by name."""

    def __init__(self, folder: str, *, guid: str | None = None, logs: list[tuple[int, str, str]] | None = None) -> None:
        self.description = fmpy.read_model_description(folder, validate=False)
        self.references = {v.name: v.valueReference for v in self.description.modelVariables}
        self._logs = logs
        self.fmi = self._instantiated(
            guid=guid or self.description.guid,
            unzipDirectory=folder,
            modelIdentifier=self.description.coSimulation.modelIdentifier,
            instanceName="motor",
        )

    def _instantiated(self, **about: str) -> Any:
        self._callbacks = fmi2CallbackFunctions()
        if self._logs is not None:
            self._callbacks.logger = fmi2CallbackLoggerTYPE(
                lambda _environment, _name, status, category, message: self._log(status, category, message)
            )
        fmi = FMU2Slave(**about)
        fmi.instantiate(callbacks=self._callbacks, loggingOn=self._logs is not None)
        return fmi

    def _log(self, status: int, category: bytes, message: bytes) -> None:
        if self._logs is not None:
            self._logs.append((status, category.decode(), message.decode()))

    def set(self, **values: float) -> None:
        self.fmi.setReal([self.references[name] for name in values], list(values.values()))

    def get(self, *names: str) -> list[float]:
        return list(self.fmi.getReal([self.references[name] for name in names]))

    def enter(self, *, time: float = 0.0, stop: float | None = None) -> None:
        """Enter initialisation."""
        self.fmi.setupExperiment(startTime=time, stopTime=stop)
        self.fmi.enterInitializationMode()

    def start(self, *, stop: float | None = None, time: float = 0.0, **values: float) -> None:
        """Set values and initialise."""
        self.set(**values)
        self.enter(time=time, stop=stop)
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

    def restored(self, serialised: bytes) -> Any:
        """Return the state that was serialised."""
        return self.fmi.deSerializeFMUstate(serialised)

    def free(self) -> None:
        self.fmi.fmi2FreeInstance(self.fmi.component)


class FmuInstance3(FmuInstance):
    """One instance of an extracted co-simulation FMU of FMI 3.0, with variables by name."""

    def _instantiated(self, **about: str) -> Any:
        self._callback = fmi3LogMessageCallback(
            lambda _environment, status, category, message: self._log(status, category, message)
        )
        fmi = FMU3Slave(**about)
        fmi.instantiate(loggingOn=self._logs is not None, logMessage=self._callback)
        return fmi

    def set(self, **values: float) -> None:
        self.fmi.setFloat64([self.references[name] for name in values], list(values.values()))

    def get(self, *names: str) -> list[float]:
        return list(self.fmi.getFloat64([self.references[name] for name in names]))

    def enter(self, *, time: float = 0.0, stop: float | None = None) -> None:
        self.fmi.enterInitializationMode(startTime=time, stopTime=stop)

    def restored(self, serialised: bytes) -> Any:
        return self.fmi.deserializeFMUState(serialised)

    def free(self) -> None:
        self.fmi.fmi3FreeInstance(self.fmi.component)


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
        self._kind = (
            FmuInstance3 if fmpy.read_model_description(self.folder).fmiVersion.startswith("3") else FmuInstance
        )
        self._instances: list[FmuInstance] = []

    def instance(self, **keywords) -> FmuInstance:  # type: ignore[no-untyped-def]
        instance = self._kind(self.folder, **keywords)
        self._instances.append(instance)
        return instance

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, value: object, traceback: TracebackType | None) -> None:
        for instance in self._instances:
            instance.free()
        shutil.rmtree(self.folder, ignore_errors=True)

"""FMUs driven by fmpy's methods alone: any version, co-simulation or model exchange. Slow; knows no candidates.

The reference of the stepping loop, and the way of what the loop does not know: variables that are no real numbers of
double precision. Variables go by their position in `variables`. Lives in a worker process.
"""

from __future__ import annotations

import contextlib
import ctypes
from collections.abc import Sequence
from ctypes import CFUNCTYPE, POINTER, c_char_p, c_double, c_int, c_size_t, c_uint32, c_void_p
from typing import Any

from estimator.stepping.fmu_library import MODEL_EXCHANGE, FmuLibrary
from estimator.stepping.loading import why_not_loaded
from estimator.stepping.model_exchange import ModelExchange

FMI1_TYPES = {"Enumeration": "Integer"}
FMI3_TYPES = {"Enumeration": "Int64"}


class SlowFmu:
    """One FMU, its library loaded (and never unloaded), and at most one instance.

    Parameters
    ----------
    version : "1.0", "2.0" or "3.0"
    kind : "co-simulation" or "model-exchange"
    variables : of each variable, its type and value reference
    callbacks : FMI 2.0 callbacks, kept by the caller
    logger : native logger for FMI 1.0
    counts : continuous states and event indicators, for model exchange
    """

    def __init__(
        self,
        *,
        folder: str,
        identifier: str,
        guid: str,
        version: str,
        kind: str,
        variables: Sequence[tuple[str, int]],
        callbacks: Any = None,
        logger: Any = None,
        counts: tuple[int, int] = (0, 0),
    ) -> None:
        self.version, self.is_model, self.variables = version[0], kind == MODEL_EXCHANGE, tuple(variables)
        self.callbacks, self.logger = callbacks, logger
        names = {"guid": guid, "modelIdentifier": identifier, "unzipDirectory": folder, "instanceName": identifier}
        try:
            self.fmu = fmu_class(version, kind)(**names)
        except Exception as error:
            raise RuntimeError(why_not_loaded(str(error), folder)) from error
        self.fmu.component = None
        self.words = ""
        self.start = 0.0
        self.stop: float | None = None
        self.exchange = ModelExchange(self.fmu, version=self.version, counts=counts) if self.is_model else None
        self.begun = False  # it is initialised

    # The life of an instance

    def instantiate(self) -> None:
        """Make an instance, in place of the one there is."""
        self.free()
        if self.version == "1":
            self.fmu.instantiate(functions=fmi1_callbacks(self.logger))
            if not self.fmu.component:
                raise RuntimeError("it gives no instance")
        elif self.version == "2":
            from fmpy.fmi2 import fmi2CallbackFunctions

            self.fmu.instantiate(callbacks=fmi2CallbackFunctions.from_buffer(self.callbacks))
        else:
            self.fmu.instantiate(logMessage=self._log)

    def free(self) -> None:
        """Free the instance, if there is one."""
        if not self.fmu.component:
            return
        self.begun = False
        name = {"1": "fmi1FreeModelInstance" if self.is_model else "fmi1FreeSlaveInstance"}.get(
            self.version, f"fmi{self.version}FreeInstance"
        )
        getattr(self.fmu, name)(self.fmu.component)
        self.fmu.component = None

    def reset(self) -> None:
        """Bring the instance back to how it began; FMI 1.0 for model exchange has no such function."""
        if self.version == "1" and self.is_model:
            self.instantiate()
        else:
            self.begun = False
            self.fmu.reset()

    def enter(self) -> None:
        """Begin the initialisation at `start`; FMI 1.0 for co-simulation does all of it at the end."""
        if self.version == "1":
            if self.is_model:
                self.fmu.setTime(self.start)
        elif self.version == "2":
            self.fmu.setupExperiment(startTime=self.start, stopTime=self.stop)
            self.fmu.enterInitializationMode()
        else:
            self.fmu.enterInitializationMode(startTime=self.start, stopTime=self.stop)

    def exit(self) -> None:
        """End the initialisation."""
        if self.version != "1":
            self.fmu.exitInitializationMode()
        elif not self.is_model:
            self.fmu.initialize(tStart=self.start, stopTime=self.stop)
        if self.exchange is not None:
            self.exchange.begin(self.start, self.fmu.initialize() if self.version == "1" else None)
        self.begun = True

    def step(self, time: float, h: float) -> None:
        """Step from `time` over `h` with the inputs held."""
        if self.exchange is not None:
            self.exchange.step(time, time + h)
        elif self.version == "3":
            self.fmu.doStep(time, h)
        else:
            self.fmu.doStep(currentCommunicationPoint=time, communicationStepSize=h)

    # Values

    def set(self, indices: Sequence[int], values: Sequence[float]) -> None:
        """Set variables by position; those that are no reals are rounded."""
        if self.begun and self.exchange is not None:
            self.exchange.jump()
        for kind, positions in self._by_type(indices).items():
            references = [self.variables[indices[p]][1] for p in positions]
            self.set_typed(kind, references, [values[p] for p in positions])

    def set_typed(self, kind: str, references: Sequence[int], values: Sequence[Any]) -> None:
        """Set variables of one type by value reference."""
        name = self._function_type(kind)
        if name == "String":
            converted = list(values)
        elif name == "Boolean":
            converted = [bool(v) for v in values]
        elif name in ("Real", "Float64", "Float32"):
            converted = [float(v) for v in values]
        else:
            converted = [round(v) for v in values]
        getattr(self.fmu, f"set{name}")(list(references), converted)

    def get(self, indices: Sequence[int]) -> list[float]:
        """Read variables by position."""
        read = [0.0] * len(indices)
        for kind, positions in self._by_type(indices).items():
            references = [self.variables[indices[p]][1] for p in positions]
            found = getattr(self.fmu, f"get{self._function_type(kind)}")(references)
            for p, value in zip(positions, found, strict=True):
                read[p] = float(value)
        return read

    def _by_type(self, indices: Sequence[int]) -> dict[str, list[int]]:
        found: dict[str, list[int]] = {}
        for position, index in enumerate(indices):
            found.setdefault(self.variables[index][0], []).append(position)
        return found

    def _function_type(self, kind: str) -> str:
        if self.version == "3":
            return FMI3_TYPES.get(kind, "Float64" if kind == "Real" else kind)
        return FMI1_TYPES.get(kind, kind)

    def _log(self, _environment: Any, status: int, _category: bytes, message: bytes) -> None:
        if status >= 2:
            self.words = message.decode("utf-8", "replace")[:400]


def fmi1_callbacks(logger: Any) -> Any:
    """Return FMI 1.0 callbacks that never enter Python: a native logger, the C library's memory functions."""
    from fmpy import calloc, free
    from fmpy.fmi1 import (
        fmi1CallbackAllocateMemoryTYPE,
        fmi1CallbackFreeMemoryTYPE,
        fmi1CallbackFunctions,
        fmi1CallbackLoggerTYPE,
    )

    functions = fmi1CallbackFunctions()
    functions.logger = ctypes.cast(logger, fmi1CallbackLoggerTYPE)
    functions.allocateMemory = ctypes.cast(calloc, fmi1CallbackAllocateMemoryTYPE)
    functions.freeMemory = ctypes.cast(free, fmi1CallbackFreeMemoryTYPE)
    return functions


def fmu_class(version: str, kind: str) -> Any:
    """Return fmpy's class for a version and a kind."""
    from importlib import import_module

    number = version[0]
    base = getattr(import_module(f"fmpy.fmi{number}"), f"FMU{number}{'Model' if kind == MODEL_EXCHANGE else 'Slave'}")

    class Lenient(base):  # type: ignore[misc, valid-type]
        """An FMU that may lack what is never called; fmpy itself wants every function of the standard."""

        def _loadFunctions(self) -> None:  # noqa: N802 - fmpy's name
            library: Any = self.dll
            self.dll: Any = FmuLibrary(library, number, kind)
            super()._loadFunctions()

    Lenient.__name__ = base.__name__
    return Lenient


class Callbacks:
    """A ForeignFmu in the shape of the FMI 2.0 functions that ``stepper.c`` calls.

    An exception becomes a status; its words go where `tell` puts them.
    """

    def __init__(self, fmu: SlowFmu, tell: Any) -> None:
        self.fmu, self.tell = fmu, tell
        references, reals = POINTER(c_uint32), POINTER(c_double)
        self.functions = {
            "instantiate": CFUNCTYPE(c_void_p, c_char_p, c_int, c_char_p, c_char_p, c_void_p, c_int, c_int)(
                self._instantiate
            ),
            "free_instance": CFUNCTYPE(None, c_void_p)(self._free),
            "reset": CFUNCTYPE(c_int, c_void_p)(lambda _: self._status(fmu.reset)),
            "setup_experiment": CFUNCTYPE(c_int, c_void_p, c_int, c_double, c_double, c_int, c_double)(self._setup),
            "enter_initialization": CFUNCTYPE(c_int, c_void_p)(lambda _: self._status(fmu.enter)),
            "exit_initialization": CFUNCTYPE(c_int, c_void_p)(lambda _: self._status(fmu.exit)),
            "set_real": CFUNCTYPE(c_int, c_void_p, references, c_size_t, reals)(self._set),
            "get_real": CFUNCTYPE(c_int, c_void_p, references, c_size_t, reals)(self._get),
            "do_step": CFUNCTYPE(c_int, c_void_p, c_double, c_double, c_int)(
                lambda _, time, h, __: self._status(fmu.step, time, h)
            ),
            "set_other": CFUNCTYPE(c_int, c_void_p, c_void_p)(self._set_other),
        }
        self.settings: Sequence[tuple[str, int, Any]] = ()  # type, value reference, value
        self.first_setting, self.setting_size = 0, 1  # their address and size

    def _status(self, function: Any, *arguments: Any) -> int:
        self.fmu.words = ""
        try:
            function(*arguments)
        except Exception as error:
            self.tell(self.fmu.words or str(error))
            status = getattr(error, "status", 3)
            return int(status) if isinstance(status, int) else 3
        return 0

    def _instantiate(self, *_: Any) -> int | None:
        return 1 if self._status(self.fmu.instantiate) == 0 else None

    def _free(self, _: Any) -> None:
        with contextlib.suppress(Exception):
            self.fmu.free()

    def _setup(self, _: Any, __: int, ___: float, start: float, stops: int, stop: float) -> int:
        self.fmu.start, self.fmu.stop = start, stop if stops else None
        return 0

    def _set(self, _: Any, indices: Any, count: int, values: Any) -> int:
        return self._status(self.fmu.set, indices[:count], values[:count])

    def _get(self, _: Any, indices: Any, count: int, values: Any) -> int:
        def read() -> None:
            for k, value in enumerate(self.fmu.get(indices[:count])):
                values[k] = value

        return self._status(read)

    def _set_other(self, _: Any, setting: int) -> int:
        kind, reference, value = self.settings[(setting - self.first_setting) // self.setting_size]
        return self._status(self.fmu.set_typed, kind, [reference], [value])

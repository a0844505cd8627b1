"""An FMU, loaded: fmpy loads and instantiates, ``stepper.c`` steps. Lives in a worker process; knows no search.

With ``fmu.py`` and ``foreign.py`` the only module that knows FMI and fmpy. Co-simulation of FMI 2.0 and 3.0 runs at
full speed; everything else runs through ``foreign.py``, in the same loop. The ctypes structures mirror those of
``stepper.c``, field by field; that file says what they mean.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Sequence
from ctypes import POINTER, c_char, c_char_p, c_double, c_int64, c_uint32, c_uint64, c_void_p
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from estimator.foreign import REAL_TYPES, Callbacks, ForeignFmu
from estimator.sensors import Sensor

FINISHED, CUT_SHORT, FAILED, NOT_FINITE = range(4)  # as in stepper.c
CRASHED, TIMED_OUT, PENDING = 4, 5, 6  # found by the worker's owner, not by the stepper
PHASES = ("", "instantiate", "reset", "set", "set up", "initialise", "doStep", "read")
FMI_STATUS = ("OK", "Warning", "Discard", "Error", "Fatal", "Pending")
IDENTITY, MEAN = range(2)  # sensors, as in sensors.h
MAX_AVERAGE, MAX_SECTIONS = 64, 16  # as in sensors.h
# Types of settings, as in fmi3_adapter.h.
SETTING_TYPES = {"Integer": 0, "Boolean": 1, "String": 2, "Float32": 3, "Int8": 4, "UInt8": 5, "Int16": 6, "UInt16": 7}
SETTING_TYPES |= {"Int32": 8, "UInt32": 9, "Int64": 10, "UInt64": 11}


class Log(ctypes.Structure):
    """The FMU's words."""

    _fields_ = [("messages", c_int64), ("last", c_char * 512)]


class SlaveStruct(ctypes.Structure):
    """The FMU's instance and functions."""

    _fields_ = [
        ("reinstantiate", c_int64),
        ("component", c_void_p),
        ("instantiate", c_void_p),
        ("free_instance", c_void_p),
        ("reset", c_void_p),
        ("setup_experiment", c_void_p),
        ("enter_initialization", c_void_p),
        ("exit_initialization", c_void_p),
        ("set_real", c_void_p),
        ("get_real", c_void_p),
        ("do_step", c_void_p),
        ("instance_name", c_char_p),
        ("guid", c_char_p),
        ("resources", c_char_p),
        ("callbacks", c_void_p),
        ("restore_every_step", c_int64),
        ("set_integer", c_void_p),
        ("set_boolean", c_void_p),
        ("set_string", c_void_p),
        ("set_other", c_void_p),
    ]


class SettingStruct(ctypes.Structure):
    """A value that is no real number, set before every initialisation."""

    _fields_ = [
        ("type", c_int64),
        ("reference", c_int64),
        ("whole", c_int64),
        ("real", c_double),
        ("text", c_char_p),
    ]


class Fmi3Struct(ctypes.Structure):
    """The functions of an FMU of FMI 3.0."""

    _fields_ = [
        ("instantiate", c_void_p),
        ("free_instance", c_void_p),
        ("reset", c_void_p),
        ("enter_initialization", c_void_p),
        ("exit_initialization", c_void_p),
        ("set_float64", c_void_p),
        ("get_float64", c_void_p),
        ("do_step", c_void_p),
        ("set_other", c_void_p * len(SETTING_TYPES)),
        ("log", c_void_p),
        ("log_message", c_void_p),
    ]


class ChainStruct(ctypes.Structure):
    """What stands between one output and what its sensor shows."""

    _fields_ = [("average", c_int64), ("sections", c_int64), ("section", c_double * 5 * MAX_SECTIONS)]


class ExperimentStruct(ctypes.Structure):
    """One recording as the stepper sees it."""

    _fields_ = [
        ("samples", c_int64),
        ("substeps", c_int64),
        ("start", c_double),
        ("interval", c_double),
        ("inputs", c_void_p),
        ("measured", c_void_p),
        ("weights", c_void_p),
        ("complete", c_int64),
        ("chains", c_void_p),
    ]


class JobStruct(ctypes.Structure):
    """What to set, read and compare."""

    _fields_ = [
        ("parameters", c_int64),
        ("inputs", c_int64),
        ("outputs", c_int64),
        ("experiments", c_int64),
        ("parameter_references", c_void_p),
        ("input_references", c_void_p),
        ("output_references", c_void_p),
        ("sensors", c_void_p),
        ("experiment", c_void_p),
        ("sensor_values", c_int64),
        ("even_steps", c_int64),
        ("settings", c_int64),
        ("setting", c_void_p),
        ("scale", c_void_p),
    ]


class BatchStruct(ctypes.Structure):
    """Candidates in shared memory."""

    _fields_ = [
        ("next", c_void_p),
        ("claim", c_void_p),
        ("candidates", c_int64),
        ("quota", c_int64),
        ("refine", c_int64),
        ("values", c_void_p),
        ("bounds", c_void_p),
        ("costs", c_void_p),
        ("steps", c_void_p),
        ("outcomes", c_void_p),
        ("shown", c_void_p),
    ]


@dataclass(frozen=True)
class ExperimentLayout:
    """One recording of a job; offsets are bytes into the job's memory."""

    samples: int
    substeps: int
    start: float  # s
    interval: float  # s
    inputs: int
    measured: int
    weights: int
    complete: bool
    chains: tuple[tuple[int, tuple[tuple[float, ...], ...]], ...] = ()  # of each output: average, filter sections


@dataclass(frozen=True)
class JobLayout:
    """A job as it travels to a worker: everything but the numbers, which stand in shared memory."""

    folder: str
    identifier: str
    guid: str
    reinstantiate: bool
    parameter_references: tuple[int, ...]
    input_references: tuple[int, ...]
    output_references: tuple[int, ...]
    sensors: tuple[int, ...]
    experiments: tuple[ExperimentLayout, ...]
    sensor_values: int = 0
    even_steps: bool = False
    version: str = "2.0"
    kind: str = "co-simulation"
    fresh_process: bool = False  # a process of its own for every simulation
    types: tuple[str, ...] = ()  # of parameters, inputs and outputs, one after the other; empty: all real
    settings: tuple[tuple[str, int, float | str], ...] = ()  # type, value reference, value
    scale: tuple[tuple[float, float], ...] = ()  # of each output: factor and offset from its unit to SI; empty: SI
    counts: tuple[int, int] = (0, 0)  # continuous states and event indicators, for model exchange

    @property
    def is_fast(self) -> bool:
        """Whether the stepping loop calls the FMU's own functions."""
        cosimulation = self.kind == "co-simulation" and self.version[0] in "23"
        return cosimulation and all(t in REAL_TYPES for t in self.types)


FMI2_FUNCTIONS = {
    "instantiate": "Instantiate",
    "free_instance": "FreeInstance",
    "reset": "Reset",
    "setup_experiment": "SetupExperiment",
    "enter_initialization": "EnterInitializationMode",
    "exit_initialization": "ExitInitializationMode",
    "set_real": "SetReal",
    "get_real": "GetReal",
    "do_step": "DoStep",
}
FMI2_SETTERS = {"set_integer": "SetInteger", "set_boolean": "SetBoolean", "set_string": "SetString"}
FMI3_FUNCTIONS = {
    "instantiate": "InstantiateCoSimulation",
    "free_instance": "FreeInstance",
    "reset": "Reset",
    "enter_initialization": "EnterInitializationMode",
    "exit_initialization": "ExitInitializationMode",
    "set_float64": "SetFloat64",
    "get_float64": "GetFloat64",
    "do_step": "DoStep",
}


def stepper_library() -> Path:
    """Return the path of the compiled stepping loop."""
    from estimator.fmu import platform_suffix

    return Path(__file__).with_name("stepper" + platform_suffix())


def stepper() -> ctypes.CDLL:
    """Return the stepping loop, loaded."""
    library = ctypes.CDLL(str(stepper_library()))
    pointers: list[Any] = [POINTER(SlaveStruct), POINTER(JobStruct), POINTER(BatchStruct)]
    library.stepper_run.restype = library.stepper_take.restype = library.stepper_run_one.restype = c_int64
    library.stepper_run.argtypes = pointers
    library.stepper_take.argtypes = pointers[2:]
    library.stepper_run_one.argtypes = [*pointers, c_int64, c_int64]
    library.stepper_close.restype = None
    library.stepper_close.argtypes = pointers[:1]
    return library


class LoadedFmu:
    """An FMU, its library loaded into this process (and never unloaded).

    Parameters
    ----------
    job : JobLayout
    memory : address of the job's numbers
    """

    def __init__(self, job: JobLayout, memory: int) -> None:
        self.log = Log()
        self.layout = job
        self.stepper = stepper()
        self.callbacks = native_callbacks(self.stepper, self.log)
        self._kept: list[Any] = []
        references = (*job.parameter_references, *job.input_references, *job.output_references)
        types = job.types or ("Real",) * len(references)
        self.foreign = ForeignFmu(
            folder=job.folder,
            identifier=job.identifier,
            guid=job.guid,
            version=job.version,
            kind=job.kind,
            variables=list(zip(types, references, strict=True)),
            callbacks=self.callbacks,
            logger=self.stepper.stepper_log1,
            counts=job.counts,
        )
        self.settings = self._settings(job)
        self.slave = self._slave(job)
        self.job = self._job(job, memory)

    def run(self, batch: BatchStruct) -> int:
        """Simulate candidates until none is left or the quota is reached; return how many this process did."""
        return int(self.stepper.stepper_run(self.slave, self.job, batch))

    def take(self, batch: BatchStruct) -> int:
        """Take the next candidate; -1: none is left."""
        return int(self.stepper.stepper_take(batch))

    def run_one(self, batch: BatchStruct, *, candidate: int, experiment: int) -> int:
        """Simulate one experiment of a candidate; return its outcome."""
        return int(self.stepper.stepper_run_one(self.slave, self.job, batch, candidate, experiment))

    def close(self) -> None:
        """Free the instance."""
        self.stepper.stepper_close(self.slave)
        self.foreign.free()

    def _settings(self, job: JobLayout) -> Any:
        rows = []
        for kind, reference, value in job.settings:
            name = "Integer" if kind == "Enumeration" and job.version[0] != "3" else kind
            name = "Int64" if name == "Enumeration" else name
            row = SettingStruct(type=SETTING_TYPES[name], reference=reference)
            if isinstance(value, str):
                row.text = value.encode()
            else:
                row.whole, row.real = round(value), value
            rows.append(row)
        settings = (SettingStruct * max(1, len(rows)))(*rows)
        self._kept.append(settings)
        return settings

    def _slave(self, job: JobLayout) -> SlaveStruct:
        resources = (Path(job.folder).resolve() / "resources").as_uri()
        slave = SlaveStruct(
            reinstantiate=int(job.reinstantiate),
            component=None,
            instance_name=job.identifier.encode(),
            guid=job.guid.encode(),
            resources=resources.encode(),
            callbacks=ctypes.addressof(self.callbacks),
        )
        if not job.is_fast:
            self._slow = Callbacks(self.foreign, self._tell)
            self._slow.settings = job.settings
            self._slow.first_setting = ctypes.addressof(self.settings)
            self._slow.setting_size = ctypes.sizeof(SettingStruct)
            for name, function in self._slow.functions.items():
                setattr(slave, name, _address(function))
            return slave
        dll = self.foreign.fmu.dll
        if job.version.startswith("3"):
            slave.resources = (str(Path(job.folder).resolve() / "resources") + "/").encode()
            self._fmi3 = self._fmi3_functions(dll)
            self.stepper.stepper_adapt(ctypes.byref(slave), ctypes.byref(self._fmi3))
            return slave
        for field, name in FMI2_FUNCTIONS.items():
            setattr(slave, field, _address(getattr(dll, f"fmi2{name}")))
        for field, name in FMI2_SETTERS.items():
            setattr(slave, field, _address(getattr(dll, f"fmi2{name}", None)))
        return slave

    def _fmi3_functions(self, dll: Any) -> Fmi3Struct:
        functions = Fmi3Struct(log=ctypes.addressof(self.log), log_message=_address(self.stepper.stepper_log3))
        for field, name in FMI3_FUNCTIONS.items():
            setattr(functions, field, _address(getattr(dll, f"fmi3{name}")))
        for name, k in SETTING_TYPES.items():
            functions.set_other[k] = _address(getattr(dll, f"fmi3Set{name}", None)) if k else None
        return functions

    def _tell(self, words: str) -> None:
        self.log.messages += 1
        self.log.last = " ".join(words.split()).encode()[:500]

    def _job(self, job: JobLayout, memory: int) -> JobStruct:
        experiments = (ExperimentStruct * len(job.experiments))(
            *(
                ExperimentStruct(
                    e.samples,
                    e.substeps,
                    e.start,
                    e.interval,
                    memory + e.inputs,
                    memory + e.measured,
                    memory + e.weights,
                    int(e.complete),
                    self._chains(e),
                )
                for e in job.experiments
            )
        )
        self._kept.append(experiments)
        parameters, inputs, outputs = job.parameter_references, job.input_references, job.output_references
        if not job.is_fast:  # variables go by their position
            parameters, inputs, outputs = positions(job)
        return JobStruct(
            parameters=len(job.parameter_references),
            inputs=len(job.input_references),
            outputs=len(job.output_references),
            experiments=len(job.experiments),
            parameter_references=self._array(c_uint32, parameters),
            input_references=self._array(c_uint32, inputs),
            output_references=self._array(c_uint32, outputs),
            sensors=self._array(c_int64, job.sensors),
            experiment=ctypes.addressof(experiments),
            sensor_values=job.sensor_values,
            even_steps=int(job.even_steps),
            settings=len(job.settings),
            setting=ctypes.addressof(self.settings),
            scale=self._array(c_double, [x for pair in job.scale for x in pair]) if job.scale else None,
        )

    def _chains(self, experiment: ExperimentLayout) -> int | None:
        if not experiment.chains:
            return None
        chains = (ChainStruct * len(experiment.chains))()
        for chain, (average, sections) in zip(chains, experiment.chains, strict=True):
            chain.average, chain.sections = average, len(sections)
            for s, section in enumerate(sections):
                for c, coefficient in enumerate(section):
                    chain.section[s][c] = coefficient
        self._kept.append(chains)
        return ctypes.addressof(chains)

    def _array(self, kind: type[Any], values: Sequence[float]) -> int:
        array = (kind * max(1, len(values)))(*values)
        self._kept.append(array)
        return ctypes.addressof(array)


def positions(job: JobLayout) -> tuple[tuple[int, ...], tuple[int, ...], tuple[int, ...]]:
    """Return the positions of a job's parameters, inputs and outputs among its variables."""
    p, q = len(job.parameter_references), len(job.parameter_references) + len(job.input_references)
    return tuple(range(p)), tuple(range(p, q)), tuple(range(q, q + len(job.output_references)))


def native_callbacks(stepper: ctypes.CDLL, log: Log) -> Any:
    """Return FMI 2 callbacks that never enter Python: the stepper's logger, the C library's memory functions."""
    from fmpy import calloc, free
    from fmpy.fmi2 import (
        fmi2CallbackAllocateMemoryTYPE,
        fmi2CallbackFreeMemoryTYPE,
        fmi2CallbackFunctions,
        fmi2CallbackLoggerTYPE,
    )

    callbacks = fmi2CallbackFunctions()
    callbacks.logger = ctypes.cast(stepper.stepper_log, fmi2CallbackLoggerTYPE)
    callbacks.allocateMemory = ctypes.cast(calloc, fmi2CallbackAllocateMemoryTYPE)
    callbacks.freeMemory = ctypes.cast(free, fmi2CallbackFreeMemoryTYPE)
    callbacks.componentEnvironment = ctypes.addressof(log)
    return callbacks


def reference_trajectories(
    loaded: LoadedFmu,
    *,
    values: Sequence[float],
    experiment: int,
    inputs: Sequence[Sequence[float]],
    refine: int = 1,
) -> list[list[float]]:
    """Simulate one candidate over one recording by fmpy's methods alone: the reference of the stepping loop.

    Parameters
    ----------
    values : (p,) the FMU's parameters, in its units, then the sensors' values
    experiment : index of the recording
    inputs : (n, inputs)
    refine : communication steps are this many times finer

    Returns
    -------
    (n, outputs) what the sensors show; sample 0 is before the first step
    """
    layout = loaded.layout
    recording = layout.experiments[experiment]
    fmu = loaded.foreign
    fmu.start = recording.start
    if not fmu.fmu.component:
        fmu.instantiate()
    else:
        fmu.reset()
    parameters, driven, outputs = positions(layout)
    fmu.set(parameters, list(values)[: len(parameters)])
    for kind, reference, value in layout.settings:
        fmu.set_typed(kind, [reference], [value])
    delay, sensors = _sensors(layout, recording, list(values)[len(parameters) :])
    fmu.enter()
    fmu.exit()
    scale = layout.scale or ((1.0, 0.0),) * len(outputs)
    substeps = recording.substeps * refine
    h = recording.interval / substeps
    rows: list[list[float]] = []
    for k in range(recording.samples):
        read = [y * factor + offset for y, (factor, offset) in zip(fmu.get(outputs), scale, strict=True)]
        rows.append([sensor.show(y) for sensor, y in zip(sensors, read, strict=True)])
        if k + 1 == recording.samples:
            break
        whole = math.floor(delay / recording.interval)
        part = delay / recording.interval - whole
        old, new = (inputs[min(max(k - late, 0), len(inputs) - 1)] for late in (whole + 1, whole))
        spans = [(new, 0.0, recording.interval)]
        if part > 1e-9 and list(old) != list(new) and not layout.even_steps:
            spans = [(old, 0.0, part * recording.interval)]
            spans += [(new, spans[0][2], recording.interval - spans[0][2])]
        elif part > 1e-9:
            spans = [([part * a + (1 - part) * b for a, b in zip(old, new, strict=True)], 0.0, recording.interval)]
        for held, begin, length in spans:
            if driven:
                fmu.set(driven, list(held))
            steps = substeps if length == recording.interval else max(1, math.ceil(length / h - 1e-9))
            for s in range(steps):
                if length == recording.interval:
                    fmu.step(recording.start + (k * substeps + s) * h, h)
                else:
                    now = recording.start + k * recording.interval + begin
                    fmu.step(now + s * (length / steps), length / steps)
    return rows


def _sensors(layout: JobLayout, recording: ExperimentLayout, values: Sequence[float]) -> tuple[float, list[Sensor]]:
    """Return the delay [s] and the outputs' sensors."""
    sensors = []
    for j, kind in enumerate(layout.sensors):
        average, sections = recording.chains[j] if recording.chains else (1, ())
        gain, offset = values[1 + 2 * j : 3 + 2 * j] if values else (1.0, 0.0)
        sensors.append(
            Sensor(
                mean=kind == MEAN,
                interval=recording.interval,
                average=average,
                sections=[tuple(section) for section in sections],  # type: ignore[misc]
                gain=gain,
                offset=offset,
            )
        )
    return (values[0] if values else 0.0), sensors


def outcome_sentence(outcome: int, *, words: str = "") -> str:
    """Say what an outcome code means: "doStep returned Error: <the FMU's words>"."""
    kind, phase, status = outcome % 256, outcome // 256 % 256, outcome // 65536
    if kind == FAILED:
        return f"{PHASES[phase]} returned {FMI_STATUS[status]}" + (f": {words}" if words else "")
    return {
        FINISHED: "finished",
        CUT_SHORT: "cut short",
        NOT_FINITE: "an output became infinite or not a number",
        CRASHED: "the FMU crashed",
        TIMED_OUT: "the FMU exceeded its time limit",
        PENDING: "not simulated",
    }[kind]


def _address(function: Any) -> int | None:
    return None if function is None else ctypes.cast(function, c_void_p).value


assert ctypes.sizeof(c_uint64) == ctypes.sizeof(c_void_p), "the stepping loop needs a 64-bit platform"

"""An FMU, loaded, which ``stepper.c`` instantiates and steps. Lives in a worker process; knows no search, no fmpy.

Where variables are real numbers the loop calls the functions of an FMU for co-simulation itself; others go through
``slow_path.py`` and fmpy, whose import costs a worker 0.1 s, in the same loop.
"""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Sequence
from ctypes import POINTER, c_double, c_int64, c_uint32, c_void_p
from functools import cache, cached_property
from pathlib import Path
from typing import Any

from estimator.stepping.equations import address, equations_of
from estimator.stepping.fmu_library import CO_SIMULATION, co_simulation_library
from estimator.stepping.layout import DescentLayout, ExperimentLayout, FitsLayout, JobLayout, Placing, positions
from estimator.stepping.library import STEPPER
from estimator.stepping.slow_path import Callbacks, SlowFmu, fmi1_callbacks
from estimator.stepping.structures import (
    SETTING_TYPES,
    BatchStruct,
    CallbacksStruct,
    ChainStruct,
    DescentStruct,
    ExperimentStruct,
    FitsStruct,
    Fmi3Struct,
    FmuStruct,
    JobStruct,
    Log,
    PlacesStruct,
    SettingStruct,
)

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


@cache
def stepper() -> ctypes.CDLL:
    """Return the stepping loop, loaded."""
    library = ctypes.CDLL(str(STEPPER))
    pointers: list[Any] = [POINTER(FmuStruct), POINTER(JobStruct), POINTER(BatchStruct)]
    library.stepper_run.restype = library.stepper_take.restype = library.stepper_run_one.restype = c_int64
    library.stepper_run.argtypes = pointers
    library.stepper_take.argtypes = pointers[2:]
    library.stepper_run_one.argtypes = [*pointers, c_int64, c_int64]
    library.stepper_fit.restype = library.stepper_descend.restype = c_int64
    library.stepper_fit.argtypes = [*pointers[:2], c_void_p, POINTER(FitsStruct)]
    library.stepper_descend.argtypes = [*pointers[:2], c_void_p, POINTER(DescentStruct)]
    library.stepper_close.restype = None
    library.stepper_close.argtypes = pointers[:1]
    return library


class FmuInstance:
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
        self.settings = self._settings(job)
        self.fmu = self._fmu(job)
        self.job = self._job(job, memory)

    @cached_property
    def slow(self) -> SlowFmu:
        """The same FMU, driven by fmpy's methods."""
        job = self.layout
        references = (*job.parameter_references, *job.input_references, *job.output_references)
        types = job.types or ("Real",) * len(references)
        return SlowFmu(
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

    def run(self, batch: BatchStruct) -> int:
        """Simulate candidates until none is left or the quota is reached; return how many this process did."""
        return int(self.stepper.stepper_run(self.fmu, self.job, batch))

    def take(self, batch: BatchStruct) -> int:
        """Take the next candidate; -1: none is left."""
        return int(self.stepper.stepper_take(batch))

    def run_one(self, batch: BatchStruct, *, candidate: int, experiment: int) -> int:
        """Simulate one experiment of a candidate; return its outcome."""
        return int(self.stepper.stepper_run_one(self.fmu, self.job, batch, candidate, experiment))

    def fit(self, fits: FitsLayout, *, claim: int) -> dict[str, Any]:
        """Do whole fits, each simulation claimed at an address; return where each ended, its cost and how.

        None where a simulation has failed; with simulations and steps that were done.
        """
        p, n = len(fits.low), len(fits.starts)
        start, known = [x for row in fits.starts for x in row], fits.known
        ends, costs, ended = (c_double * (n * p))(), (c_double * n)(), (c_int64 * n)()
        given = {"start": _doubles(start), "weights": _doubles(fits.weights), "known": known and _doubles(known)}
        places, kept = _places(fits)
        own = FitsStruct(
            places=places,
            starts=n,
            evaluations=fits.evaluations,
            ftol=fits.ftol,
            xtol=fits.xtol,
            least_step=fits.least_step,
            known_cost=fits.known_cost,
            **_addresses({**given, "ends": ends, "costs": costs, "ended": ended}),
        )
        sound = self.stepper.stepper_fit(self.fmu, self.job, claim, own)
        del kept
        found = [(ends[k * p : (k + 1) * p], costs[k], ended[k]) for k in range(n)]
        return _done(own.places, found if sound else None)

    def descend(self, descent: DescentLayout, *, claim: int, samples: int) -> dict[str, Any]:
        """Do a descent, by weights at an address, where what is shown is written; return as `fit`.

        Where it ended, its cost, how, and whether derivatives are written behind what is shown.
        """
        x = _doubles(descent.x)
        given: dict[str, Any] = {"x": x, "longest": _doubles(descent.longest), "steps": _doubles(descent.steps)}
        given |= {"known": descent.known and _doubles(descent.known), "bars": descent.bars and _doubles(descent.bars)}
        places, kept = _places(descent)
        names = ("iterations", "rounds", "fine", "told", "tolerance", "limit", "least_part", "most_part", "known_cost")
        limits = {name: getattr(descent, name) for name in names}
        own = DescentStruct(places=places, samples=samples, **limits, **_addresses(given))
        sound = self.stepper.stepper_descend(self.fmu, self.job, claim, own)
        del kept
        return _done(own.places, (list(x), own.cost, own.ended, bool(own.knows)) if sound else None)

    def close(self) -> None:
        """Free the instance."""
        self.stepper.stepper_close(self.fmu)
        if "slow" in vars(self):
            self.slow.free()

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

    def _fmu(self, job: JobLayout) -> FmuStruct:
        resources = _resources(job.folder)
        fmu = FmuStruct(
            reinstantiate=int(job.reinstantiate),
            component=None,
            instance_name=job.identifier.encode(),
            guid=job.guid.encode(),
            resources=resources.as_uri().encode(),
            callbacks=ctypes.addressof(self.callbacks),
        )
        if not job.is_fast:
            self._slow = Callbacks(self.slow, self._tell)
            self._slow.settings = job.settings
            self._slow.first_setting = ctypes.addressof(self.settings)
            self._slow.setting_size = ctypes.sizeof(SettingStruct)
            for name, function in self._slow.functions.items():
                setattr(fmu, name, address(function))
            return fmu
        if job.version.startswith("3"):
            fmu.resources = f"{resources}/".encode()
        if job.kind != CO_SIMULATION or job.version.startswith("1"):
            if job.version.startswith("1"):
                self.callbacks = fmi1_callbacks(self.stepper.stepper_log1)
            self._equations = equations_of(
                self.slow.fmu, job, callbacks=self.callbacks, log=self.log, stepper=self.stepper
            )
            self.stepper.stepper_exchange(ctypes.byref(fmu), ctypes.byref(self._equations))
            return fmu
        dll = co_simulation_library(job.folder, job.identifier, job.version[0])
        self._kept.append(dll)
        if job.version.startswith("3"):
            self._fmi3 = self._fmi3_functions(dll)
            self.stepper.stepper_adapt(ctypes.byref(fmu), ctypes.byref(self._fmi3))
            return fmu
        for field, where in _fmi2_functions(dll).items():
            setattr(fmu, field, where)
        if job.interpolates:
            fmu.set_derivatives = address(getattr(dll, "fmi2SetRealInputDerivatives", None))
        return fmu

    def _fmi3_functions(self, dll: Any) -> Fmi3Struct:
        functions = Fmi3Struct(log=ctypes.addressof(self.log), log_message=address(self.stepper.stepper_log3))
        for field, name in FMI3_FUNCTIONS.items():
            setattr(functions, field, address(getattr(dll, f"fmi3{name}")))
        for name, k in SETTING_TYPES.items():
            functions.set_other[k] = address(getattr(dll, f"fmi3Set{name}", None)) if k else None
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
                    None if e.times is None else memory + e.times,
                    None if e.ends is None else memory + e.ends,
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
            linear=self._array(c_int64, job.linear) if any(job.linear) else None,
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


def _done(places: PlacesStruct, found: Any) -> dict[str, Any]:
    return {"found": found, "simulations": places.simulations, "steps": places.steps}


def _places(placing: Placing) -> tuple[PlacesStruct, dict[str, Any]]:
    """Return where parameters go, and what that points to."""
    kept = {name: _doubles(getattr(placing, name)) for name in ("low", "high", "lower", "upper", "gain", "shift")}
    kept |= {
        name: (c_int64 * len(values))(*values) for name, values in (("log", placing.log), ("column", placing.column))
    }
    return PlacesStruct(parameters=len(placing.low), **_addresses(kept)), kept


def _doubles(values: Sequence[float]) -> Any:
    return (c_double * len(values))(*values)


def _addresses(arrays: dict[str, Any]) -> dict[str, int]:
    return {name: ctypes.addressof(array) for name, array in arrays.items() if array is not None}


@cache
def _resources(folder: str) -> Path:
    """Return the folder of an extracted FMU's resources."""
    return Path(folder).resolve() / "resources"


@cache
def _fmi2_functions(dll: Any) -> dict[str, int | None]:
    """Return the addresses of a library's functions of FMI 2.0; None: it has no such setter."""
    found = {field: address(getattr(dll, f"fmi2{name}")) for field, name in FMI2_FUNCTIONS.items()}
    return found | {field: address(getattr(dll, f"fmi2{name}", None)) for field, name in FMI2_SETTERS.items()}


@cache
def _c_library() -> ctypes.CDLL:
    return ctypes.cdll.msvcrt if sys.platform == "win32" else ctypes.CDLL(None)


def native_callbacks(stepper: ctypes.CDLL, log: Log) -> CallbacksStruct:
    """Return FMI 2 callbacks that never enter Python: the stepper's logger, the C library's memory functions."""
    c = _c_library()
    return CallbacksStruct(
        logger=address(stepper.stepper_log),
        allocate_memory=address(c.calloc),
        free_memory=address(c.free),
        environment=ctypes.addressof(log),
    )

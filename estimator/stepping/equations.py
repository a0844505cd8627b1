"""The functions of an FMU that ``model_exchange.h`` calls, found in its library: for model exchange, or FMI 1.0."""

from __future__ import annotations

import ctypes
from ctypes import c_void_p
from pathlib import Path
from typing import Any

from estimator.stepping.layout import JobLayout
from estimator.stepping.model_exchange import TOLERANCE
from estimator.stepping.structures import SETTING_TYPES, SUNDIALS, EquationsStruct, Log

# Field of EquationsStruct → function of the standard, by version; what is not called in a version is left out.
_MODEL = {
    "set_time": "SetTime",
    "set_states": "SetContinuousStates",
    "get_states": "GetContinuousStates",
    "get_indicators": "GetEventIndicators",
    "completed": "CompletedIntegratorStep",
}
_MODES = {
    "free_instance": "FreeInstance",
    "reset": "Reset",
    "enter": "EnterInitializationMode",
    "exit": "ExitInitializationMode",
    "enter_event": "EnterEventMode",
    "enter_continuous": "EnterContinuousTimeMode",
    "get_nominals": "GetNominalsOfContinuousStates",
}
_REALS = {"set_real": "SetReal", "get_real": "GetReal"}
FUNCTIONS = {
    ("1", True): {
        **_MODEL,
        **_REALS,
        "instantiate": "InstantiateModel",
        "free_instance": "FreeModelInstance",
        "initialize": "Initialize",
        "get_derivatives": "GetDerivatives",
        "get_nominals": "GetNominalContinuousStates",
        "update": "EventUpdate",
    },
    ("1", False): {
        **_REALS,
        "instantiate": "InstantiateSlave",
        "free_instance": "FreeSlaveInstance",
        "reset": "ResetSlave",
        "initialize": "InitializeSlave",
        "do_step": "DoStep",
    },
    ("2", True): {
        **_MODEL,
        **_MODES,
        **_REALS,
        "instantiate": "Instantiate",
        "setup": "SetupExperiment",
        "get_derivatives": "GetDerivatives",
        "update": "NewDiscreteStates",
    },
    ("3", True): {
        **_MODEL,
        **_MODES,
        "set_real": "SetFloat64",
        "get_real": "GetFloat64",
        "instantiate": "InstantiateModelExchange",
        "get_derivatives": "GetContinuousStateDerivatives",
        "update": "UpdateDiscreteStates",
        "count_states": "GetNumberOfContinuousStates",
        "count_indicators": "GetNumberOfEventIndicators",
    },
}
OPTIONAL = ("get_nominals", "completed", "count_indicators")  # the loop does without; another that is missing fails


def equations_of(fmu: Any, job: JobLayout, *, callbacks: Any, log: Log, stepper: ctypes.CDLL) -> EquationsStruct:
    """Return the functions of an FMU whose library fmpy has loaded.

    Parameters
    ----------
    fmu : fmpy's FMU1Slave, FMU1Model, FMU2Model or FMU3Model
    callbacks : of FMI 1.0 or 2.0, kept by the caller
    log : kept by the caller
    """
    version, is_model = job.version[0], job.kind == "model-exchange"
    found = EquationsStruct(
        version=int(version),
        is_model=int(is_model),
        states=job.counts[0],
        indicators=job.counts[1],
        tolerance=TOLERANCE,
        horizon=float("inf"),
        callbacks=ctypes.addressof(callbacks),
        log=ctypes.addressof(log),
        log_message=address(stepper.stepper_log3),
        words=ctypes.addressof(log) + Log.last.offset,
        location=Path(job.folder).resolve().as_uri().encode(),
    )
    prefix = f"{job.identifier}_fmi" if version == "1" else f"fmi{version}"
    for field, name in FUNCTIONS[version, is_model].items():
        function = fmu.dll.find(prefix + name)
        if function is None and field not in OPTIONAL:
            function = stepper.stepper_missing
        setattr(found, field, address(function))
    for name, k in SETTING_TYPES.items():
        found.set_other[k] = address(fmu.dll.find(f"{prefix}Set{name}"))
    for k, function in enumerate(_sundials()):
        found.sundials[k] = address(function)
    return found


def _sundials() -> list[Any]:
    """Return SUNDIALS' functions; none where fmpy brings none for this platform, or another version's."""
    try:
        from fmpy.sundials import libraries

        return [getattr(getattr(libraries, library), name) for library, name in SUNDIALS]
    except (ImportError, OSError, AttributeError):
        return []


def address(function: Any) -> int | None:
    """Return where a function of a library begins."""
    return None if function is None else ctypes.cast(function, c_void_p).value

"""Motor parameters with error bars, from recordings, by co-simulation of any motor FMU.

>>> import estimator
>>> result = estimator.estimate_parameters("examples/cml050_step.csv", seed=1)
>>> result.verdict
'ok'

Ten names are public; each is loaded when it is first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from estimator.api import describe_fmu, estimate_parameters, simulate_fmu
    from estimator.cases.case import Case, read_case
    from estimator.errors import InputError, SimulationError
    from estimator.recordings.reading import read_recording, recording_from_arrays
    from estimator.results.shown_result import Result

__all__ = [
    "Case",
    "InputError",
    "Result",
    "SimulationError",
    "describe_fmu",
    "estimate_parameters",
    "read_case",
    "read_recording",
    "recording_from_arrays",
    "simulate_fmu",
]

_HOMES = {
    "Case": "cases.case",
    "InputError": "errors",
    "Result": "results.shown_result",
    "SimulationError": "errors",
    "describe_fmu": "api",
    "estimate_parameters": "api",
    "read_case": "cases.case",
    "read_recording": "recordings.reading",
    "recording_from_arrays": "recordings.reading",
    "simulate_fmu": "api",
}


def __getattr__(name: str) -> Any:
    """Load a public name when it is first used: importing the package costs nothing."""
    if name not in _HOMES:
        raise AttributeError(f"module 'estimator' has no attribute {name!r}; public are {', '.join(__all__)}")
    from importlib import import_module

    return getattr(import_module(f"estimator.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)

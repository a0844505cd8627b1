"""Estimates made by hand, for the tests of what is shown and written."""

import dataclasses
from functools import cache
from typing import Any

import numpy as np
from scipy.linalg import expm

from estimator.results.result import Comparison, CostProfile, Estimate, ParameterEstimate, SearchHistory

MOTOR = {"R": 3.1363, "K": 0.048774, "L": 0.01307, "J": 9e-6, "B": 1.69e-4}
UNITS = {"R": "Ohm", "K": "V.s/rad", "L": "H", "J": "kg.m2", "B": "N.m.s/rad"}


def response(voltage: np.ndarray, *, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Return current and speed of the motor at rest for a held voltage."""
    i, w = _response(tuple(voltage.tolist()), step)
    return i.copy(), w.copy()


@cache  # most tests show the same step
def _response(voltage: tuple[float, ...], step: float) -> tuple[np.ndarray, np.ndarray]:
    R, K, L, J, B = MOTOR.values()
    matrix = np.array([[-R / L, -K / L, 1 / L], [K / J, -B / J, 0], [0, 0, 0]])
    transition = expm(matrix * step)
    state, states = np.zeros(2), np.empty((len(voltage), 2))
    for k, v in enumerate(voltage):
        states[k] = state
        state = transition[:2, :2] @ state + transition[:2, 2] * v
    return states[:, 0], states[:, 1]


def comparison(
    voltage: np.ndarray | None = None,
    *,
    name: str = "step_10V5",
    step: float = 1e-3,
    noise: tuple[float, float] = (0.02, 1.0),
    seed: int = 1,
) -> Comparison:
    """Return a recording against its simulation; by default a noisy step of 10.5 V at 0.5 s."""
    if voltage is None:
        voltage = np.where(np.arange(2801) >= 500, 10.5, 0.0)
    n = len(voltage)
    i, w = response(voltage, step=step)
    rng = np.random.default_rng(seed)
    return Comparison(
        name=name,
        time=np.arange(n) * step,
        inputs={"v": voltage, "load": np.zeros(n)},
        measured={
            "i": i + noise[0] * rng.standard_normal(n),
            "w": w + noise[1] * rng.standard_normal(n),
        },
        simulated={"i": i, "w": w},
        units={"i": "A", "w": "rad/s", "v": "V", "load": "N.m"},
    )


def estimate(**changes: Any) -> Estimate:
    """Return an ok estimate of the motor, with some fields changed."""
    correlation = np.eye(5)
    correlation[0, 1] = correlation[1, 0] = -0.97
    made = Estimate(
        verdict="ok",
        reasons=(),
        parameters={
            name: ParameterEstimate(name, value, UNITS[name], value / 100, value * 100, standard_error=1e-3 * value)
            for name, value in MOTOR.items()
        },
        method="cuckoo",
        seed=1,
        simulations=283,
        simulations_by_phase={"probe": 1, "search": 180, "polish": 98, "step check": 4},
        failed_simulations=0,
        steps=792_400,
        seconds=0.4123,
        fmu={"name": "dc_motor", "path": "dc_motor.fmu", "fmi_version": "2.0", "guid": "{a-b}"},
        versions={"fmu-estimator": "0.1.0", "numpy": np.__version__},
        rmse={"i": 0.020014, "w": 1.0012},
        fit_percent={"i": 95.21, "w": 99.1234},
        noise={"i": 0.02, "w": 1.0},
        correlation=correlation,
        correlated=tuple(MOTOR),
        notes=("step_10V5: step from 0 to 10.5 V at t = 0.5 s",),
        comparisons=(comparison(),),
        history=SearchHistory(np.arange(15.0, 195.0, 15.0), np.geomspace(10, 1e-3, 12), np.geomspace(100, 0.1, 12)),
        workers=2,
    )
    return dataclasses.replace(made, **changes)


def with_parameter(made: Estimate, name: str, **changes: Any) -> Estimate:
    """Return an estimate with one parameter changed."""
    parameters = dict(made.parameters)
    parameters[name] = dataclasses.replace(parameters[name], **changes)
    return dataclasses.replace(made, parameters=parameters)


def profiles(names: tuple[str, ...] = tuple(MOTOR)) -> dict[str, CostProfile]:
    """Return cost profiles of a thousandth as standard error, of parameters that stand in for each other."""
    offsets = np.linspace(-3, 3, 13)
    return {
        name: CostProfile(MOTOR.get(name, 1.0) * (1 + 1e-3 * offsets), 25 * offsets**2, offsets**2) for name in names
    }

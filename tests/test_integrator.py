"""The integrator, seen through the FMU: exact where a model is linear, accurate and stable where it is not."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from pathlib import Path

import mpmath
import numpy as np
import pytest
from exact_motor import exact_response, worst_error
from fmu_instances import ERROR, FmuInstance, Opened, status
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

import fmu_build

pytestmark = pytest.mark.usefixtures("compiled_quickly")
MODELS = Path(__file__).parent / "models"
OUTPUTS = ("i", "w", "angle")
PEAK = 24.0  # V
# The paper's box.
LOWER = {"R": 0.01, "K": 0.005, "L": 1e-7, "J": 1e-7, "B": 1e-5}
UPPER = {"R": 5.0, "K": 0.1, "L": 0.5, "J": 1e-3, "B": 1e-3}


@pytest.fixture(scope="module")
def motor() -> Iterator[FmuInstance]:
    with Opened(fmu_build.bundled("dc_motor")) as opened:
        yield opened.instance()


@pytest.fixture(scope="module")
def fan(tmp_path_factory: pytest.TempPathFactory) -> Iterator[FmuInstance]:
    target = tmp_path_factory.mktemp("fan") / "dc_motor_fan.fmu"
    with Opened(fmu_build.build(MODELS / "dc_motor_fan.c", output=target)) as opened:
        yield opened.instance()


@pytest.fixture(scope="module")
def elastic(tmp_path_factory: pytest.TempPathFactory) -> Iterator[FmuInstance]:
    target = tmp_path_factory.mktemp("elastic") / "dc_motor_elastic.fmu"
    with Opened(fmu_build.build(MODELS / "dc_motor_elastic.c", output=target)) as opened:
        yield opened.instance()


def random_motor(rng: np.random.Generator) -> dict[str, float]:
    """Return parameters from the paper's box, log-uniform."""
    return {name: float(np.exp(rng.uniform(np.log(LOWER[name]), np.log(UPPER[name])))) for name in LOWER}


def simulate(
    instance: FmuInstance,
    parameters: dict[str, float],
    voltages: NDArray[np.float64],
    *,
    step: float,
    load: float = 0.0,
) -> NDArray[np.float64]:
    instance.fmi.reset()
    instance.start(load=load, **parameters)
    return instance.run({"v": list(voltages)}, OUTPUTS, step=step)


def error_over_the_box(instance: FmuInstance, *, points: int, step: float, samples: int = 200, seed: int = 1) -> float:
    """Return the largest error over random motors under random held voltage, as a fraction of each signal's peak."""
    rng = np.random.default_rng(seed)
    worst = 0.0
    for _ in range(points):
        parameters, voltages = random_motor(rng), rng.uniform(-PEAK, PEAK, samples)
        simulated = simulate(instance, parameters, voltages, step=step)
        worst = max(worst, worst_error(simulated, exact_response(parameters, list(voltages), step=step)))
    return worst


@pytest.mark.parametrize("step", [7e-3, pytest.param(1e-3, marks=pytest.mark.full)])
def test_response_to_held_voltage_is_exact_over_the_papers_box(motor: FmuInstance, step: float) -> None:
    assert error_over_the_box(motor, points=30, step=step) < 1e-12


@pytest.mark.parametrize("step", [1e-6, 1e-3, 7e-3, 0.1])
def test_response_is_exact_in_the_corners_of_the_box(motor: FmuInstance, step: float) -> None:
    # where L and J are smallest, a settled current is 1e-5 of what it was within the step
    voltages = np.random.default_rng(11).uniform(-PEAK, PEAK, 50)
    for corner in product(*zip(LOWER.values(), UPPER.values(), strict=True)):
        parameters = dict(zip(LOWER, corner, strict=True))
        simulated = simulate(motor, parameters, voltages, step=step)
        assert worst_error(simulated, exact_response(parameters, list(voltages), step=step)) < 1e-12


@pytest.mark.parametrize("step", [1e-6, 1e-5, 0.1, 2.0])
def test_response_is_exact_at_any_communication_step(motor: FmuInstance, step: float) -> None:
    assert error_over_the_box(motor, points=10, step=step, samples=100) < 1e-12


@pytest.mark.full
@pytest.mark.parametrize("step", [1e-3, 7e-3])
def test_response_is_exact_at_a_thousand_points_of_the_box(motor: FmuInstance, step: float) -> None:
    worst = error_over_the_box(motor, points=1000, step=step, seed=2)
    print(f"worst error at {step:g} s over 1000 points: {worst:.2e} of the peak")
    assert worst < 1e-12


def test_load_torque_is_held_like_the_voltage(motor: FmuInstance) -> None:
    rng = np.random.default_rng(3)
    for _ in range(5):
        parameters, voltages = random_motor(rng), rng.uniform(-PEAK, PEAK, 50)
        simulated = simulate(motor, parameters, voltages, step=1e-3, load=0.02)
        exact = exact_response(parameters, list(voltages), step=1e-3, load=0.02)
        assert worst_error(simulated, exact) < 1e-11


def test_motor_without_friction_is_exact(motor: FmuInstance) -> None:
    parameters = {"R": 1.0, "K": 0.05, "L": 1e-3, "J": 1e-5, "B": 0.0}
    voltages = np.random.default_rng(4).uniform(-PEAK, PEAK, 50)
    simulated = simulate(motor, parameters, voltages, step=1e-3)
    assert worst_error(simulated, exact_response(parameters, list(voltages), step=1e-3)) < 1e-12


def test_double_eigenvalue_is_no_special_case(motor: FmuInstance) -> None:
    # (R/L - B/J)^2 = 4 K^2 / (L J) to the last bit
    parameters = {"R": 3.0, "K": 1.0, "L": 1.0, "J": 1.0, "B": 1.0}
    voltages = np.random.default_rng(5).uniform(-PEAK, PEAK, 50)
    simulated = simulate(motor, parameters, voltages, step=0.5)
    assert worst_error(simulated, exact_response(parameters, list(voltages), step=0.5)) < 1e-13


def test_seven_short_steps_are_one_long_step(motor: FmuInstance) -> None:
    rng = np.random.default_rng(6)
    for _ in range(10):
        parameters, voltages = random_motor(rng), rng.uniform(-PEAK, PEAK, 20)
        long = simulate(motor, parameters, voltages, step=7e-3)
        short = simulate(motor, parameters, np.repeat(voltages, 7), step=1e-3)[6::7]
        assert np.all(np.abs(long - short) <= 1e-11 * np.abs(long).max(axis=0))


def test_communication_step_may_vary_from_call_to_call(motor: FmuInstance) -> None:
    parameters = {"R": 1.0, "K": 0.05, "L": 1e-4, "J": 1e-5, "B": 1e-4}
    steps = np.random.default_rng(7).choice([1e-6, 3e-4, 1e-3, 0.05, 0.1], 60)
    simulate(motor, parameters, np.array([]), step=1.0)
    motor.set(v=12.0)
    time = 0.0
    for step in steps:
        motor.step(time, float(step))
        time += step
    exact = exact_response(parameters, [12.0], step=time)
    assert worst_error(np.array([motor.get(*OUTPUTS)]), exact) < 1e-11


def test_step_that_differs_by_the_rounding_of_the_time_is_the_same_step(motor: FmuInstance) -> None:
    # as libcosim does: (k + 1) h - k h, each rounded
    voltages = np.random.default_rng(8).uniform(-PEAK, PEAK, 100)
    expected = simulate(motor, {}, voltages, step=1e-3)
    simulate(motor, {}, np.array([]), step=1e-3)
    rows = []
    for k, voltage in enumerate(voltages):
        motor.set(v=voltage)
        motor.step(k * 1e-3, (k + 1) * 1e-3 - k * 1e-3)
        rows.append(motor.get(*OUTPUTS))
    assert np.array_equal(expected, rows)


def test_parameter_changed_between_steps_counts_from_there_on(motor: FmuInstance) -> None:
    first, second = {"R": 1.0, "K": 0.05, "L": 1e-3, "J": 1e-5, "B": 1e-4}, {"R": 2.0, "J": 3e-5}
    simulate(motor, first, np.full(5, 12.0), step=1e-3)
    state = dict(zip(OUTPUTS, motor.get(*OUTPUTS), strict=True))
    motor.set(**second)
    motor.step(5e-3, 1e-3)
    changed = motor.get(*OUTPUTS)
    motor.fmi.reset()
    motor.start(**(first | second | state | {"v": 12.0}))
    motor.step(0.0, 1e-3)
    assert motor.get(*OUTPUTS) == changed


@pytest.mark.parametrize("step", [1e-6, 1e-3, 0.05])
@pytest.mark.parametrize("changes", [{}, {"L": 1e-7}, {"stiffness": 0.0}], ids=str)
def test_linear_model_of_five_states_is_exact(elastic: FmuInstance, changes: dict[str, float], step: float) -> None:
    p = {"R": 0.92, "K": 0.0735, "L": 7.76e-3, "J": 1.36e-4, "B": 6.78e-4}
    p |= {"J2": 5e-4, "stiffness": 20.0, "damping": 1e-3} | changes
    voltages = np.random.default_rng(12).uniform(-PEAK, PEAK, 50)
    elastic.fmi.reset()
    elastic.start(**p, load=0.02)
    simulated = elastic.run({"v": list(voltages)}, ("i", "w", "w2", "angle", "angle2", "torque"), step=step)
    with mpmath.workdps(60):
        R, K, L, J, B, J2, c, d = (mpmath.mpf(value) for value in p.values())
        a = mpmath.matrix(7, 7)  # the five states, the voltage, the load
        a[0, :] = mpmath.matrix([[-R / L, -K / L, 0, 0, 0, 1 / L, 0]])
        a[1, :] = mpmath.matrix([[K / J, -(B + d) / J, d / J, -c / J, c / J, 0, 0]])
        a[2, :] = mpmath.matrix([[0, d / J2, -d / J2, c / J2, -c / J2, 0, -1 / J2]])
        a[3, 1] = a[4, 2] = 1
        grown = mpmath.expm(a * mpmath.mpf(step))
        x = mpmath.matrix(7, 1)
        rows = []
        for voltage in voltages.tolist():
            x[5], x[6] = voltage, mpmath.mpf(0.02)
            x = grown * x
            rows.append([*x[:5], c * (x[3] - x[4]) + d * (x[1] - x[2])])
    exact = np.array(rows, dtype=object)
    assert worst_error(simulated[:, :5], exact[:, :5]) < 1e-11
    assert worst_error(simulated[:, 5:], exact[:, 5:]) < 1e-8  # the difference of two angles


@pytest.mark.parametrize(
    ("changes", "step", "samples"),
    [
        pytest.param({}, 1e-3, 40, id="Mavilor CML-050 at 1 ms"),
        pytest.param({}, 7e-3, 20, id="at 7 ms"),
        pytest.param({}, 0.1, 5, id="at 0.1 s"),
        pytest.param({"drag": 1e-4, "J": 1e-6}, 1e-3, 20, id="strong drag"),
        pytest.param({"L": 1e-6}, 1e-3, 10, id="stiff"),
        pytest.param({"L": 1e-7, "drag": 1e-5}, 1e-3, 2, id="very stiff"),
    ],
)
def test_model_that_is_not_linear_agrees_with_solve_ivp(
    fan: FmuInstance, changes: dict[str, float], step: float, samples: int
) -> None:
    p = {"R": 3.1363, "K": 0.048774, "L": 0.01307, "J": 9e-6, "B": 1.69e-4, "drag": 1e-6} | changes
    voltages = np.random.default_rng(9).uniform(-PEAK, PEAK, samples)
    fan.fmi.reset()
    fan.start(**p)
    simulated = fan.run({"v": list(voltages)}, ("i", "w", "power", "torque"), step=step)
    state = np.zeros(2)
    method = "Radau" if p["L"] < 1e-6 else "DOP853"
    rows = []
    for v in voltages:

        def rates(_: float, x: NDArray[np.float64], v: float = float(v)) -> list[float]:
            i, w = x.tolist()
            drag = p["drag"] * w * abs(w)
            return [(v - p["R"] * i - p["K"] * w) / p["L"], (p["K"] * i - p["B"] * w - drag) / p["J"]]

        solution = solve_ivp(rates, (0.0, step), state, method=method, rtol=1e-12, atol=1e-13, t_eval=[step])
        state = solution.y[:, -1]
        rows.append([state[0], state[1], v * state[0], p["drag"] * state[1] * abs(state[1])])
    exact = np.array(rows)
    assert np.all(np.abs(simulated - exact) <= 1e-9 * np.abs(exact).max(axis=0))


def test_model_that_is_not_linear_repeats_itself_from_a_restored_state(fan: FmuInstance) -> None:
    voltages = list(np.random.default_rng(10).uniform(-PEAK, PEAK, 20))
    fan.fmi.reset()
    fan.start()
    fan.run({"v": voltages}, ("i",), step=1e-3)
    state = fan.fmi.getFMUState()
    first = fan.run({"v": voltages}, ("i", "w", "power"), step=2e-3, start=0.02)
    fan.fmi.setFMUState(state)
    second = fan.run({"v": voltages}, ("i", "w", "power"), step=2e-3, start=0.02)
    fan.fmi.freeFMUState(state)
    assert np.array_equal(first, second)


@pytest.mark.parametrize("linear", [True, False])
def test_step_that_would_leave_the_finite_fails_and_keeps_the_last_state(tmp_path: Path, linear: bool) -> None:
    model = tmp_path / "runaway.c"
    model.write_text(f"""/* Grows without bound. */
#define MODEL_LINEAR {int(linear)}
#define MODEL_VARIABLES(X) \\
    X(parameter, rate, 1, 1, 0, 1e6, "1/s", "Rate of growth") \\
    X(state, x, 1, 1, -1e300, 1e300, "1", "What grows")
#include "model.h"
static void derivatives(const Variables *m, Derivatives *d)
{{
    d->x = m->rate * m->x * ({int(linear)} ? 1 : m->x);
}}
""")
    with Opened(fmu_build.build(model, output=tmp_path / "runaway.fmu")) as opened:
        logs: list[tuple[int, str, str]] = []
        instance = opened.instance(logs=logs)
        instance.start(rate=10.0 if linear else 1.0)
        instance.step(0.0, 0.5)
        reached = instance.get("x")
        assert reached[0] == pytest.approx(np.exp(5) if linear else 2.0, rel=1e-9)
        assert status(instance.step, 0.5, 1000.0) == ERROR
        assert logs == [(ERROR, "logStatusError", "the step from 0.5 s did not end in a finite state")]
        assert instance.get("x") == reached
        assert status(instance.step, 0.5, 0.1) == ERROR  # until it is reset
        instance.fmi.reset()
        instance.start()
        instance.step(0.0, 0.5)

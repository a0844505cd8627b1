"""What the functions of a built FMU do in FMI 3.0 alone, call by call: co-simulation, unseen by validators."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from ctypes import byref, c_bool, c_double, c_size_t, c_ubyte, c_uint, c_void_p

import numpy as np
import pytest
from fmu_instances import ERROR, OK, FmuInstance, Opened, status

import fmu_build

pytestmark = pytest.mark.usefixtures("compiled_quickly")

OUTPUTS = ("i", "w", "angle")
OTHER = {"R": 0.921042, "K": 0.073472, "L": 0.007759, "J": 0.000136, "B": 0.000678}


@pytest.fixture(scope="module", params=["dc_motor", "dc_motor_friction"])
def opened(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Opened]:
    output = tmp_path_factory.mktemp("third") / "motor.fmu"
    with Opened(fmu_build.build(request.param, output=output, fmi=3)) as opened:
        yield opened


@pytest.fixture
def motor(opened: Opened) -> FmuInstance:
    return opened.instance()


def voltages(count: int, *, seed: int = 1) -> list[float]:
    return list(np.random.default_rng(seed).uniform(-24, 24, count))


def test_seven_short_steps_are_one_long_step(motor: FmuInstance) -> None:
    held = voltages(40)
    motor.start(**OTHER)
    long = motor.run({"v": held}, OUTPUTS, step=7e-3)
    motor.fmi.reset()
    motor.start(**OTHER)
    short = motor.run({"v": list(np.repeat(held, 7))}, OUTPUTS, step=1e-3)[6::7]
    assert np.all(np.abs(long - short) <= 1e-11 * np.abs(long).max(axis=0))


@pytest.mark.parametrize(
    "damage",
    [
        pytest.param(lambda s: s[:-1], id="too short"),
        pytest.param(lambda s: b"", id="empty"),
        pytest.param(lambda s: b"x" + s[1:], id="another token"),
        pytest.param(lambda s: s[:-1] + b"\xff", id="no such phase"),
    ],
)
def test_serialised_state_that_is_not_of_this_fmu_is_an_error(
    motor: FmuInstance, damage: Callable[[bytes], bytes]
) -> None:
    motor.start()
    wrong = damage(bytes(motor.fmi.serializeFMUState(motor.fmi.getFMUState())))
    fmi, state = motor.fmi, c_void_p()
    buffer = (c_ubyte * max(len(wrong), 1))(*wrong)
    assert status(fmi.fmi3DeserializeFMUState, fmi.component, buffer, len(wrong), byref(state)) == ERROR
    assert state.value is None


def test_step_says_what_fmi_wants_to_know(motor: FmuInstance) -> None:
    motor.start(time=5.0)
    answers, last = [c_bool(True) for _ in range(3)], c_double()
    code = motor.fmi.fmi3DoStep(
        motor.fmi.component, 5.0, 1e-3, True, *(byref(answer) for answer in answers), byref(last)
    )
    assert code == OK and not any(answer.value for answer in answers) and last.value == 5.0 + 1e-3


def test_values_references_and_types_that_do_not_fit_are_errors(motor: FmuInstance) -> None:
    fmi, count = motor.fmi, max(motor.references.values()) + 1
    for reference in (count, count + 1, 2**32 - 1):
        assert status(fmi.getFloat64, [0, reference]) == ERROR
        assert status(fmi.setFloat64, [reference], [1.0]) == ERROR
    assert status(fmi.setFloat64, [motor.references["time"]], [1.0]) == ERROR
    references, values = (c_uint * 2)(0, 1), (c_double * 2)()
    for name in ("fmi3GetFloat64", "fmi3SetFloat64"):
        assert status(getattr(fmi, name), fmi.component, references, 2, values, 1) == ERROR
        assert status(getattr(fmi, name), fmi.component, None, 2, values, 2) == ERROR
        assert status(getattr(fmi, name), fmi.component, references, 2, None, 2) == ERROR
    for get, put in [(fmi.getInt32, fmi.setInt32), (fmi.getBoolean, fmi.setBoolean), (fmi.getFloat32, fmi.setFloat32)]:
        assert status(get, [0]) == status(put, [0], [1]) == ERROR


def test_calls_without_an_instance_and_what_is_not_offered_are_errors(motor: FmuInstance) -> None:
    dll = motor.fmi.dll
    for name in ("Reset", "ExitInitializationMode", "Terminate", "EnterEventMode", "EnterStepMode"):
        assert getattr(dll, f"fmi3{name}")(None) == ERROR
    assert dll.fmi3GetFloat64(None, None, c_size_t(0), None, c_size_t(0)) == ERROR
    motor.start()
    component = c_void_p(motor.fmi.component)
    for name in ("EnterStepMode", "EnterConfigurationMode", "ExitConfigurationMode", "EnterEventMode"):
        assert getattr(dll, f"fmi3{name}")(component) == ERROR
    motor.step(0.0, 1e-3)

"""What the functions of a built FMU do in FMI 2.0 alone, call by call; what validators do not look at."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from ctypes import byref, c_double, c_int, c_size_t, c_uint, c_void_p, create_string_buffer
from pathlib import Path

import numpy as np
import pytest
from fmu_instances import DISCARD, ERROR, OK, FmuInstance, Opened, status

import fmu_build

pytestmark = pytest.mark.usefixtures("compiled_quickly")

FAN = Path(__file__).parent / "models" / "dc_motor_fan.c"
OUTPUTS = ("i", "w", "angle")
OTHER = {"R": 0.921042, "K": 0.073472, "L": 0.007759, "J": 0.000136, "B": 0.000678}


@pytest.fixture(scope="module")
def opened() -> Iterator[Opened]:
    with Opened(fmu_build.bundled("dc_motor")) as opened:
        yield opened


@pytest.fixture
def motor(opened: Opened) -> FmuInstance:
    return opened.instance()


def voltages(count: int, *, seed: int = 1) -> list[float]:
    return list(np.random.default_rng(seed).uniform(-24, 24, count))


def test_reset_is_possible_in_every_phase(motor: FmuInstance) -> None:
    motor.fmi.reset()
    motor.fmi.setupExperiment()
    motor.fmi.enterInitializationMode()
    motor.fmi.reset()
    motor.start()
    motor.fmi.terminate()
    motor.fmi.reset()
    motor.start()
    motor.step(0.0, 1e-3)


def test_input_out_of_range_is_discarded(motor: FmuInstance) -> None:
    motor.start()
    motor.set(v=12.0)
    assert status(motor.set, v=float("nan")) == DISCARD
    motor.step(0.0, 1e-3)
    assert motor.get("v") == [12.0]


def test_friction_may_be_zero(motor: FmuInstance) -> None:
    motor.start(B=0.0)


def test_states_may_be_set_until_initialisation_ends(motor: FmuInstance) -> None:
    motor.start(w=100.0, angle=3.0)
    assert motor.get(*OUTPUTS) == [0.0, 100.0, 3.0]
    assert status(motor.set, w=1.0) == ERROR
    motor.step(0.0, 1e-3)
    assert status(motor.set, i=1.0) == ERROR


def test_calculated_outputs_follow_inputs_and_cannot_be_set(tmp_path: Path) -> None:
    with Opened(fmu_build.build(FAN, output=tmp_path / "dc_motor_fan.fmu")) as opened:
        fan = opened.instance()
        assert status(fan.set, power=1.0) == ERROR
        fan.start(i=2.0, w=10.0, v=3.0, drag=1e-3)
        assert fan.get("power", "torque") == [6.0, 0.1]
        fan.set(v=5.0)
        assert fan.get("power") == [10.0]
        fan.step(0.0, 1e-3)
        i, v, power = fan.get("i", "v", "power")
        assert power == i * v


def test_rounding_of_the_importers_clock_does_not_pass_the_stop_time(motor: FmuInstance) -> None:
    time = 0.0
    motor.start(stop=2.8)
    for _ in range(2800):
        motor.step(time, 1e-3)
        time += 1e-3
    assert time != 2.8


@pytest.mark.parametrize("time", [float("nan"), float("inf"), float("-inf"), 1e10])
def test_communication_point_that_is_no_time_is_an_error(motor: FmuInstance, time: float) -> None:
    motor.start()
    assert status(motor.step, time, 1e-3) == ERROR
    motor.step(0.0, 1e-3)
    if time > 0 or time != time:
        assert status(motor.step, time, 1e-3) == ERROR


def test_time_is_the_communication_point_plus_the_step(motor: FmuInstance) -> None:
    time = c_double()
    motor.start(time=5.0)
    for k in range(1000):
        motor.step(5.0 + k * 1e-3, 1e-3)
    motor.fmi.fmi2GetRealStatus(motor.fmi.component, 2, byref(time))
    assert time.value == 5.0 + 999 * 1e-3 + 1e-3


def test_steps_that_come_again_in_turn_give_the_bits_of_steps_that_are_computed_anew(opened: Opened) -> None:
    """Five lengths, more than are kept; inputs change meanwhile; a parameter that is set again makes all forgotten."""
    steps = [1e-3, 4e-4, 6e-4, 1e-3, 4e-4, 2e-4, 1e-4, 6e-4, 1e-3, 4e-4, 6e-4, 4e-4, 6e-4]
    rows = []
    for anew in (False, True):
        motor, time = opened.instance(), 0.0
        motor.start()
        rows.append([])
        for v, step in zip(voltages(len(steps)), steps, strict=True):
            motor.set(v=v)
            if anew:
                motor.set(R=motor.get("R")[0])
            motor.step(time, step)
            time += step
            rows[-1].append(motor.get(*OUTPUTS))
    assert rows[0] == rows[1]


def test_start_time_and_stop_time_are_checked(motor: FmuInstance) -> None:
    assert status(motor.fmi.setupExperiment, startTime=float("nan")) == ERROR
    assert status(motor.fmi.setupExperiment, startTime=1e10) == ERROR
    assert status(motor.fmi.setupExperiment, startTime=1.0, stopTime=0.5) == ERROR
    assert status(motor.fmi.setupExperiment, startTime=1.0, stopTime=float("nan")) == ERROR
    motor.fmi.setupExperiment(startTime=-1.0, stopTime=0.5)


def test_an_experiment_is_set_up_once_and_a_state_is_serialised_to_the_same_bytes(motor: FmuInstance) -> None:
    motor.start()
    assert status(motor.fmi.setupExperiment) == ERROR
    first, second = (motor.fmi.serializeFMUState(motor.fmi.getFMUState()) for _ in range(2))
    assert first == second


def test_state_may_be_taken_again_into_the_same_memory(motor: FmuInstance) -> None:
    motor.start()
    state = motor.fmi.getFMUState()
    motor.run({"v": voltages(5)}, OUTPUTS, step=1e-3)
    address = state.value
    motor.fmi.fmi2GetFMUstate(motor.fmi.component, byref(state))
    assert state.value == address
    reached = motor.get(*OUTPUTS)
    motor.fmi.reset()
    motor.fmi.setFMUState(state)
    assert motor.get(*OUTPUTS) == reached
    motor.fmi.fmi2FreeFMUstate(motor.fmi.component, byref(state))
    assert state.value is None


@pytest.mark.parametrize(
    "damage",
    [
        pytest.param(lambda s: s[:-1], id="too short"),
        pytest.param(lambda s: b"", id="empty"),
        pytest.param(lambda s: b"x" + s[1:], id="another GUID"),
        pytest.param(lambda s: s[:-1] + b"\xff", id="no such phase"),
        pytest.param(lambda s: s[:40] + b"\xff" * 8 + s[48:], id="NaN"),
    ],
)
def test_serialised_state_that_is_not_of_this_fmu_is_an_error(
    motor: FmuInstance, damage: Callable[[bytes], bytes]
) -> None:
    motor.start()
    wrong = damage(motor.fmi.serializeFMUState(motor.fmi.getFMUState()))
    fmi, state = motor.fmi, c_void_p()
    buffer = create_string_buffer(wrong, max(len(wrong), 1))
    assert status(fmi.fmi2DeSerializeFMUstate, fmi.component, buffer, len(wrong), byref(state)) == ERROR
    assert state.value is None


def test_serialisation_into_too_little_memory_is_an_error(motor: FmuInstance) -> None:
    motor.start()
    fmi, state, size = motor.fmi, motor.fmi.getFMUState(), c_size_t()
    fmi.fmi2SerializedFMUstateSize(fmi.component, state, byref(size))
    buffer = create_string_buffer(size.value)
    assert status(fmi.fmi2SerializeFMUstate, fmi.component, state, buffer, size.value - 1) == ERROR


def test_instance_may_be_made_without_resources_logger_or_name(motor: FmuInstance) -> None:
    dll = motor.fmi.dll
    dll.fmi2Instantiate.restype = c_void_p
    guid = motor.description.guid.encode()
    component = dll.fmi2Instantiate(None, 1, guid, None, None, 0, 1)
    assert component
    dll.fmi2FreeInstance.argtypes = [c_void_p]
    assert dll.fmi2DoStep(c_void_p(component), c_double(0), c_double(1e-3), 0) == ERROR  # logged nowhere
    dll.fmi2FreeInstance(component)
    assert not dll.fmi2Instantiate(b"motor", 1, None, None, None, 0, 1)
    dll.fmi2FreeInstance(None)


def test_calls_without_an_instance_are_errors(motor: FmuInstance) -> None:
    dll, reference, value = motor.fmi.dll, (c_uint * 1)(0), (c_double * 1)(0)
    for function in ("Reset", "EnterInitializationMode", "ExitInitializationMode", "Terminate", "CancelStep"):
        assert getattr(dll, f"fmi2{function}")(None) == ERROR
    assert dll.fmi2SetReal(None, reference, c_size_t(1), value) == ERROR
    assert dll.fmi2GetReal(None, reference, c_size_t(1), value) == ERROR
    assert dll.fmi2DoStep(None, c_double(0), c_double(1e-3), 0) == ERROR


def test_value_references_and_types_that_do_not_exist_are_errors(motor: FmuInstance) -> None:
    fmi, count = motor.fmi, len(motor.references)
    for reference in (10, count + 1, 2**32 - 1):  # 10: the time, in FMI 3.0
        assert status(fmi.getReal, [0, reference]) == ERROR
        assert status(fmi.setReal, [reference], [1.0]) == ERROR
    for get, put in [(fmi.getInteger, fmi.setInteger), (fmi.getBoolean, fmi.setBoolean)]:
        assert status(get, [0]) == ERROR
        assert status(put, [0], [1]) == ERROR
        assert status(get, []) == status(put, [], []) == OK
    assert status(fmi.getString, [0]) == ERROR
    assert status(fmi.setString, [0], ["x"]) == ERROR


def test_functions_that_are_not_offered_log_and_are_errors(opened: Opened) -> None:
    logs: list[tuple[int, str, str]] = []
    motor = opened.instance(logs=logs)
    motor.start()
    dll, component = motor.fmi.dll, c_void_p(motor.fmi.component)
    one, reference, value = c_size_t(1), (c_uint * 1)(0), (c_double * 1)(0)
    calls = {
        "fmi2SetRealInputDerivatives": (reference, one, (c_int * 1)(1), value),
        "fmi2GetRealOutputDerivatives": (reference, one, (c_int * 1)(1), value),
        "fmi2CancelStep": (),
        "fmi2GetStatus": (0, byref(c_int())),
        "fmi2GetIntegerStatus": (0, byref(c_int())),
        "fmi2GetStringStatus": (0, None),
    }
    for name, arguments in calls.items():
        logs.clear()
        assert getattr(dll, name)(component, *arguments) == ERROR
        assert [entry[2] for entry in logs] == [f"{name} is not offered by this FMU"]
    motor.step(0.0, 1e-3)


def test_functions_of_model_exchange_are_refused_in_co_simulation(opened: Opened) -> None:
    logs: list[tuple[int, str, str]] = []
    motor = opened.instance(logs=logs)
    motor.start()
    dll, component = motor.fmi.dll, c_void_p(motor.fmi.component)
    three, values = c_size_t(3), (c_double * 3)()
    calls = {
        "fmi2EnterEventMode": ("entering event mode", ()),
        "fmi2NewDiscreteStates": ("updating discrete states", (None,)),
        "fmi2EnterContinuousTimeMode": ("entering continuous-time mode", ()),
        "fmi2CompletedIntegratorStep": ("completing an integrator step", (1, byref(c_int()), byref(c_int()))),
        "fmi2SetTime": ("setting the time", (c_double(0),)),
        "fmi2SetContinuousStates": ("setting the states", (values, three)),
        "fmi2GetDerivatives": ("reading the states, their derivatives or nominals", (values, three)),
        "fmi2GetEventIndicators": ("reading event indicators", (values, c_size_t(0))),
        "fmi2GetContinuousStates": ("reading the states, their derivatives or nominals", (values, three)),
        "fmi2GetNominalsOfContinuousStates": ("reading the states, their derivatives or nominals", (values, three)),
    }
    for name, (what, arguments) in calls.items():
        logs.clear()
        assert getattr(dll, name)(component, *arguments) == ERROR
        assert [entry[2] for entry in logs] == [f"{what} is not allowed between steps"]
    motor.step(0.0, 1e-3)


def test_status_after_a_step_can_be_asked_for(motor: FmuInstance) -> None:
    fmi, value, terminated = motor.fmi, c_double(), c_int(1)
    motor.start()
    motor.step(0.0, 1e-3)
    fmi.fmi2GetRealStatus(fmi.component, 2, byref(value))
    fmi.fmi2GetBooleanStatus(fmi.component, 3, byref(terminated))
    assert value.value == 1e-3 and terminated.value == 0
    assert status(fmi.fmi2GetRealStatus, fmi.component, 0, byref(value)) == ERROR
    assert status(fmi.fmi2GetBooleanStatus, fmi.component, 0, byref(terminated)) == ERROR

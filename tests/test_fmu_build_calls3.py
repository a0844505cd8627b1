"""What the functions of a built FMU do in FMI 3.0, call by call: co-simulation; what validators do not look at."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator, Sequence
from ctypes import byref, c_bool, c_double, c_size_t, c_ubyte, c_uint, c_void_p
from typing import Any

import fmpy
import numpy as np
import pytest
from fmpy.fmi3 import FMU3Slave, fmi3LogMessageCallback
from numpy.typing import NDArray
from slaves import DISCARD, ERROR, OK, status

import fmu_build

OUTPUTS = ("i", "w", "angle")
OTHER = {"R": 0.921042, "K": 0.073472, "L": 0.007759, "J": 0.000136, "B": 0.000678}


class Third:
    """One co-simulation instance of FMI 3.0, with variables by name."""

    def __init__(
        self, folder: str, *, token: str | None = None, logs: list[tuple[int, str, str]] | None = None
    ) -> None:
        self.description = fmpy.read_model_description(folder)
        self.references = {v.name: v.valueReference for v in self.description.modelVariables}
        self.fmi: Any = FMU3Slave(
            guid=token or self.description.instantiationToken,
            unzipDirectory=folder,
            modelIdentifier=self.description.coSimulation.modelIdentifier,
            instanceName="motor",
        )

        def log(_environment: Any, status: int, category: bytes, message: bytes) -> None:
            if logs is not None:
                logs.append((status, category.decode(), message.decode()))

        self._log = fmi3LogMessageCallback(log)
        self.fmi.instantiate(loggingOn=logs is not None, logMessage=self._log)

    def set(self, **values: float) -> None:
        self.fmi.setFloat64([self.references[name] for name in values], list(values.values()))

    def get(self, *names: str) -> list[float]:
        return list(self.fmi.getFloat64([self.references[name] for name in names]))

    def start(self, *, time: float = 0.0, stop: float | None = None, **values: float) -> None:
        self.set(**values)
        self.fmi.enterInitializationMode(startTime=time, stopTime=stop)
        self.fmi.exitInitializationMode()

    def step(self, time: float, step: float) -> None:
        self.fmi.doStep(currentCommunicationPoint=time, communicationStepSize=step)

    def run(self, voltages: Sequence[float], *, step: float, start: float = 0.0) -> NDArray[np.float64]:
        rows = []
        for k, voltage in enumerate(voltages):
            self.set(v=voltage)
            self.step(start + k * step, step)
            rows.append(self.get(*OUTPUTS))
        return np.array(rows)


@pytest.fixture(scope="module", params=["dc_motor", "dc_motor_friction"])
def folder(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    output = tmp_path_factory.mktemp("third") / "motor.fmu"
    folder = fmpy.extract(str(fmu_build.build(request.param, output=output, fmi=3)))
    yield folder
    shutil.rmtree(folder)


@pytest.fixture
def make(folder: str) -> Iterator[Callable[..., Third]]:
    made: list[Third] = []

    def instance(**keywords: Any) -> Third:
        made.append(Third(folder, **keywords))
        return made[-1]

    yield instance
    for one in made:
        one.fmi.fmi3FreeInstance(one.fmi.component)


@pytest.fixture
def motor(make: Callable[..., Third]) -> Third:
    return make()


def voltages(count: int, *, seed: int = 1) -> list[float]:
    return list(np.random.default_rng(seed).uniform(-24, 24, count))


def test_reset_is_as_freshly_instantiated(make: Callable[..., Third], motor: Third) -> None:
    names = list(motor.references)
    motor.start(stop=0.1, **OTHER, load=0.01, i=1.0)
    motor.run(voltages(50), step=1e-3)
    motor.fmi.reset()
    fresh = make()
    assert motor.get(*names) == fresh.get(*names)
    motor.start()
    fresh.start()
    assert np.array_equal(motor.run(voltages(150), step=1e-3), fresh.run(voltages(150), step=1e-3))


def test_instances_are_independent(make: Callable[..., Third]) -> None:
    one, two = make(), make()
    one.start()
    two.start(**OTHER)
    alone = np.hstack([one.run(voltages(30), step=1e-3), two.run(voltages(30, seed=2), step=2e-3)])
    for slave in (one, two):
        slave.fmi.reset()
    one.start()
    two.start(**OTHER)
    rows = []
    for k, (first, second) in enumerate(zip(voltages(30), voltages(30, seed=2), strict=True)):
        two.set(v=second)
        one.set(v=first)
        one.step(k * 1e-3, 1e-3)
        two.step(k * 2e-3, 2e-3)
        rows.append(one.get(*OUTPUTS) + two.get(*OUTPUTS))
    assert np.array_equal(rows, alone)


def test_parameters_may_be_set_before_in_and_after_initialisation(motor: Third) -> None:
    def run(set_when: str) -> list[float]:
        motor.fmi.reset()
        if set_when == "before":
            motor.set(**OTHER)
        motor.fmi.enterInitializationMode()
        if set_when == "in":
            motor.set(**OTHER)
        motor.fmi.exitInitializationMode()
        if set_when == "after":
            motor.set(**OTHER)
        assert motor.get(*OTHER) == list(OTHER.values())
        motor.set(v=12.0)
        motor.step(0.0, 1e-3)
        return motor.get(*OUTPUTS)

    assert run("before") == run("in") == run("after")


def test_seven_short_steps_are_one_long_step(motor: Third) -> None:
    held = voltages(40)
    motor.start(**OTHER)
    long = motor.run(held, step=7e-3)
    motor.fmi.reset()
    motor.start(**OTHER)
    short = motor.run(list(np.repeat(held, 7)), step=1e-3)[6::7]
    assert np.all(np.abs(long - short) <= 1e-11 * np.abs(long).max(axis=0))


def test_restored_and_serialised_states_repeat_themselves_to_the_bit(make: Callable[..., Third], motor: Third) -> None:
    motor.start(**OTHER)
    motor.run(voltages(20), step=1e-3)
    state = motor.fmi.getFMUState()
    serialised = motor.fmi.serializeFMUState(state)
    first = motor.run(voltages(20, seed=2), step=1e-3, start=0.02)
    motor.set(R=1.0, load=0.1)
    motor.run(voltages(20, seed=3), step=3e-3, start=0.04)
    motor.fmi.terminate()
    motor.fmi.setFMUState(state)
    assert motor.get("time") == [19 * 1e-3 + 1e-3]
    assert np.array_equal(motor.run(voltages(20, seed=2), step=1e-3, start=0.02), first)
    other = make()
    other.fmi.setFMUState(other.fmi.deserializeFMUState(serialised))
    assert np.array_equal(other.run(voltages(20, seed=2), step=1e-3, start=0.02), first)
    motor.fmi.freeFMUState(state)


@pytest.mark.parametrize(
    "damage",
    [
        pytest.param(lambda s: s[:-1], id="too short"),
        pytest.param(lambda s: b"", id="empty"),
        pytest.param(lambda s: b"x" + s[1:], id="another token"),
        pytest.param(lambda s: s[:-1] + b"\xff", id="no such phase"),
    ],
)
def test_serialised_state_that_is_not_of_this_fmu_is_an_error(motor: Third, damage: Callable[[bytes], bytes]) -> None:
    motor.start()
    wrong = damage(bytes(motor.fmi.serializeFMUState(motor.fmi.getFMUState())))
    fmi, state = motor.fmi, c_void_p()
    buffer = (c_ubyte * max(len(wrong), 1))(*wrong)
    assert status(fmi.fmi3DeserializeFMUState, fmi.component, buffer, len(wrong), byref(state)) == ERROR
    assert state.value is None


@pytest.mark.parametrize("value", [0.0, -1.0, 1e7, float("nan"), float("inf")])
def test_parameter_out_of_range_is_discarded_and_nothing_is_set(motor: Third, value: float) -> None:
    for prepare in (lambda: None, motor.start, lambda: motor.step(0.0, 1e-3)):
        prepare()
        before = motor.get("K", "R", "J")
        assert status(motor.set, K=0.07, R=value, J=1e-4) == DISCARD
        assert motor.get("K", "R", "J") == before


@pytest.mark.parametrize("step", [0.0, -1e-3, float("nan"), float("inf")])
def test_step_that_is_not_positive_is_an_error(motor: Third, step: float) -> None:
    motor.start()
    motor.step(0.0, 1e-3)
    before = motor.get(*OUTPUTS)
    assert status(motor.step, 1e-3, step) == ERROR
    assert motor.get(*OUTPUTS) == before


def test_step_past_the_stop_time_is_an_error(motor: Third) -> None:
    motor.start(stop=0.01)
    motor.run([1.0] * 10, step=1e-3)
    assert status(motor.step, 0.01, 1e-3) == ERROR
    motor.fmi.reset()
    assert status(motor.start, time=1.0, stop=0.5) == ERROR


def test_calls_out_of_order_are_errors(motor: Third) -> None:
    fmi = motor.fmi
    assert status(motor.step, 0.0, 1e-3) == ERROR
    assert status(fmi.exitInitializationMode) == ERROR
    assert status(fmi.terminate) == ERROR
    motor.start()
    assert status(fmi.enterInitializationMode) == ERROR
    assert status(motor.set, i=1.0) == ERROR
    fmi.terminate()
    assert status(motor.step, 0.0, 1e-3) == ERROR
    assert status(motor.set, v=1.0) == ERROR
    assert motor.get(*OUTPUTS) == [0.0, 0.0, 0.0]


def test_step_says_what_fmi_wants_to_know(motor: Third) -> None:
    motor.start(time=5.0)
    answers, last = [c_bool(True) for _ in range(3)], c_double()
    code = motor.fmi.fmi3DoStep(
        motor.fmi.component, 5.0, 1e-3, True, *(byref(answer) for answer in answers), byref(last)
    )
    assert code == OK and not any(answer.value for answer in answers) and last.value == 5.0 + 1e-3


def test_values_references_and_types_that_do_not_fit_are_errors(motor: Third) -> None:
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


def test_wrong_token_gives_no_instance_and_a_log_line(make: Callable[..., Third]) -> None:
    logs: list[tuple[int, str, str]] = []
    with pytest.raises(Exception, match="Failed to instantiate"):
        make(token="{00000000-0000-0000-0000-000000000000}", logs=logs)
    assert [entry[:2] for entry in logs] == [(ERROR, "logStatusError")] and "wrong instantiation token" in logs[0][2]


def test_log_is_silent_unless_asked_for_and_heeds_categories(make: Callable[..., Third]) -> None:
    logs: list[tuple[int, str, str]] = []
    motor = make(logs=logs)

    def fail() -> list[str]:
        logs.clear()
        assert status(motor.set, R=-1.0) == DISCARD
        assert status(motor.fmi.terminate) == ERROR
        return [entry[1] for entry in logs]

    both = ["logStatusDiscard", "logStatusError"]
    assert fail() == both
    motor.fmi.setDebugLogging(False, [])
    assert fail() == []
    for category in both:
        motor.fmi.setDebugLogging(True, [category])
        assert fail() == [category]
    motor.fmi.setDebugLogging(True, ["logAll"])
    assert fail() == both
    assert status(motor.fmi.setDebugLogging, True, ["logEverything"]) == ERROR


def test_calls_without_an_instance_and_what_is_not_offered_are_errors(motor: Third) -> None:
    dll = motor.fmi.dll
    for name in ("Reset", "ExitInitializationMode", "Terminate", "EnterEventMode", "EnterStepMode"):
        assert getattr(dll, f"fmi3{name}")(None) == ERROR
    assert dll.fmi3GetFloat64(None, None, c_size_t(0), None, c_size_t(0)) == ERROR
    motor.start()
    component = c_void_p(motor.fmi.component)
    for name in ("EnterStepMode", "EnterConfigurationMode", "ExitConfigurationMode", "EnterEventMode"):
        assert getattr(dll, f"fmi3{name}")(component) == ERROR
    motor.step(0.0, 1e-3)

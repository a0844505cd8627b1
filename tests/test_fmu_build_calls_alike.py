"""What the functions of a built FMU do alike in FMI 2.0 and 3.0, call by call; what validators do not look at."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from fmu_instances import DISCARD, ERROR, FmuInstance, Opened, status

import fmu_build

pytestmark = pytest.mark.usefixtures("compiled_quickly")

OUTPUTS = ("i", "w", "angle")
OTHER = {"R": 0.921042, "K": 0.073472, "L": 0.007759, "J": 0.000136, "B": 0.000678}
BUILT = [("dc_motor", 2), ("dc_motor", 3), ("dc_motor_friction", 3)]


@pytest.fixture(scope="module", params=BUILT, ids=lambda built: f"{built[0]}, FMI {built[1]}")
def opened(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Opened]:
    model, version = request.param
    output = tmp_path_factory.mktemp("alike") / "motor.fmu"
    with Opened(fmu_build.build(model, output=output, fmi=version)) as opened:
        yield opened


@pytest.fixture
def motor(opened: Opened) -> FmuInstance:
    return opened.instance()


def drive(count: int, *, seed: int = 1) -> dict[str, list[float]]:
    return {"v": list(np.random.default_rng(seed).uniform(-24, 24, count))}


def test_reset_is_as_freshly_instantiated(opened: Opened, motor: FmuInstance) -> None:
    names = list(motor.references)
    motor.start(stop=0.1, **OTHER, load=0.01, i=1.0)
    motor.run(drive(50), OUTPUTS, step=1e-3)
    motor.fmi.reset()
    fresh = opened.instance()
    assert motor.get(*names) == fresh.get(*names)
    for instance in (motor, fresh):
        instance.start()
    used, new = (instance.run(drive(150), OUTPUTS, step=1e-3) for instance in (motor, fresh))  # past the old stop
    assert np.array_equal(used, new)


def test_instances_are_independent(opened: Opened) -> None:
    one, two = opened.instance(), opened.instance()
    one.start()
    two.start(**OTHER)
    alone = [one.run(drive(30), OUTPUTS, step=1e-3), two.run(drive(30, seed=2), OUTPUTS, step=2e-3)]
    for instance in (one, two):
        instance.fmi.reset()
    one.start()
    two.start(**OTHER)
    rows = []
    for k, (first, second) in enumerate(zip(drive(30)["v"], drive(30, seed=2)["v"], strict=True)):
        one.set(v=first)
        two.set(v=second)
        two.step(k * 2e-3, 2e-3)
        one.step(k * 1e-3, 1e-3)
        rows.append(one.get(*OUTPUTS) + two.get(*OUTPUTS))
    assert np.array_equal(rows, np.hstack(alone))


def test_parameters_may_be_set_before_in_and_after_initialisation(motor: FmuInstance) -> None:
    def run(set_when: str) -> list[float]:
        motor.fmi.reset()
        if set_when == "before":
            motor.set(**OTHER)
        motor.enter()
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


@pytest.mark.parametrize("value", [0.0, -1.0, 1e7, float("nan"), float("inf"), float("-inf")])
def test_parameter_out_of_range_is_discarded_and_nothing_is_set(motor: FmuInstance, value: float) -> None:
    for prepare in (lambda: None, motor.start, lambda: motor.step(0.0, 1e-3)):
        prepare()
        before = motor.get("K", "R", "J")
        assert status(motor.set, K=0.07, R=value, J=1e-4) == DISCARD
        assert motor.get("K", "R", "J") == before
    motor.step(1e-3, 1e-3)


@pytest.mark.parametrize("step", [0.0, -1e-3, float("nan"), float("inf")])
def test_step_that_is_not_positive_is_an_error(motor: FmuInstance, step: float) -> None:
    motor.start()
    motor.step(0.0, 1e-3)
    before = motor.get(*OUTPUTS)
    assert status(motor.step, 1e-3, step) == ERROR
    assert motor.get(*OUTPUTS) == before


def test_step_past_the_stop_time_is_an_error(motor: FmuInstance) -> None:
    motor.start(stop=0.01)
    motor.run(drive(10), OUTPUTS, step=1e-3)
    before = motor.get(*OUTPUTS)
    assert status(motor.step, 0.01, 1e-3) == ERROR
    assert motor.get(*OUTPUTS) == before
    motor.fmi.reset()
    motor.start(stop=0.01)
    assert status(motor.step, 0.0, 0.0101) == ERROR
    motor.step(0.0, 0.01)
    motor.fmi.reset()
    assert status(motor.start, time=1.0, stop=0.5) == ERROR


def test_calls_out_of_order_are_errors(motor: FmuInstance) -> None:
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


def test_restored_and_serialised_states_repeat_themselves_to_the_bit(opened: Opened, motor: FmuInstance) -> None:
    def go_on(instance: FmuInstance) -> np.ndarray:
        return instance.run(drive(20, seed=2), OUTPUTS, step=1e-3, start=0.02)

    motor.start(**OTHER)
    motor.run(drive(20), OUTPUTS, step=1e-3)
    state = motor.fmi.getFMUState()
    serialised = motor.fmi.serializeFMUState(state)
    first = go_on(motor)
    motor.set(R=1.0, load=0.1)
    motor.run(drive(20, seed=3), OUTPUTS, step=3e-3, start=0.04)
    motor.fmi.terminate()
    motor.fmi.setFMUState(state)
    if "time" in motor.references:  # a variable of its own in FMI 3.0
        assert motor.get("time") == [19 * 1e-3 + 1e-3]
    assert np.array_equal(go_on(motor), first)
    for restored in (lambda other: state, lambda other: other.restored(serialised)):
        other = opened.instance()  # not even initialised
        other.fmi.setFMUState(restored(other))
        assert np.array_equal(go_on(other), first)
    motor.fmi.freeFMUState(state)


def test_wrong_guid_or_token_gives_no_instance_and_a_log_line(opened: Opened) -> None:
    logs: list[tuple[int, str, str]] = []
    with pytest.raises(Exception, match="Failed to instantiate"):
        opened.instance(guid="{00000000-0000-0000-0000-000000000000}", logs=logs)
    assert [entry[:2] for entry in logs] == [(ERROR, "logStatusError")]
    assert any(words in logs[0][2] for words in ("wrong GUID", "wrong instantiation token"))


def test_log_is_silent_unless_asked_for_and_heeds_categories(opened: Opened) -> None:
    logs: list[tuple[int, str, str]] = []
    motor = opened.instance(logs=logs)
    fmi = motor.fmi

    def fail() -> list[tuple[int, str]]:
        logs.clear()
        assert status(motor.set, R=-1.0) == DISCARD
        assert status(fmi.terminate) == ERROR
        return [entry[:2] for entry in logs]

    both = [(DISCARD, "logStatusDiscard"), (ERROR, "logStatusError")]
    assert fail() == both
    assert logs[0][2] == "R = -1 Ohm is not within 1e-06 and 1e+06"
    assert logs[1][2] == "termination is not allowed before initialisation"
    fmi.setDebugLogging(False, [])
    assert fail() == []
    for entry in both:
        fmi.setDebugLogging(True, [entry[1]])
        assert fail() == [entry]
    for every in (["logAll"], []):
        fmi.setDebugLogging(True, every)
        assert fail() == both
    assert status(fmi.setDebugLogging, True, ["logEverything"]) == ERROR

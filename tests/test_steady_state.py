import numpy as np
import pytest
from motors import CML050, RMCS2004, step_recording

from estimator.motor.steady_state import SteadyState, last_samples


@pytest.mark.parametrize("motor", [RMCS2004, CML050], ids=lambda m: m.name)
def test_the_relations_give_back_the_motor(motor):
    signals = step_recording(motor, lead=0.1, duration=1.5).signals
    state = last_samples(signals["voltage"], signals["current"], signals["speed"])
    K = np.array([motor.K])
    assert state.resistance(K)[0] == pytest.approx(motor.R, rel=1e-9)
    assert state.friction(K)[0] == pytest.approx(motor.B, rel=1e-9)
    assert state.constant(np.array([motor.R]))[0] == pytest.approx(motor.K, rel=1e-9)


def test_last_samples_average_five_and_skip_the_missing():
    v = np.full(10, 2.0)
    i = np.arange(10.0)
    w = np.where(np.arange(10) == 9, np.nan, 4.0)
    assert last_samples(v, i, w) == SteadyState(2.0, 7.0, 4.0)


def test_the_feasible_constant_is_where_all_three_lie_in_their_bounds():
    state = SteadyState(10.5, 0.61, 176.0)
    low, high = state.feasible_constant(R=(0.01, 5.0), K=(0.005, 0.1), B=(1e-5, 1e-3))
    for K, inside in ((low * 1.0001, True), (high * 0.9999, True), (low * 0.999, False), (high * 1.001, False)):
        R, B = float(state.resistance(np.array(K))), float(state.friction(np.array(K)))
        assert (0.01 <= R <= 5 and 0.005 <= K <= 0.1 and 1e-5 <= B <= 1e-3) is inside


def test_no_constant_is_feasible_when_the_bounds_exclude_the_motor():
    assert SteadyState(10.5, 0.61, 176.0).feasible_constant(R=(0.01, 5.0), K=(0.2, 0.3), B=(1e-5, 1e-3)) is None


@pytest.mark.parametrize(
    ("state", "usable"),
    [
        (SteadyState(10.5, 0.6, 170.0), True),
        (SteadyState(-10.5, -0.6, -170.0), True),
        (SteadyState(10.5, -0.6, 170.0), False),
        (SteadyState(10.5, 0.6, 0.0), False),
        (SteadyState(10.5, float("nan"), 170.0), False),
    ],
)
def test_a_steady_state_is_usable_when_current_and_speed_follow_the_voltage(state, usable):
    assert state.is_usable is usable

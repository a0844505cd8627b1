"""Changes of a command that come late, each by its own, seen by the speed alone."""

import numpy as np
import pytest

from estimator import estimate_parameters, simulate_fmu
from estimator.cases.case import Case, OutputSpec
from estimator.estimating.estimate import estimate_recordings
from estimator.fitting.latency import with_latencies
from estimator.fmus.probe import bundled_model
from estimator.plans.planning import plan_case
from estimator.recordings.reading import recording_from_arrays

pytestmark = pytest.mark.usefixtures("shared_workers")

CASE = Case(inputs={"v": "voltage"}, outputs={"w": OutputSpec("speed")})
R, K, J, B = 2.0, 0.05, 2e-5, 1e-5
LEVELS = (0.0, 3.0, 0.0, 6.0, 0.0, 9.0, 0.0, 12.0, 0.0)
H, HELD = 1e-3, 600


def speed_of(late, seed, coasts=False, friction=0.0):
    """Return a recording of the speed, whose changes of the command come so many s late; 1 rad/s a count."""
    command = np.repeat(LEVELS, HELD)
    t = H * np.arange(len(command))
    parts = 20
    edges = HELD * H * np.arange(1, len(LEVELS)) + late
    w, shown = 0.0, np.empty(len(t))
    fine = np.array(LEVELS)[np.searchsorted(edges, H / parts * np.arange(parts * len(t)), side="right")]
    for k, v in enumerate(fine):
        if k % parts == 0:
            shown[k // parts] = w
        current = 0.0 if coasts and v == 0 else (v - K * w) / R
        torque = K * current - B * w
        if w > 0 or abs(torque) > friction:
            w = w + H / parts / J * (torque - friction)
            w = 0.0 if w < 0 else w
    noise = np.random.default_rng(seed).normal(0, 1.5, len(t)) * (shown > 0)
    return recording_from_arrays("bench", t, {"voltage": command, "speed": np.round(shown + noise)})


def told_by(recording):
    """Return what is noted of changes that come late, each by its own."""
    return with_latencies(plan_case(CASE, bundled_model("dc_motor"), recordings=[recording]))[1]


def test_changes_that_come_late_are_told_by_the_speed_alone():
    """Public recordings of a Simulink target come 40 to 260 ms late: two had fits of 26 and 48 %, one was refused."""
    late = np.random.default_rng(1).uniform(0.04, 0.26, len(LEVELS) - 1)
    result = estimate_recordings([CASE], [[speed_of(late, 1)]], workers=1)[0]
    assert any("each by its own" in note for note in result.notes), result.notes
    per_volt, slow = result.derived["speed_per_volt"], result.derived["slow_time_constant"]
    for found, true in ((per_volt, K / (K**2 + R * B)), (slow, J * R / (K**2 + R * B))):
        assert abs(found.value - true) < 4.5 * found.uncertainty < 0.05 * true, (found, true, result.reasons)


@pytest.mark.parametrize("seed", [0, *(pytest.param(k, marks=pytest.mark.full) for k in (1, 2))])
@pytest.mark.parametrize("kind", [{}, {"coasts": True}, {"friction": 0.02}, {"coasts": True, "friction": 0.02}])
def test_a_motor_that_stops_slowly_is_not_late(kind, seed):
    """One that coasts takes longer to stand than to run, by friction less the faster it was."""
    assert told_by(speed_of(np.full(len(LEVELS) - 1, 0.05), seed, **kind)) == ()


@pytest.mark.parametrize(
    "late", [(29.3, 35.1), *(pytest.param(late, marks=pytest.mark.full) for late in ((29.3, 29.3), (3.2, 8.7)))]
)
def test_an_edge_is_late_by_its_own_though_the_current_still_settles_before_it(late):
    """Of 36 V and back nothing was told of an outside motor: the current fell by half while the second edge waited."""
    motor = {"R": 1.37, "K": 0.164, "L": 1.3e-3, "J": 2e-4, "B": 1.2e-3}
    fine, rows = 20, 212
    edges = fine * (np.array([50, 128]) + late)
    v = 36.0 * ((np.arange(rows * fine) >= edges[0]) & (np.arange(rows * fine) < edges[1]))
    motion = simulate_fmu("dc_motor", times=H / fine * np.arange(rows * fine), inputs={"v": v}, parameters=motor)
    rng = np.random.default_rng(3)
    command = 36.0 * ((np.arange(rows) >= 50) & (np.arange(rows) < 128))
    i, w = motion["i"][::fine] + rng.normal(0, 0.015, rows), motion["w"][::fine] + rng.normal(0, 0.2, rows)
    result = estimate_parameters(time=H * np.arange(rows), v=command, i=i, w=w, workers=1)
    off = [abs(result.parameters[n].value - x) / result.parameters[n].uncertainty for n, x in motor.items()]
    assert result.verdict == "ok" and max(off) < 4.5, (off, result.reasons)
    assert any("each by its own" in note for note in result.notes) == (late[0] != late[1])

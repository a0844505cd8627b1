"""A drive that lets no current flow back: found and harmless, doubted where it is not known, not found elsewhere."""

import numpy as np
import pytest
from driven_motor import DrivenMotor

from estimator.cases.case import Case, OutputSpec
from estimator.estimating.estimate import estimate_recordings
from estimator.recordings.reading import recording_from_arrays

pytestmark = pytest.mark.usefixtures("shared_workers")

CASE = Case(inputs={"v": "voltage"}, outputs={"i": OutputSpec("current"), "w": OutputSpec("speed")})
TRUE = {"R": 3.1363, "K": 0.048774, "L": 0.01307, "J": 9e-6, "B": 1.69e-4}
SLOW = {"R": 1.2, "K": 0.05, "L": 0.0025, "J": 6e-5, "B": 5e-5}


def estimated(motor, levels, rows=400, **drive):
    v = np.repeat(np.array(levels, dtype=float), rows)
    shown = DrivenMotor({**motor, **drive}).response(v, np.zeros(len(v)), step=1e-3)[:-1, :2]
    i, w = np.vstack([np.zeros((1, 2)), shown]).T
    rng = np.random.default_rng(7)
    columns = {
        "voltage [V]": v,
        "current [A]": i + 0.01 * rng.standard_normal(len(v)),
        "speed [rad/s]": w + 0.5 * rng.standard_normal(len(v)),
    }
    recording = recording_from_arrays("one way", np.arange(len(v)) * 1e-3, columns)
    return estimate_recordings([CASE], [[recording]], workers=1)[0]


def is_right(found, motor):
    """Whether no parameter is further off than 5 standard errors: of normal errors 1 in 300 000."""
    return all(abs(found.parameters[n].value - motor[n]) < 5 * found.parameters[n].standard_error for n in motor)


@pytest.mark.parametrize(
    ("motor", "levels"),
    [
        (TRUE, (0, 10, 4)),
        *(pytest.param(*case, marks=pytest.mark.full) for case in ((TRUE, (0, 5, 10, 3)), (SLOW, (0, 4, 10, 5, 0)))),
    ],
)
def test_a_current_that_never_flows_back_is_found_and_harmless(motor, levels):
    found = estimated(motor, levels, one_way=1.0)
    assert found.verdict == "ok" and set(found.effects) == {"one-way current"} and is_right(found, motor)
    assert "the drive lets no current flow back: the motor coasts where it is faster than its command" in found.notes


@pytest.mark.full  # two seconds
def test_beside_a_brush_drop():
    found = estimated(SLOW, (0, 5, 10, 3), one_way=1.0, brush=0.5)
    assert set(found.effects) == {"one-way current", "brush drop"} and is_right(found, SLOW)


@pytest.mark.full  # ten seconds
def test_a_current_that_never_flows_back_is_doubted_where_that_is_not_known(monkeypatch):
    monkeypatch.setenv("FMU_ESTIMATOR_WITHOUT", "one-way current")
    assert estimated(TRUE, (0, 10, 4), rows=100, one_way=1.0).verdict != "ok"


@pytest.mark.full  # a motor that coasts and one that brakes: test_odd_drives.py
def test_a_bridge_brakes_and_an_open_circuit_is_open_at_once():
    assert estimated(TRUE, (0, 10, 4)).effects == ()
    assert set(estimated(TRUE, (0, 10, 0), coasts=1.0).effects) == {"coasting"}

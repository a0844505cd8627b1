"""Recordings of many rows: what is found of them, and that it is what shorter ones say."""

import numpy as np
import pytest
from effect_bench import NOISE, TRUE

from estimator.cases.case import Case, OutputSpec
from estimator.estimating.estimate import estimate_recordings
from estimator.fmus.simulate import simulate
from estimator.plans.part import LONG
from estimator.recordings.recording import recording_from_arrays

pytestmark = pytest.mark.usefixtures("shared_workers")

CASE = Case(inputs={"v": "voltage"}, outputs={"i": OutputSpec("current"), "w": OutputSpec("speed")})
STEP, ROWS = 1e-3, LONG + 6_000


def switched(rows=ROWS, *, lost=(), seed=0, i=lambda y, t: y, w=lambda y, t: y):
    """Return a recording of a motor that is switched on and off every second; some rows are not logged."""
    times = np.arange(rows + len(lost)) * STEP
    v = np.where(times % 2.0 < 1.0, 0.0, 10.5)
    shown = simulate("dc_motor", parameters=TRUE, inputs={"v": v}, times=times)
    rng = np.random.default_rng(seed)
    logged = np.delete(np.arange(len(times)), lost)
    columns = {"voltage [V]": v[logged]}
    for header, name, act in (("current [A]", "i", i), ("speed [rad/s]", "w", w)):
        columns[header] = (act(shown[name], times) + NOISE[name] * rng.standard_normal(len(times)))[logged]
    return recording_from_arrays("long", times[:rows], columns)


def run(recording):
    return estimate_recordings([CASE], [[recording]], workers=1)[0]


def test_rows_that_a_long_recording_lost_are_found_where_they_are():
    result = run(switched(lost=range(11_020, 11_026)))
    assert any("lost rows at t = 11.0" in reason for reason in result.reasons), (result.effects, result.reasons)

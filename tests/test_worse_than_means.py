"""What to do where a model explains an output worse than its mean does."""

import numpy as np
import pytest

from estimator.cases.case import Case, OutputSpec
from estimator.fmus.probe import bundled_model
from estimator.judging.worse_than_means import describes_nothing, worse_than_means
from estimator.plans.planning import plan_case
from estimator.recordings.reading import recording_from_arrays

CASE = Case(inputs={"v": "voltage"}, outputs={"w": OutputSpec("speed")})
HELD = "name under [parameters] what the FMU holds at its own value, gear, stiffness, damping, J_load, B_load; or check"


@pytest.mark.parametrize(
    ("fmu", "says_so"), [("dc_motor_geared", True), ("dc_motor", False), ("dc_motor_drive", False)]
)
def test_what_an_fmu_holds_that_nobody_named_comes_first(fmu, says_so):
    """A geared motor of another stiffness and load was told to check its columns, units and clock."""
    times = 1e-3 * np.arange(100)
    columns = {"voltage [V]": np.where(times >= 0.02, 12.0, 0.0), "speed [rad/s]": 100 * times}
    plan = plan_case(CASE, bundled_model(fmu), recordings=[recording_from_arrays("bench", times, columns)])
    off, noise, spread = np.array([4.5]), np.array([0.1]), np.array([1.9])
    sentences = [*worse_than_means(plan, off, noise, spread), *describes_nothing(plan, off, noise, spread, held=())]
    assert [HELD in sentence for sentence in sentences] == [says_so, says_so], sentences
    assert not worse_than_means(plan, noise, noise, spread)

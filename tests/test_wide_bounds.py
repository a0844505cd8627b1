"""A value that is a small part of the width of its bounds is told like any other."""

import numpy as np
import pytest
from fine_motor import FINE, MOTOR, bench

from estimator import estimate_parameters

pytestmark = pytest.mark.usefixtures("shared_workers")


def test_a_value_far_below_the_width_of_its_bounds_is_not_at_the_lower_one():
    """B = 0 to 10 N.m.s/rad: it was "at its lower bound 0, not identified", though it is known to 1 %."""
    command = np.repeat([0.0, 5.0, 9.0], [100, 400, 400])
    recording = bench(command, np.repeat(command, FINE), 1)
    usual = estimate_parameters(recording, workers=1)
    wide = estimate_parameters(recording, workers=1, bounds={"B": (0.0, 10.0)})
    assert wide.verdict == usual.verdict == "ok", wide.reasons
    b = wide.parameters["B"]
    assert b.at_bound is None and abs(b.value - MOTOR["B"]) < 4.5 * b.standard_error
    for name, found in usual.parameters.items():
        assert wide.parameters[name].value == pytest.approx(found.value, abs=0.1 * found.standard_error)
        assert wide.parameters[name].standard_error == pytest.approx(found.standard_error, rel=0.1)

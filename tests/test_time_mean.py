"""A current whose converter takes its mean over a time that is no number of rows, as sigma-delta ones do."""

import numpy as np
import pytest
from effect_bench import FINE, recording, worst
from scipy.signal import lfilter

from estimator import estimate_parameters

pytestmark = pytest.mark.usefixtures("shared_workers")


def mean_over(tenths):
    """Return what shows a signal at tenths of a row as its mean over so many, by trapezia."""
    weights = np.r_[0.5, np.ones(tenths - 1), 0.5] / tenths
    return lambda y: lfilter(weights, [1.0], y)


OTHERS = [(e, n) for e in ("two levels", "reversal") for n in (0.7, 1.6, 6.5)]


@pytest.mark.parametrize(
    ("excitation", "rows"), [("reversal", 3.3), *(pytest.param(*other, marks=pytest.mark.full) for other in OTHERS)]
)
def test_a_mean_over_a_time_is_told_as_one(excitation, rows):
    """It was told as a mean of samples and a lag or a ramp beside it: L far off, and in one bench R by half, ok."""
    found = estimate_parameters(recording(excitation, 1, i=mean_over(round(rows * FINE))), workers=1)
    assert worst(found) < 5, (worst(found), found.effects, found.reasons)  # of 1.6 rows a filter does nearly the same
    if rows > 3 and found.verdict == "ok":
        assert "time mean" in found.effects, found.effects
        assert found.chain["time mean of i"].value == pytest.approx(rows * 1e-3, rel=0.03)
    assert rows != 3.3 or found.verdict == "ok", found.reasons

"""The score test of further responses (response_test.py): its false alarms, and filters that no effect names."""

import dataclasses

import numpy as np
import pytest
from effect_bench import butterworth, recording, worst

from estimator.cases.case import Case, OutputSpec
from estimator.estimating.estimate import estimate_recordings
from estimator.explaining import explained
from estimator.explaining.response_test import unexplained_responses

pytestmark = pytest.mark.usefixtures("shared_workers")

CASE = Case(inputs={"v": "voltage"}, outputs={"i": OutputSpec("current"), "w": OutputSpec("speed")})
DRAWS, CHANCE = 400, 0.05


def test_its_false_alarms_are_as_many_as_asked(monkeypatch):
    """Of 400 draws 3 tests with a chance of 0.05 in all fail in 12 to 20 on average: above 44 by less than 1e-5."""
    fits, original = [], explained.adequacy
    monkeypatch.setattr(explained, "adequacy", lambda fit, p: (fits.append(fit), original(fit, p))[1])
    result = estimate_recordings([CASE], [[recording("two levels")]], workers=1)[0]
    assert result.verdict == "ok", result.reasons
    fit, rng = fits[-1], np.random.default_rng(1)
    present = fit.whitener.present.ravel()
    failed = 0
    for _ in range(DRAWS):
        z = np.where(present, rng.standard_normal(fit.z.size), 0.0)
        failed += bool(unexplained_responses(dataclasses.replace(fit, z=z), CHANCE, (0, 1)))
    assert 1 <= failed <= 44


STANDS_IN = pytest.mark.xfail(
    reason="a mean over a time, or a limit, stands in: of four seeds two are ok, 4.7 and 6.6 off"
)


@pytest.mark.parametrize(
    ("channel", "tau"), [pytest.param("i", 1e-3, marks=[pytest.mark.full, STANDS_IN]), ("w", 2e-3)]
)
def test_a_filter_that_no_effect_names_is_doubted_where_its_stand_in_shows(monkeypatch, channel, tau):
    """Lags, means and delays stand for a Butterworth low-pass so well that every other test of the residuals passes."""
    monkeypatch.setenv("FMU_ESTIMATOR_WITHOUT", "Butterworth low-pass")
    shown = recording("reversal", **{channel: lambda y: butterworth(y, tau)})
    result = estimate_recordings([CASE], [[shown]], workers=1)[0]
    assert result.verdict == "doubtful" and worst(result) < 4.5
    told = (f"{channel} answers to changes", "come 1.24 ms before the input")  # a delay that no clock makes
    assert any(words in reason for reason in result.reasons for words in told), result.reasons

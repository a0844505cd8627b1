"""Signals that firmware smooths from sample to sample, y[k] += a (x[k] - y[k])."""

import numpy as np
import pytest
from effect_bench import FINE, TRUE, H, recording, worst
from scipy.signal import lfilter

from estimator import estimate_parameters
from estimator.explaining.effects import smoothing

pytestmark = pytest.mark.usefixtures("shared_workers")


def smoothed(part):
    """Return what smooths the samples of a signal that is given at a tenth of a sample; between them it repeats."""

    def act(y):
        shown = y.copy()
        rows = lfilter([part], [1.0, part - 1.0], y[::FINE])
        for k in range(FINE):
            own = shown[k::FINE]
            own[:] = rows[: len(own)]
        return shown

    return act


@pytest.mark.parametrize(
    ("excitation", "part"),
    [("two levels", 0.2), ("two levels", 0.6), ("reversal", 0.4)],
)
def test_it_is_told_by_its_part_and_leaves_the_winding_right(excitation, part):
    result = estimate_parameters(recording(excitation, i=smoothed(part)), workers=1)
    assert result.verdict == "ok" and worst(result) < 4.5, result.reasons
    assert result.parameters["L"].standard_error < 0.15 * TRUE["L"]
    (told,) = [note for note in result.notes if note.startswith("i is smoothed from sample to sample")]
    found = float(told.split("moved by ")[1].split()[0])
    assert found == pytest.approx(part, abs=0.08)


@pytest.mark.parametrize("part", [0.2, 0.6])
def test_without_the_effect_it_is_doubted_or_within_the_errors(part, monkeypatch):
    monkeypatch.setenv("FMU_ESTIMATOR_WITHOUT", "smoothing")
    result = estimate_parameters(recording("reversal", i=smoothed(part)), workers=1)
    assert result.verdict == "doubtful" or worst(result) < 4.5


def test_it_is_not_told_where_there_is_none():
    result = estimate_parameters(recording("two levels"), workers=1)
    assert result.verdict == "ok" and not any("smoothing" in name for name in result.chain)


def test_a_sample_is_shown_as_the_recursion_has_it():
    y, tau = np.random.default_rng(1).standard_normal(50), 2.5 * H
    a = np.exp(-1 / 2.5)
    expected = [y[0]]
    for now in y[1:]:
        expected.append(a * expected[-1] + (1 - a) * now)
    assert np.allclose(smoothing.smoothed(y, tau, H)[1:], np.array(expected)[1:], atol=1e-12)

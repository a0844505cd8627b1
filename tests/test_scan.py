"""Channels that a converter takes one after the other: the last one shows what comes after the others."""

import numpy as np
import pytest
from effect_bench import EXCITATIONS, late, recording, worst

from estimator import estimate_parameters
from estimator.explaining.effects.scan import sampled_late

pytestmark = pytest.mark.usefixtures("shared_workers")


def test_the_effect_is_the_signal_that_comes():
    y = np.array([0.0, 1.0, 3.0, 3.0])
    assert sampled_late(y, 0.5e-3, 1e-3) == pytest.approx([0.5, 2.0, 3.0, 3.0])
    assert sampled_late(y, 0.0, 1e-3) == pytest.approx(y)


@pytest.mark.parametrize("excitation", EXCITATIONS)
@pytest.mark.parametrize("by", [0.2e-3, 0.4e-3])
def test_a_speed_that_is_sampled_behind_the_current_is_told_and_right(excitation, by):
    """It was told as eddy currents and a lag of the current, ok and L 11 bars off, or doubted."""
    result = estimate_parameters(recording(excitation, 1, w=lambda y: late(y, -by)), workers=1)
    assert result.verdict == "ok", result.reasons
    assert "scan" in result.effects
    assert worst(result) < 4.5
    assert result.chain["scan of w"].value == pytest.approx(by, abs=4.5 * result.chain["scan of w"].standard_error)


@pytest.mark.parametrize("excitation", ["step", "two levels"])
def test_without_it_none_is_told(excitation):
    for seed in range(3):
        assert "scan" not in estimate_parameters(recording(excitation, seed), workers=1).effects

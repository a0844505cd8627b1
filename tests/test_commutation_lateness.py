"""Powers of an order's wave at many latenesses: turned on from one to the next, the same as by interpolated angles."""

import numpy as np
import pytest

from estimator.explaining.effects.ripple_of_few_turns import _powers
from estimator.noise.clock import Clock


@pytest.mark.parametrize("n", [3, 20, 900])
@pytest.mark.parametrize(("about", "reach"), [(0.0, 8.0), (1 / 3, 0.5), (-7.67, 0.5)])
@pytest.mark.parametrize("jitter", [0.0, 0.3])
def test_a_wave_that_is_turned_on_has_the_powers_of_interpolated_angles(n, about, reach, jitter):
    rng, step = np.random.default_rng(n), 1e-3
    time = step * (np.arange(n) + jitter * rng.random(n))
    angle, weighted = np.cumsum(rng.random(n)), rng.standard_normal(n)
    clock = Clock(time, slice(0, n))
    tried = clock.step * (about + np.linspace(-reach, reach, 49))
    waves = [np.exp(1j * np.interp(time + late, time, angle)) for late in tried]
    right = np.array([abs(np.vdot(wave, weighted)) ** 2 for wave in waves])
    assert np.allclose(_powers(angle, clock, weighted, tried), right, rtol=0, atol=1e-11 * right.max())

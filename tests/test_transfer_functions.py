"""A motor from its sampled transfer functions: SciPy's logarithm, and the motors that were sampled."""

import numpy as np
import pytest
from motors import CML050, RMCS2004
from scipy.linalg import logm

from estimator.motor.state_space import sampled
from estimator.motor.transfer_functions import NoMotorError, continuous, motor_of


@pytest.mark.parametrize(
    "poles",
    [(0.9, 0.3), (0.999, 0.99), (0.5 + 0.4j, 0.5 - 0.4j), (-0.5 + 0.1j, -0.5 - 0.1j), (0.7 + 1e-6j, 0.7 - 1e-6j),
     (0.8, 0.8 + 2e-5), (0.8, 0.8 + 3e-4)],
)  # fmt: skip
def test_the_continuous_system_is_that_of_scipys_logarithm(poles):
    _, a1, a2 = np.real(np.poly(poles))
    whole = np.array([[-a1, -a2, 1.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    right = np.real(logm(whole)) / 1e-3
    a, g = continuous(whole[:2, :2], np.linalg.eigvals(whole[:2, :2]), 1e-3)
    assert np.allclose(a, right[:2, :2], rtol=0, atol=1e-7 * np.abs(right).max())
    assert np.allclose(g, right[:2, 2], rtol=0, atol=1e-7 * np.abs(right).max())


@pytest.mark.parametrize("motor", [CML050, RMCS2004])
@pytest.mark.parametrize("step", [1e-4, 1e-3, 6e-3])
def test_a_sampled_motor_is_found_again(motor, step):
    f, g = sampled(motor.parameters, step)
    a1, a2 = -np.trace(f), np.linalg.det(f)
    b = [g[:, 0], (f - np.trace(f) * np.eye(2)) @ g[:, 0]]
    found = motor_of(np.array([a1, a2, b[0][0], b[1][0], b[0][1], b[1][1]]), step)
    assert found == pytest.approx(motor.parameters, rel=1e-6)


@pytest.mark.parametrize(("poles", "said"), [((0.9, -0.1), "at or below zero"), ((1.0, 0.5), "a pole at one")])
def test_poles_that_no_motor_has_are_told(poles, said):
    _, a1, a2 = np.poly(poles)
    with pytest.raises(NoMotorError, match=said):
        motor_of(np.array([a1, a2, 0.1, 0.1, 0.1, 0.1]), 1e-3)

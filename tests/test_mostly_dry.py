"""A motor whose friction is nearly all dry, after one step: a speed that is shown late explains it as well."""

import numpy as np
import pytest

from estimator import estimate_parameters, simulate_fmu

pytestmark = pytest.mark.usefixtures("shared_workers")

MOTOR = {"R": 4.6, "K": 0.0247, "L": 0.02, "J": 2.6e-5, "B": 1.9e-6}
STEP, FINE, LINES = 5e-4, 10, 1024


@pytest.mark.parametrize("seed", [0, *(pytest.param(k, marks=pytest.mark.full) for k in (1, 2, 3))])
def test_both_are_told(seed):
    """Of an outside step a filter of the speed alone was told: ok, B 853 and J 162 standard errors off."""
    rows, rng = 3670, np.random.default_rng(seed)
    times = STEP / FINE * np.arange(rows * FINE)
    motion = simulate_fmu(
        "dc_motor_friction", times=times, inputs={"v": np.where(times >= 0.168, 3.0, 0.0)},
        parameters={**MOTOR, "friction": 1.49e-3},
    )  # fmt: skip
    angle = rng.uniform(0, 1) + np.cumsum(motion["w"]) * STEP / FINE * LINES / (2 * np.pi)
    counts = np.floor(angle[FINE - 1 :: FINE])
    w = np.diff(counts, prepend=counts[0]) * 2 * np.pi / LINES / STEP
    i = motion["i"][FINE - 1 :: FINE] + rng.normal(0, 0.004, rows)
    v = np.where(np.arange(rows) >= 186, 3.0, 0.0)
    result = estimate_parameters(time=STEP * np.arange(rows), v=v, i=i, w=w, workers=1)
    assert result.verdict == "doubtful" and any("dry friction" in reason for reason in result.reasons), result.reasons
    off = {n: (result.parameters[n].value - x) / result.parameters[n].uncertainty for n, x in MOTOR.items()}
    assert max(map(abs, off.values())) < 4.5, off

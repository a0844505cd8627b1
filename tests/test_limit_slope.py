"""A drive whose current limit gives way, as foldback does."""

import numpy as np
import pytest

from estimator import estimate_parameters, simulate_fmu

pytestmark = pytest.mark.usefixtures("shared_workers")

MOTOR = {"R": 5.6, "K": 0.0108, "L": 4e-4, "J": 4.2e-7, "B": 2.8e-7}
TIMES = 2e-4 * np.arange(2500)
VOLTAGES = {
    "reversal": np.select([TIMES < 0.02, TIMES < 0.25], [0.0, 11.0], -11.0),
    "two levels": np.select([TIMES < 0.02, TIMES < 0.25], [0.0, 6.0], 11.0),
}


@pytest.mark.parametrize(
    ("excitation", "slope"),
    [("reversal", 20), *(pytest.param(*case, marks=pytest.mark.full) for case in (("two levels", 5), ("reversal", 5)))],
)
def test_a_limit_that_gives_way_is_told_and_the_motor_is_right(excitation, slope):
    """Its plateau falls while the motor gathers speed: an AC-coupled sensor was told, K 66 standard errors off, ok."""
    drive = {"current_limit": 0.8, "limit_slope": 1 / (slope * MOTOR["R"])}
    v, rng = VOLTAGES[excitation], np.random.default_rng(slope)
    motion = simulate_fmu("dc_motor_drive", times=TIMES, inputs={"v": v}, parameters=MOTOR | drive)
    i, w = (motion[name] + rng.normal(0, noise, len(v)) for name, noise in (("i", 0.005), ("w", 2.2)))
    result = estimate_parameters(time=TIMES, v=v, i=i, w=w, workers=1)
    off = {n: (result.parameters[n].value - x) / result.parameters[n].uncertainty for n, x in MOTOR.items()}
    assert "slope of the current limit" in result.effects and "AC coupling" not in result.effects, result.notes
    assert result.verdict == "ok" and max(map(abs, off.values())) < 4.5, (off, result.reasons)
    assert result.chain["limit_slope"].value == pytest.approx(drive["limit_slope"], rel=0.05)

"""A converter that shows the mean of the current over a part of each row, whose rows are long beside the winding."""

import numpy as np
import pytest

from estimator import estimate_parameters, simulate_fmu

pytestmark = pytest.mark.usefixtures("shared_workers")

MOTOR = {"R": 4.5, "K": 0.0135, "L": 2.5e-3, "J": 1.4e-6, "B": 1.4e-6}
FINE, WITHIN, MEAN = 2.5e-4, 40, 17  # s; steps a row, and in the mean of its end
LEVELS = np.repeat([0.0, 3.0, 6.0, 9.0, 4.0, 7.0, 2.0, 8.0], 35)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder with a staircase, row by row as a microcontroller writes it."""
    fine = np.arange(len(LEVELS) * WITHIN) * FINE
    shown = simulate_fmu("dc_motor", times=fine, inputs={"v": np.repeat(LEVELS, WITHIN)}, parameters=MOTOR)
    sums = np.concatenate([np.zeros(MEAN), np.cumsum(shown["i"])])
    rng = np.random.default_rng(1)
    i = ((sums[MEAN:] - sums[:-MEAN]) / MEAN)[::WITHIN] + 5e-4 * rng.standard_normal(len(LEVELS))
    w = shown["w"][::WITHIN] + 0.05 * rng.standard_normal(len(LEVELS))
    made = tmp_path_factory.mktemp("board")
    table = np.column_stack([fine[::WITHIN], LEVELS, i, w])
    header = "time [s],voltage [V],current [A],speed [rad/s]"
    np.savetxt(made / "stairs.csv", table, delimiter=",", header=header, comments="", fmt="%.9g")
    return made


def off(result):
    return {n: (result.parameters[n].value - x) / result.parameters[n].uncertainty for n, x in MOTOR.items()}


def test_what_nothing_shows_of_a_sensors_timing_is_doubted_where_much_hangs_on_it(folder):
    """It was ok, with R and J 6 % off, 58 standard errors: a later current is a smaller one here, and fits as well."""
    result = estimate_parameters(folder / "stairs.csv", workers=1)
    assert result.verdict == "doubtful" and abs(off(result)["J"]) > 10
    assert any("whether one output is later than the others" in reason for reason in result.reasons), result.reasons


def test_a_declared_delay_of_half_the_mean_decides(folder):
    late = (MEAN - 1) * FINE / 2
    (folder / "stairs.case.toml").write_text(
        f'[outputs]\ni = {{ column = "current [A]", delay = {late} }}\nw = {{ column = "speed [rad/s]", delay = 0 }}\n'
        '[[recording]]\nfile = "stairs.csv"\n'
    )
    result = estimate_parameters(folder / "stairs.case.toml", workers=1)
    assert result.verdict == "ok", result.reasons
    assert max(map(abs, off(result).values())) < 4.5, off(result)

"""Noise behind a declared filter: its colour is the filter's, from the first row of a recording on."""

import numpy as np
import pytest
from scipy import signal
from scipy.linalg import cholesky, solve_triangular, toeplitz

from estimator import recording_from_arrays, simulate_fmu
from estimator.cases.case import Case, OutputSpec
from estimator.estimating.estimate import estimate_recordings
from estimator.noise.autoregression import autoregressions_of_filter, innovations
from estimator.noise.kalman import rows_behind, shorten
from estimator.recordings.filters import LowPass

pytestmark = pytest.mark.usefixtures("shared_workers")

MOTOR = {"R": 2.2, "K": 0.05, "L": 2e-3, "J": 2e-5, "B": 1e-5}
TIMES = 2e-3 * np.arange(700)
LEVELS = np.select([TIMES < 0.1, TIMES < 0.5, TIMES < 0.9], [0.0, 8.0, 4.0], -6.0)


def response(order, cutoff):
    """Return a Butterworth low-pass filter's response to an impulse; its cutoff of the sampling rate."""
    return signal.sosfilt(signal.butter(order, 2 * cutoff, output="sos"), np.append(1.0, np.zeros(4000)))


@pytest.mark.parametrize(("order", "cutoff"), [(1, 0.02), (2, 0.06), (3, 0.1)])
def test_filtered_noise_is_whitened_from_the_first_row_on_and_behind_gaps(order, cutoff):
    """As by the Cholesky factor of its covariance, a gap at which all begins anew included."""
    h, floor, n = response(order, cutoff), 1e-4, 400
    a, s = min(autoregressions_of_filter(h), key=lambda own: abs(np.log(own[1] / _innovation(h, floor))))
    noise = np.random.default_rng(order).standard_normal((n, 1, 1))
    present = np.ones((n, 1), dtype=bool)
    present[150:153] = False
    white = noise.copy()
    total = shorten(
        white, present, np.ones(n, dtype=bool), [[(a, s)]] * 2, rows_behind(present[:, 0], ~present[:, 0], 24)[:, None]
    )
    covariance = np.array([h[: len(h) - k] @ h[k:] for k in range(25)])
    covariance /= covariance[0]
    covariance[0] += floor
    exact, logs = [], 0.0
    for part in (slice(0, 25), slice(153, 178)):  # no longer ones: an autoregression knows 24 samples
        factor = cholesky(toeplitz(covariance / covariance[0]), lower=True)
        exact.append(solve_triangular(factor, noise[part, 0, 0], lower=True))
        assert white[part, 0, 0] == pytest.approx(exact[-1], rel=0.02, abs=0.02 * np.std(exact[-1]))
        logs += 2 * np.sum(np.log(np.diag(factor)))
    behind = 2 * np.log(s) * (np.count_nonzero(present) - 50)
    assert total == pytest.approx(logs + behind, rel=0.01)
    assert not white[150:153].any()


def _innovation(h, floor):
    """Return the deviation of what the last 24 samples leave, of a filter's noise of variance 1 and white noise."""
    covariance = np.array([h[: len(h) - k] @ h[k:] for k in range(25)]) / (h @ h)
    covariance[0] += floor
    return np.linalg.inv(toeplitz(covariance))[0, 0] ** -0.5 / np.sqrt(1 + floor)


@pytest.mark.parametrize("digits", [1e-7, 1e-3])
def test_what_is_behind_a_filter_is_white_by_one_of_its_colours(digits):
    rng = np.random.default_rng(4)
    sections = signal.butter(3, 0.1, output="sos")
    noise = signal.sosfilt(sections, rng.standard_normal(20_000))[1000:]
    noise += np.sqrt(digits) * np.std(noise) * rng.standard_normal(len(noise))
    left = min((innovations([noise], a) for a, _ in autoregressions_of_filter(response(3, 0.05))), key=np.std)
    alike = [float(left[k:] @ left[:-k]) / float(left @ left) for k in (1, 2, 3)]
    assert np.max(np.abs(alike)) < 5 / np.sqrt(len(left)), alike


def recorded(seed, *, logger):
    """Return a recording of three levels whose logger's filter, if any, has the speed's noise as well."""
    motion = simulate_fmu("dc_motor", times=TIMES, inputs={"v": LEVELS}, parameters=MOTOR)
    rng = np.random.default_rng(seed)
    i = motion["i"] + rng.normal(0, 0.01, len(TIMES))
    w = motion["w"] + rng.normal(0, 0.6, len(TIMES))
    if logger is not None:
        w = signal.sosfilt(logger, w)
    return recording_from_arrays("log", TIMES, {"v": LEVELS, "i": i, "w": w})


@pytest.mark.parametrize("seed", [1, *(pytest.param(k, marks=pytest.mark.full) for k in range(2, 8))])
@pytest.mark.parametrize("way", ["both", "filter"])
def test_a_filter_that_the_noise_has_passed_is_no_reason_for_a_doubt(way, seed):
    """Few rows do not tell a colour of so many numbers: the residuals' neighbours were alike, and all was doubted."""
    low = LowPass("butterworth", 2, 30.0)
    logger = signal.butter(2, 2 * 30.0 * 2e-3, output="sos") if way == "filter" else None
    case = Case(inputs={"v": "v"}, outputs={"i": OutputSpec("i"), "w": OutputSpec("w", **{way: low})})
    (result,) = estimate_recordings([case], [[recorded(seed, logger=logger)]])
    off = {n: (result.parameters[n].value - x) / result.parameters[n].uncertainty for n, x in MOTOR.items()}
    assert result.verdict == "ok" and max(map(abs, off.values())) < 4.5, (off, result.reasons)

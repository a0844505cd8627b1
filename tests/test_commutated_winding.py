"""A winding whose resistance changes with the angle, and ripple that is another in the first turns.

The truth is a motor with R (1 + a cos(n angle + phase)), solved by scipy with a tight tolerance.
"""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from estimator.cases.case import Case, OutputSpec
from estimator.estimating.estimate import estimate_recordings
from estimator.explaining.commutated_winding import most_change, of_resistance
from estimator.noise.clock import Clock
from estimator.noise.noise_model import NoiseModel
from estimator.noise.whitener import Whitener
from estimator.recordings.reading import recording_from_arrays
from estimator.stepping import layout

pytestmark = pytest.mark.usefixtures("shared_workers")

MOTOR = {"R": 2.9, "K": 0.0465, "L": 4.3e-3, "J": 1.35e-5, "B": 2e-4}
STEP, VOLTS, ORDER = 1e-3, 6.0, 10
CASE = Case(inputs={"v": "voltage"}, outputs={"i": OutputSpec("current"), "w": OutputSpec("speed")})


def turning(n, change, phase, *, start=0.0):
    """Return current, speed and angle, (n, 3), of a step of the voltage at `start`."""
    r, k, inductance, j, b = MOTOR.values()

    def slope(t, x):
        i, w, angle = x
        winding = r * (1 + change * np.cos(ORDER * angle + phase))
        return [(VOLTS - winding * i - k * w) / inductance, (k * i - b * w) / j, w]

    t = STEP * np.arange(n) - start
    late = t[t > 0]
    solved = solve_ivp(slope, (0, late[-1]), [0, 0, 0], t_eval=late, rtol=1e-9, atol=1e-10, max_step=STEP)
    return np.vstack([np.zeros((n - len(late), 3)), solved.y.T])


def test_the_response_to_a_resistance_that_changes_with_the_angle_is_the_equations():
    n, change, phase = 400, 0.2, 0.7
    plain, x = turning(n, 0.0, 0.0), turning(n, change, phase)
    names = tuple(MOTOR)
    simulator = SimpleNamespace(
        plan=SimpleNamespace(fixed={}, observed=[None], chains={}, sensors=dict.fromkeys("iw", layout.IDENTITY)),
        names=names, rows=n,
        index={name: k for k, name in enumerate(names)},
        outputs=("i", "w"), observed=[SimpleNamespace(inputs={"v": np.full(n, VOLTS)})], nuisances=(),
        clocks=(Clock(STEP * np.arange(n), slice(0, n)),),
    )  # fmt: skip
    fit = SimpleNamespace(simulator=simulator, values=np.array(list(MOTOR.values())), value=MOTOR.__getitem__)
    fit.once = lambda told: told(fit)
    columns = of_resistance(fit, x[:, 2], ORDER, x[:, 0])
    found = columns @ [change * np.cos(phase), -change * np.sin(phase)]
    wanted = x[:, :2] - plain[:, :2]
    largest = np.max(np.abs(wanted), axis=0)
    # Voltages are held over a row, in which the wave turns by 1 rad at last: that costs a few per cent.
    assert np.all(np.max(np.abs(found - wanted), axis=0) < 0.05 * largest)


@pytest.mark.parametrize("coils", [3, 5, 7, 11, 13])
def test_no_brushes_change_a_winding_by_more_than_is_allowed_for(coils):
    """A ring of coils of 1 ohm between two opposite brushes of any width: its resistance at each angle."""
    at = (np.arange(1024) + 0.5) / 1024  # turns
    largest = 0.0
    for width in np.linspace(0.05, 0.45 if coils == 3 else 0.95, 10):  # of a segment; of three a wide one shorts all
        brushes = np.array([at * coils, (at + 0.5) * coils])  # where they are, in segments
        first = (brushes[1] // 1 - brushes[0] // 1) % coils  # coils of one path from brush to brush
        bridging = brushes % 1 < width  # two segments: their coil is taken from a path
        paths = first - bridging[1], coils - first - bridging[0]
        resistance = paths[0] * paths[1] / (paths[0] + paths[1])
        wave = 2 * np.abs(np.fft.rfft(resistance))[2 * coils] / len(at) / resistance.mean()
        largest = max(largest, float(wave))
    assert (0.7 if coils == 3 else 0.95) * most_change(2 * coils) < largest < 1.001 * most_change(2 * coils)


@pytest.mark.full  # six seconds each
@pytest.mark.parametrize("k", range(8))
def test_what_the_winding_shows_in_its_first_turns_is_not_taken_for_the_motors(k):
    n, rng = 2000, np.random.default_rng(k)
    x = turning(n, 0.2, 0.3 + np.pi * k / 4, start=0.4137)
    time = STEP * np.arange(n)
    shown = x[:, :2] + rng.standard_normal((n, 2)) * [0.006, 0.5]
    signals = {
        "voltage [V]": np.where(time >= 0.41, VOLTS, 0.0),
        "current [A]": shown[:, 0],
        "speed [rad/s]": shown[:, 1],
    }
    result = estimate_recordings([CASE], [[recording_from_arrays("turning", time, signals)]], workers=1)[0]
    assert "commutation" not in result.effects and "current limit" not in result.effects, result.effects
    found = {name: result.parameters[name] for name in MOTOR}
    # Without, R is off by 6 to 50 %, L by up to a factor of two, and a current limit or lags are told.
    for name, within in {"R": 0.02, "K": 0.01, "J": 0.02, "B": 0.02}.items():
        assert found[name].value == pytest.approx(MOTOR[name], rel=within)
    inductance = found["L"]
    assert abs(inductance.value - MOTOR["L"]) < 4 * inductance.standard_error < 1.1 * MOTOR["L"]


def test_errors_that_samples_share_are_whitened_as_their_covariance_says():
    rng = np.random.default_rng(5)
    n, q, k = 60, 2, 3
    shared, y = rng.standard_normal((n, q, k)), rng.standard_normal((n, q))
    noise = NoiseModel.plain(np.array([0.3, 2.0]), (-1, -1))
    present = rng.random((n, q)) > 0.1
    clock, even = Clock(STEP * np.arange(n), slice(0, n)), np.ones((n, q))
    whitener = Whitener(
        noise, (clock,), present, 0 * even, even, np.ones(n, dtype=bool), 0 * even, shared=shared
    )  # fmt: skip
    there = present.ravel()
    columns = shared.reshape(-1, k)[there]
    covariance = np.diag(np.tile([0.3**2, 2.0**2], n)[there]) + columns @ columns.T
    white, logs = whitener(y[:, :, None])
    measured = y.ravel()[there]
    assert float(np.vdot(white, white)) == pytest.approx(measured @ np.linalg.solve(covariance, measured))
    assert logs == pytest.approx(np.linalg.slogdet(covariance)[1])
    own = 2 * np.log(np.tile([0.3, 2.0], n)[there]).sum()
    assert whitener.log_shared == pytest.approx(logs - own)
    assert dataclasses.replace(whitener, shared=None).log_shared == 0.0
    some, whole = whitener.of_rows(y[10:20, :, None], slice(10, 20)), np.zeros((n, q, 1))
    whole[10:20] = y[10:20, :, None]
    np.testing.assert_allclose(some[1][:, 0], whitener(whole)[0].ravel()[some[0].start * q :][: len(some[1])])
    alone, known = whitener.by_noise_alone(white.reshape(n * q, 1))
    size = np.where(present, [0.3, 2.0], np.inf)
    np.testing.assert_allclose(alone.reshape(n, q), y / size, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(known.reshape(n, q, k), shared / size[:, :, None], rtol=1e-12)

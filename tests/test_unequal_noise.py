"""Recordings of one motor by sensors of other ranges: each has its own noise, and more of them never tell less."""

import numpy as np
import pytest
from fine_motor import FINE, STEP, bench, off

from estimator import estimate_parameters, recording_from_arrays
from estimator.noise.clock import Clock
from estimator.noise.noise_model import NoiseModel
from estimator.noise.noise_of_each import with_noise_of_each
from estimator.noise.whitener import Whitener

LEVELS = np.repeat([0.0, 6.0, 2.0, 9.0], [150, 150, 150, 150])


def recorded(seed, times=1.0, levels=LEVELS):
    """Return a bench's recording with so many times its noise."""
    quiet = bench(levels, np.repeat(levels, FINE), seed)
    if times == 1.0:
        return quiet
    rng = np.random.default_rng(1000 + seed)
    more = np.sqrt(times**2 - 1) * rng.standard_normal((len(levels), 2)) * [0.01, 0.3]
    signals = dict(zip(("current [A]", "speed [rad/s]"), more.T, strict=True))
    columns = {"voltage [V]": quiet.signals["voltage"]}
    columns |= {n: quiet.signals[n.split()[0]] + noise for n, noise in signals.items()}
    return recording_from_arrays(f"noise {times:g}", quiet.time, columns)


@pytest.mark.parametrize("times", [30.0, *(pytest.param(x, marks=pytest.mark.full) for x in (3.0, 10.0))])
def test_a_noisy_recording_beside_a_quiet_one_takes_nothing_away(times):
    """One noise for both made the errors two and four times as large, and the estimate doubtful."""
    alone = estimate_parameters(recorded(0), workers=1)
    both = estimate_parameters([recorded(0), recorded(1, times)], workers=1)
    assert both.verdict == "ok", both.reasons
    assert off(both).max() < 4.5, off(both)
    for name, p in both.parameters.items():
        assert p.standard_error < 1.1 * alone.parameters[name].standard_error, name


def test_a_small_step_by_a_finer_range_beside_a_large_one():
    small = recorded(2, levels=LEVELS / 10)
    large = recorded(3, times=10.0)
    both = estimate_parameters([small, large], workers=1)
    alone = estimate_parameters(small, workers=1)
    assert both.verdict == "ok" and off(both).max() < 4.5, (both.reasons, off(both))
    for name, p in both.parameters.items():
        assert p.standard_error < 1.1 * alone.parameters[name].standard_error, name


@pytest.mark.full
def test_a_fast_recording_beside_one_slower_than_the_motor_is_ok():
    slow = recorded(5)
    few = {f"{n} [{u}]": slow.signals[n][::50] for n, u in (("voltage", "V"), ("current", "A"), ("speed", "rad/s"))}
    both = estimate_parameters([recorded(4), recording_from_arrays("slow", slow.time[::50], few)], workers=1)
    assert not any("follows the voltage within" in reason for reason in both.reasons), both.reasons
    assert off(both).max() < 4.5, off(both)


@pytest.mark.full  # a step by a finer range above
def test_a_sine_by_a_finer_range_beside_a_step():
    """No row of it rests or settles: its noise was taken for that of the step, two and three times as large."""
    levels = np.where(np.arange(600) < 3, 0.0, 9.0)
    sine = 6 * np.sin(2 * np.pi * np.arange(600) / 90)
    both = estimate_parameters([recorded(6, times=3.0, levels=levels), recorded(7, levels=sine)], workers=1)
    assert both.verdict == "ok" and off(both).max() < 4.5, (both.reasons, off(both))
    alone = estimate_parameters(recorded(7, levels=sine), workers=1)
    for name in "RKLJ":
        assert both.parameters[name].standard_error < 1.1 * alone.parameters[name].standard_error, name


def test_recordings_whose_sensors_have_zeros_of_their_own():
    """Told by the rows before each step: they were told as motors that move already, and a brush drop (K 54 bars)."""
    zeros = {"speed [rad/s]": (1.2, -0.5, 2.4), "current [A]": (0.02, -0.03, 0.0)}
    runs = []
    for k, level in enumerate((9.0, 5.0, 7.0)):
        quiet = recorded(20 + k, levels=np.where(np.arange(600) < 60, 0.0, level))
        columns = {n: quiet.signals[n.split()[0]] + off[k] for n, off in zeros.items()}
        runs.append(recording_from_arrays(f"run {k}", quiet.time, {"voltage [V]": quiet.signals["voltage"], **columns}))
    found = estimate_parameters(runs, workers=1)
    assert set(found.effects) <= {"offset"} and off(found).max() < 4.5, (found.effects, off(found))
    for name, told in zeros.items():
        for k, zero in enumerate(told):
            own = found.chain.get(f"offset {'w' if 'speed' in name else 'i'} run {k}")
            assert zero == 0.0 or abs(own.value - zero) < 4.5 * own.standard_error


def of_two(x, present=None, level=1.0):
    """Return the whitener of two recordings' residuals of one channel, (2, n), as it is told of each."""
    n = x.shape[1]
    clocks = tuple(Clock(np.arange(n) * STEP, slice(k * n, (k + 1) * n)) for k in range(2))
    zero, one = np.zeros((2 * n, 1)), np.ones((2 * n, 1))
    levels, runs = np.broadcast_to(level, (2, n)).reshape(-1, 1), np.ones(2 * n, dtype=bool)
    there = np.ones((2 * n, 1), dtype=bool) if present is None else present
    plain = Whitener(NoiseModel.plain(np.ones(1), (0,)), clocks, there, levels, one, runs, zero)
    return with_noise_of_each(plain, x.reshape(-1, 1), ~runs, np.zeros((2, 1)))


@pytest.mark.parametrize(
    ("n", "pairs"), [(60, 300), *(pytest.param(n, 1000, marks=pytest.mark.full) for n in (60, 250, 2000))]
)
def test_noises_that_are_alike_are_hardly_ever_told_apart(n, pairs):
    """By chance less than once in 1e4; of 1 000 pairs none, here white and smoothed ones."""
    rng = np.random.default_rng(3)
    for k in range(pairs):
        x = rng.standard_normal((2, n + 3))
        x = sum(x[:, j : n + j] for j in range(4)) if k % 2 else x[:, :n]
        assert of_two(x).each is None, k


def test_a_noise_that_grows_with_its_signal_is_no_noise_of_each_recording():
    rng = np.random.default_rng(5)
    level = np.concatenate([np.linspace(0, 1, 500)[None], np.linspace(0, 0.3, 500)[None]])
    for _ in range(50):
        assert of_two(np.hypot(0.1, level) * rng.standard_normal((2, 500)), level=level).each is None


@pytest.mark.parametrize("times", [1.5, *(pytest.param(x, marks=pytest.mark.full) for x in (4.0, 100.0))])
def test_the_share_of_each_is_within_its_error(times):
    """Of n samples the logarithm of a ratio has the error 1 / sqrt n."""
    rng = np.random.default_rng(8)
    for _ in range(30):
        each = of_two(rng.standard_normal((2, 1000)) * [[1.0], [times]]).each
        assert np.all(each[1000:] == 1.0)
        assert abs(np.log(each[0, 0] * times)) * np.sqrt(1000) < 4.5


def test_a_recording_that_hardly_shows_a_noise_is_a_thousandth_as_noisy_at_least():
    """By 4e-6 of another's noise a fit was beyond all numbers: a set of four recordings ended in an internal error."""
    x = np.random.default_rng(9).standard_normal((2, 1000)) * [[1e-7], [1.0]]
    each = of_two(x).each
    assert np.all(each[1000:] == 1.0) and np.all(each[:1000] == 1e-3)


def test_samples_that_a_logger_holds_are_no_more_than_they_are():
    """Each is shown in ten rows, one of which is a sample: the others tell nothing."""
    rng = np.random.default_rng(11)
    for _ in range(30):
        x = np.repeat(rng.standard_normal((2, 60)), 10, axis=1)
        shown = np.zeros(1200, dtype=bool)
        shown[::10] = True
        assert of_two(x, present=shown[:, None]).each is None

"""Derivatives by differences: found to exist where they do; jumps of few samples are told from noise in all."""

import numpy as np
import pytest

from estimator.fitting.difference_check import check_differences

GRAVITY = 2 / 0.45**2  # m/s², so that a ball from 1 m is on the floor at 0.45 s, which is a sample
TIMES = np.linspace(0.0, 1.5, 151)


def decay(candidates):
    return np.array([a * np.exp(-b * TIMES) for a, b in candidates])


def ball(candidates):
    """Height and speed of a ball that falls from 1 m by g and bounces with e, in closed form."""
    rows = []
    for g, e in candidates:
        height, velocity = np.empty_like(TIMES), np.empty_like(TIMES)
        begin, up, ends = 0.0, 0.0, np.sqrt(2 / g)
        first = True
        for k, t in enumerate(TIMES):
            while t >= ends:
                up = e * (np.sqrt(2 * g) if first else up)
                begin, first = ends, False
                ends = begin + 2 * up / g
            height[k] = 1 - g * t * t / 2 if first else up * (t - begin) - g * (t - begin) ** 2 / 2
            velocity[k] = -g * t if first else up - g * (t - begin)
        rows.append(np.concatenate([height, velocity]))
    return np.array(rows)


def test_derivatives_of_a_smooth_response_exist_and_are_right():
    found = check_differences(decay, np.array([2.0, 3.0]), np.array([2e-3, 3e-3]))
    assert found.exist and found.verdicts == ("smooth", "smooth") and found.reliable.all()
    right = np.column_stack([np.exp(-3 * TIMES), -2 * TIMES * np.exp(-3 * TIMES)])
    assert np.allclose(found.derivatives, right, atol=1e-5)


def test_a_bounce_that_moves_past_a_sample_is_a_jump_of_few_samples():
    step = np.array([0.05, 1e-4])
    found = check_differences(ball, np.array([GRAVITY, 0.7]), step)
    assert not found.exist and found.verdicts[0] == "jumps"
    spoiled = np.flatnonzero(~found.reliable[:, 0])
    assert 1 <= len(spoiled) <= 12
    assert all(min(abs(TIMES[k % 151] - b) for b in (0.45, 1.08)) < 0.02 for k in spoiled)


def test_a_ball_between_bounces_is_smooth():
    found = check_differences(lambda c: ball(c)[:, :40], np.array([9.81, 0.7]), np.array([0.01, 1e-3]))
    assert found.verdicts == ("smooth", "no effect") and found.exist


@pytest.mark.parametrize("seed", range(5))
def test_noise_of_the_solver_is_told_from_jumps(seed):
    rng = np.random.default_rng(seed)

    def noisy(candidates):
        clean = decay(candidates)
        return clean + 1e-4 * rng.standard_normal(clean.shape)

    found = check_differences(noisy, np.array([2.0, 3.0]), np.array([2e-4, 3e-4]))
    assert found.verdicts == ("noise", "noise") and not found.reliable.any()


def test_a_kink_at_the_point_itself_is_no_derivative():
    found = check_differences(lambda c: np.abs(c[:, :1] - 1.0) * TIMES, np.array([1.0]), np.array([1e-3]))
    assert not found.exist


def test_samples_that_are_no_numbers_are_left_out():
    def broken(candidates):
        values = decay(candidates)
        values[candidates[:, 0] > 2.0, -1] = np.nan
        return values

    found = check_differences(broken, np.array([2.0, 3.0]), np.array([2e-3, 3e-3]))
    assert found.verdicts == ("jumps", "smooth") and not found.reliable[-1, 0] and found.reliable[:-1, 0].all()

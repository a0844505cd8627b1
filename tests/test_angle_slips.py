"""Slips of an angle that is integrated from a recorded speed, as rows or counts are lost, told by the ripples alone."""

import sys

import numpy as np
import pytest

from estimator.fitting.angle_slips import angle_slips
from estimator.fitting.shaft_angle import shaft_angle
from estimator.noise.clock import Clock

STEP, ROWS, SPEED = 1e-3, 3000, 190.0  # s; rad/s
ORDERS = {"i": (10, 1), "w": (8, 1)}


def bench(seed, *, lost=(), orders=ORDERS, speed=SPEED, noise=0.8):
    """Return the signals, (rows, 2), and the true angle, of a machine that runs steadily; `lost` (row, rows) pairs."""
    rng = np.random.default_rng(seed)
    n = ROWS + sum(many for _, many in lost)
    wander = speed * (1 + 0.003 * np.sin(2 * np.pi * 0.7 * STEP * np.arange(n) + rng.uniform(0, 6)))
    theta = np.concatenate([[0.0], np.cumsum(0.5 * (wander[1:] + wander[:-1])) * STEP])
    i = 0.5 + 0.02 * rng.standard_normal(n) + sum(0.03 * np.cos(k * theta + k) for k in orders["i"])
    w = wander + noise * rng.standard_normal(n) + sum(1.5 * np.cos(k * theta + 2 * k) for k in orders["w"])
    kept = np.ones(n, dtype=bool)
    for at, many in lost:
        kept[at : at + many] = False
    return np.column_stack([i, w])[kept], theta[kept]


def told(measured):
    clocks = [Clock(STEP * np.arange(len(measured)), slice(0, len(measured)))]
    theta = shaft_angle(measured, ("i", "w"), clocks)
    return theta, angle_slips(theta, measured, ("i", "w"), clocks)


@pytest.mark.parametrize("lost", [[(1400, 5)], [(900, 3), (2100, 8)]])
def test_lost_rows_slip_the_angle_by_what_the_shaft_turned_in_them(lost):
    measured, true = bench(1, lost=lost)
    theta, slips = told(measured)
    for order in (1, 8, 10):  # of which whole turns do not matter
        off = np.exp(1j * order * (theta + slips - true))
        inside = np.ones(ROWS, dtype=bool)
        for at, _ in lost:  # a slip is known to two turns
            inside[max(0, at - 90) : at + 90] = False
        assert np.abs(np.mean(off[inside])) > 0.97, order
    plain = np.exp(8j * (theta - true))
    assert np.abs(np.mean(plain)) < 0.8, "else this shows nothing"


@pytest.mark.parametrize(
    "orders", [ORDERS, *(pytest.param({"i": x, "w": ()}, marks=pytest.mark.full) for x in ((), (1,)))]
)
def test_an_angle_that_loses_nothing_does_not_slip(orders):
    """-2 log L of 70 places and 179 angles of two numbers above 50 by chance: once in 6 million."""
    for seed in range(20):
        assert not told(bench(seed, orders=orders, noise=0.1)[0])[1].any()  # of more the angle itself drifts


@pytest.mark.parametrize("seed", range(4))
def test_a_ripple_that_changes_its_sign_with_the_speed_slips_nothing(seed):
    """An encoder off its centre shows w (1 + a cos theta): backward all its orders seemed to be half a wave off."""
    rng, n = np.random.default_rng(seed), 4000
    w = SPEED * np.tanh((0.5 * n - np.arange(n)) / 150.0)
    theta = np.concatenate([[0.0], np.cumsum(0.5 * (w[1:] + w[:-1])) * STEP])
    shown = w * (1 + 0.015 * np.cos(theta + 1) + 0.006 * np.cos(2 * theta)) + 0.5 * rng.standard_normal(n)
    i = 0.5 * np.sign(w) + 0.02 * rng.standard_normal(n)
    assert not told(np.column_stack([i, shown]))[1].any()


def test_a_shaft_that_hardly_turns_or_has_an_encoder_tells_none():
    assert not told(bench(2, lost=[(1400, 5)], speed=3.0)[0])[1].any()


def test_a_line_near_an_order_that_is_none_slips_nothing(monkeypatch):
    """A fixed frequency, as a hum, drifts against the shaft as its speed does: of many a slip would make one wave."""
    slipped = 0
    for seed in range(8):
        measured, _ = bench(seed, orders={"i": (), "w": ()}, noise=0.1)
        turns = SPEED / (2 * np.pi) * STEP * np.arange(ROWS)
        measured[:, 0] += 0.2 * np.cos(2 * np.pi * 12.04 * turns + seed)
        assert not told(measured)[1].any()
        with monkeypatch.context() as context:
            context.setattr(sys.modules[angle_slips.__module__], "COHERENT", 0.0)
            slipped += told(measured)[1].any()
    assert slipped >= 4, "else this shows nothing"

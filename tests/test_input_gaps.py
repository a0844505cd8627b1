"""Gaps of an input that moves smoothly are on its curve; over an edge, and of levels, they stay what they are."""

import numpy as np
import pytest

from estimator.plans.input_gaps import on_a_curve

T = np.arange(1500) * 1e-3
CHIRP = np.where(T < 0.1, 0.0, 6 + 5 * np.sin(2 * np.pi * (T - 0.1) * (1 + 6 * (T - 0.1))))
LEVELS = np.select([T < 0.1, T < 0.6, T < 1.1], [0.0, 6.0, 12.0], 3.0)
RANDOM = np.repeat(np.random.default_rng(3).uniform(0, 12, 750), 2)


def with_gaps(signal, *, at=(300, 611, 900, 1203), rows=3):
    """Return a signal without so many rows from each of some on, and which these are."""
    lost = np.isin(np.arange(len(signal)), [k + n for k in at for n in range(rows)])
    return np.where(lost, np.nan, signal), lost


@pytest.mark.parametrize("noise", [0.0, 1e-3])
def test_a_chirp_over_lost_rows_is_on_its_curve(noise):
    """Of 1 500 rows with twelve gaps 300 were left, those between two gaps: errors were twice as large."""
    shown, lost = with_gaps(CHIRP + noise * np.random.default_rng(1).standard_normal(len(T)))
    told = on_a_curve(T, shown)
    assert np.max(np.abs(told - CHIRP)[lost]) < 0.01 + 5 * noise and np.array_equal(told[~lost], shown[~lost])


@pytest.mark.parametrize("is_by_rows", [True, False])
def test_a_chirp_that_a_jittering_loop_finds_by_its_turns_or_by_its_clock_is_on_its_curve(is_by_rows):
    """By its turns it is no curve of the time: held over 36 lost rows, a good chirp took 306 s, L known to a half."""
    late = np.random.default_rng(2).uniform(-1.2e-4, 1.2e-4, len(T))
    command = CHIRP if is_by_rows else np.interp(T + late, T, CHIRP)
    shown, lost = with_gaps(command, rows=1, at=range(200, 1450, 40))
    told = on_a_curve(T + late, shown)
    assert np.count_nonzero(np.isnan(told)) == 0 and np.max(np.abs(told - command)[lost]) < 0.02 * np.ptp(CHIRP)


def test_a_gap_over_an_edge_of_a_chirp_stays_one():
    shown, lost = with_gaps(CHIRP, at=(98, 900))
    assert np.isnan(on_a_curve(T, shown)[98:101]).all() and not np.isnan(on_a_curve(T, shown)[900:903]).any()


@pytest.mark.parametrize(("signal", "at"), [(LEVELS, (598, 1099)), (RANDOM, (300, 900))], ids=["levels", "random"])
def test_a_gap_in_which_a_level_changes_stays_one(signal, at):
    shown, lost = with_gaps(signal, at=at)
    assert np.isnan(on_a_curve(T, shown)[lost]).all()


def test_an_input_of_a_slower_clock_is_held():
    shown = np.where(np.arange(len(T)) % 5 == 0, CHIRP, np.nan)
    assert np.array_equal(on_a_curve(T, shown), shown, equal_nan=True)

"""Cost profiles against closed forms of linear least squares."""

import dataclasses

import numpy as np
import pytest

from estimator.fitting.least_squares import LeastSquares
from estimator.judging.profile import REACH, cost_profiles
from estimator.plans.parameters import Box

rng = np.random.default_rng(5)
DESIGN = rng.standard_normal((200, 3)) @ np.array([[1, 0.9, 0], [0, 0.3, 0], [0, 0, 1.0]])
DATA = DESIGN @ [1.0, 2.0, 3.0] + 0.1 * rng.standard_normal(200)
BOX = Box(np.full(3, -100.0), np.full(3, 100.0), np.zeros(3, dtype=bool))
OUTPUT = np.zeros(200, dtype=np.int64)


def residuals(candidates):
    return candidates @ DESIGN.T - DATA


@pytest.fixture(scope="module")
def polish():
    squares = LeastSquares(residuals, BOX, output=OUTPUT, spread=np.array([DATA.std()]))
    return squares.polish(np.ones(3), np.array([0.1]))


def test_of_a_linear_model_the_others_following_give_the_parabola_of_the_standard_error(polish):
    found = cost_profiles(residuals, BOX, polish, names="abc", output=OUTPUT)
    assert list(found) == list("abc")
    for j, profile in enumerate(found.values()):
        offsets = (profile.values - polish.values[j]) / polish.standard_errors[j]
        assert offsets[[0, -1]] == pytest.approx([-REACH, REACH]) and np.all(np.diff(offsets) > 0)
        np.testing.assert_allclose(profile.followed, offsets**2, atol=1e-4)


def test_with_the_others_held_it_rises_by_what_the_parameters_share(polish):
    found = cost_profiles(residuals, BOX, polish, names="abc", output=OUTPUT)
    information = np.linalg.inv(polish.covariance)
    for j, profile in enumerate(found.values()):
        held = information[j, j] * (profile.values - polish.values[j]) ** 2
        np.testing.assert_allclose(profile.held, held, rtol=1e-3, atol=1e-4)


def test_errors_that_were_widened_for_coloured_residuals_widen_the_profile(polish):
    wide = dataclasses.replace(polish, covariance=4 * polish.covariance)
    found = cost_profiles(residuals, BOX, wide, names="abc", output=OUTPUT)["a"]
    offsets = (found.values - polish.values[0]) / (2 * polish.standard_errors[0])
    np.testing.assert_allclose(found.followed, offsets**2, atol=1e-4)


def test_a_parameter_at_a_bound_has_none_and_one_beside_a_bound_stops_there(polish):
    at = dataclasses.replace(polish, at_bound=np.array([1, 0, 0]))
    edge = polish.values[1] + polish.standard_errors[1]
    box = Box(BOX.lower, np.array([100.0, edge, 100.0]), BOX.log)
    found = cost_profiles(residuals, box, at, names="abc", output=OUTPUT)
    assert set(found) == {"b", "c"} and found["b"].values.max() <= edge


def test_failed_simulations_are_nan_and_the_rest_is_there(polish):
    def failing(candidates):
        shown = residuals(candidates)
        shown[candidates[:, 0] < polish.values[0] - 2 * polish.standard_errors[0]] = np.nan
        return shown

    found = cost_profiles(failing, BOX, polish, names="abc", output=OUTPUT)["a"]
    assert np.isnan(found.followed[0]) and np.isfinite(found.followed[6:]).all()

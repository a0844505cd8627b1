"""Columns of long recordings, whitened some rows at a time: the same products as of columns that are held."""

import dataclasses
import tracemalloc

import numpy as np
import pytest
from test_noise_model import plain, whitener_of

from estimator.explaining.addition import Scores
from estimator.fitting.projection import Projection, triangle
from estimator.fitting.score_test import ScoreTest
from estimator.noise import jitter
from estimator.noise.in_parts import AT_ONCE, Made, Scaled, among, products, square
from estimator.noise.jitter import find_jitter
from estimator.noise.level import Level
from estimator.noise.noise_model import NoiseModel
from estimator.plans.part import LONG

ROWS = 2 * AT_ONCE + 17  # of three channels: parts begin amid a row
NONE = np.zeros(0)
NOISES = {
    "white": plain(0.5, 1.0, 2.0),
    "grows": dataclasses.replace(plain(0.5, 1.0, 2.0), growth=np.array([2.0, 0.0, 1.0])),
    "of two sizes": dataclasses.replace(
        plain(0.5, 1.0, 2.0), short=(((NONE, 1.1), (NONE, 1.0), (NONE, 0.9)), ((NONE, 1.0), (NONE, 1.3), (NONE, 1.0)))
    ),
    "jitter": dataclasses.replace(plain(0.5, 1.0, 2.0), jitter=1e-4),
}


def long_whitener(noise: NoiseModel):
    rng = np.random.default_rng(1)
    whitener = whitener_of(noise, ROWS, 3, level=rng.random((ROWS, 3)), missing=[5, 20_001])
    inflate = np.where(rng.random((ROWS, 3)) < 1e-3, 4.0, 1.0)
    slope = rng.random((ROWS, 3)) * 1e3
    return dataclasses.replace(whitener, inflate=inflate, slope=slope, moving=rng.random(ROWS) < 0.5)


@pytest.mark.parametrize("name", NOISES)
def test_columns_of_noise_without_a_memory_are_whitened_in_parts_as_by_the_filter(name):
    whitener = long_whitener(NOISES[name])
    rng = np.random.default_rng(2)
    columns, more = rng.standard_normal((ROWS, 3, 2)), np.moveaxis(rng.standard_normal((1, ROWS, 3)), 0, 2)
    columns[5], more[5] = 1e3, -1e3  # of a row that is missing
    right = whitener(np.concatenate([columns, more], axis=2))[0].reshape(-1, 3)
    found = whitener.whitened(columns, more)
    assert isinstance(found, Scaled) and found.shape == right.shape
    assert np.allclose(found[:], right, rtol=1e-13, atol=0)
    assert np.allclose(found[7 : 7 + AT_ONCE], right[7 : 7 + AT_ONCE], rtol=1e-13, atol=0)
    made = whitener.of_made(lambda rows: columns[rows].copy())
    assert isinstance(made, Made) and np.allclose(made[:], right[:, :2], rtol=1e-13, atol=0)
    assert np.allclose(made[100:20_000], right[100:20_000, :2], rtol=1e-13, atol=0)
    assert np.allclose(products(found, made), right.T @ right[:, :2], rtol=1e-10, atol=1e-8)
    few, some = whitener.of_rows(columns[300:340], slice(300, 340))
    assert np.allclose(some, right[3 * few.start : 3 * few.stop, :2], rtol=1e-13, atol=0)


def test_some_of_columns_and_their_squares_are_those_of_columns_that_are_held():
    whitener, columns = long_whitener(NOISES["grows"]), np.random.default_rng(3).standard_normal((ROWS, 3, 4))
    columns[[5, 20_001]] = 0.0
    found, held = whitener.whitened(columns), whitener(columns)[0].reshape(-1, 4)
    made = whitener.of_made(lambda rows: columns[rows].copy())
    for some in (found, made, held):
        two = among(some, slice(1, 3))
        assert two.shape == (3 * ROWS, 2) and np.allclose(two[:], held[:, 1:3], rtol=1e-13, atol=0)
        assert square(two) == pytest.approx(np.sum(held[:, 1:3] ** 2), rel=1e-12)


def test_how_large_signals_are_is_told_of_any_rows_as_of_all():
    signals = np.random.default_rng(4).standard_normal((50, 2)) * [3.0, 0.0]
    signals[7, 0] = np.nan
    level = Level.of(signals)
    sizes = np.abs(np.nan_to_num(signals))
    right = sizes / [sizes[:, 0].max(), 1.0]
    assert level.shape == (50, 2) and np.array_equal(level[:], right) and np.array_equal(level[3:9], right[3:9])
    assert np.array_equal(level[3:9, 0], right[3:9, 0]) and np.array_equal(level[np.array([7, 2])], right[[7, 2]])


@pytest.mark.parametrize(
    "memory", [{"slow": np.array([[0.1, 0.1]] * 3)}, {"short": (((np.array([0.3]), 1.0),) * 3,) * 2}]
)
def test_noise_with_a_memory_and_short_recordings_are_whitened_whole(memory):
    whitener = whitener_of(dataclasses.replace(NOISES["white"], **memory), LONG + 1, 3)
    assert isinstance(whitener.whitened(np.ones((LONG + 1, 3, 1))), np.ndarray)
    assert isinstance(whitener_of(NOISES["white"], LONG, 3).whitened(np.ones((LONG, 3, 1))), np.ndarray)


@pytest.mark.parametrize("alike", [0.0, 0.999, 1 - 1e-8, 1.0])
def test_a_score_test_beside_columns_in_parts_says_what_one_beside_held_columns_says(alike):
    whitener = long_whitener(NOISES["white"])
    rng = np.random.default_rng(3)
    slopes = rng.standard_normal((ROWS, 3, 4)) * [1.0, 1e-6, 1e4, 3.0]
    slopes[:, :, 3] = (1 - alike) * slopes[:, :, 3] + alike * slopes[:, :, 0]
    z = rng.standard_normal(3 * ROWS)
    in_parts = whitener.whitened(slopes)
    held = in_parts[:]
    known, other = Projection(in_parts), Projection(held)
    assert np.array_equal(known.independent, other.independent)
    assert np.allclose(np.abs(triangle(in_parts)), np.abs(triangle(held)), rtol=1e-8, atol=1e-8)
    test, right = ScoreTest(whitener, known, known.rest(z)), ScoreTest(whitener, other, other.rest(z))
    assert np.allclose(test.left, right.left, atol=1e-10)
    columns = rng.standard_normal((ROWS, 3, 3))
    columns[:, :, 2] = slopes[:, :, 2]  # which is explained already
    for told, expected in zip(
        Scores.of_each(test, in_parts, whitener.of_made(lambda rows: columns[rows].copy())),
        Scores.of_each(right, held, whitener.flat(columns)),
        strict=True,
    ):
        assert np.allclose(told.along, expected.along, atol=1e-6)
        assert np.allclose(told.information, expected.information, rtol=1e-9) and told.whole == pytest.approx(
            expected.whole, rel=1e-12
        )
        assert np.allclose(told.explained, expected.explained, rtol=1e-9, atol=1e-9 * np.abs(expected.explained).max())
    assert test.of_whitened(whitener.whitened(columns)).power[2] == 0.0


def test_products_of_changes_are_those_of_columns_that_are_held():
    whitener = long_whitener(NOISES["grows"])
    rng = np.random.default_rng(6)
    before, slopes = rng.standard_normal((ROWS, 3)), rng.standard_normal((ROWS, 3, 4))
    faint = np.where(np.arange(ROWS)[:, None] % 5_000 < 1_500, 1.0, 1e-15)  # settled, but for rounding
    signals = [before + faint * rng.standard_normal((ROWS, 3)) for _ in range(2)] + [before]
    held = whitener.flat(np.stack(signals, axis=2) - before[:, :, None])
    jacobian, left = whitener.whitened(slopes), rng.standard_normal(3 * ROWS)
    changes = whitener.changes(signals, before)
    assert isinstance(changes, Scaled) and np.allclose(changes[:], held, rtol=1e-12, atol=1e-15)
    along, scores, squares = changes.beside(jacobian, left)
    assert np.allclose(along, jacobian[:].T @ held, rtol=1e-9, atol=1e-9)
    assert np.allclose(scores, held.T @ left, rtol=1e-9, atol=1e-9)
    assert np.allclose(squares, np.sum(held**2, axis=0), rtol=1e-12) and np.array_equal(changes.squares(), squares)
    assert np.allclose(products(jacobian, jacobian), jacobian[:].T @ jacobian[:], rtol=1e-12, atol=1e-9)
    missing = before.copy()
    missing[5] = np.nan  # of a row that is missing
    assert np.array_equal(
        whitener.changes([missing], signals[0]).squares(), changes.chosen(np.arange(3) == 0).squares()
    )


def test_a_score_test_of_a_long_recording_holds_no_columns():
    whitener = long_whitener(NOISES["white"])
    slopes = np.random.default_rng(4).standard_normal((ROWS, 3, 6))
    z, _ = np.ones(3 * ROWS), whitener.flat(slopes[:, :, :1])
    tracemalloc.start()
    known = Projection(jacobian := whitener.whitened(slopes))
    test = ScoreTest(whitener, known, known.rest(z))
    Scores.of_each(test, jacobian, whitener.of_made(lambda rows: slopes[rows, :, :2].copy()))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 0.7 * slopes.nbytes, peak / slopes.nbytes


def test_a_jitter_of_small_slopes_is_told_by_a_series_as_exactly(monkeypatch):
    rng = np.random.default_rng(5)
    step, slope = 1e-3, 10.0 ** rng.uniform(-9, 1.5, (30_000, 2)) / 1e-3
    z = rng.standard_normal(slope.shape) * np.sqrt(1 + (0.1 * step * slope) ** 2)
    told, sizes, gain = find_jitter(z, slope, step)
    monkeypatch.setattr(jitter, "FAINT", -1.0)
    right, right_sizes, right_gain = find_jitter(z, slope, step)
    assert told == right > 0 and np.array_equal(sizes, right_sizes)
    assert gain == pytest.approx(right_gain, rel=1e-9)

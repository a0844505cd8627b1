"""The whitening filter against the dense covariance of all samples: its inverse, its determinant."""

import mpmath
import numpy as np
import pytest
from scipy.linalg import cholesky, expm, solve_triangular
from scipy.stats import multivariate_normal

from estimator.errors import InputError
from estimator.noise import kalman
from estimator.noise.kalman import gains
from estimator.stepping.library import STEPPER


def model(rng, *, d, q, kinds=1):
    """Return a random stable noise model."""
    transition = np.stack(
        [expm(rng.uniform(0.1, 1) * (rng.normal(size=(d, d)) - (2 + d**0.5) * np.eye(d))) for _ in range(kinds)]
    )
    factors = rng.normal(size=(kinds, d, d))
    start = rng.normal(size=(d, d))
    return {
        "transition": transition.reshape(kinds, d, d),
        "process": factors @ factors.transpose(0, 2, 1),
        "initial": 10 * start @ start.T,
        "readout": rng.normal(size=(q, d)),
    }


def whiten(columns, variance, **noise):
    """Return columns whitened, and the logarithm of the determinant of the noise's covariance."""
    own = gains(variance, **noise)
    return own.whiten(columns), own.log_determinant


def dense(variance, *, transition, process, initial, readout, steps=None):
    """Return the covariance of all samples that are there, in the order of the rows and their channels."""
    n, q = variance.shape
    d = len(initial)
    steps = np.zeros(n, dtype=int) if steps is None else steps
    states = np.zeros((n, d, n, d))
    for j in range(n):
        f = transition[steps[j]]
        for k in range(j):
            states[j, :, k] = f @ states[j - 1, :, k]
            states[k, :, j] = states[j, :, k].T
        states[j, :, j] = initial if j == 0 else f @ states[j - 1, :, j - 1] @ f.T + process[steps[j]]
    sigma = np.einsum("ai,jikl,bl->jakb", readout, states, readout).reshape(n * q, n * q)
    there = np.isfinite(variance.ravel())
    return sigma[np.ix_(there, there)] + np.diag(variance.ravel()[there])


def whitening(variance, **noise):
    """Return W of the samples that are there, from whitened unit columns, and the logarithm of the determinant."""
    n, q = variance.shape
    there = np.isfinite(variance.ravel())
    columns = np.full((n * q, there.sum()), np.nan)
    columns[there] = np.eye(there.sum())
    w, log_determinant = whiten(columns.reshape(n, q, -1), variance, **noise)
    assert not w.reshape(n * q, -1)[~there].any()
    return w.reshape(n * q, -1)[there], log_determinant


def check(variance, **noise):
    sigma = dense(variance, **noise)
    w, log_determinant = whitening(variance, **noise)
    exact = solve_triangular(cholesky(sigma, lower=True), np.eye(len(sigma)), lower=True)
    assert np.allclose(w, exact, rtol=0, atol=1e-9 * np.abs(exact).max())
    inverse = np.linalg.inv(sigma)
    assert np.allclose(w.T @ w, inverse, rtol=0, atol=1e-9 * np.abs(inverse).max())
    assert log_determinant == pytest.approx(np.linalg.slogdet(sigma)[1], rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("d", [0, 1, 2, 3, 7, 24])
@pytest.mark.parametrize("q", [1, 2, 8])
def test_whitening_is_the_lower_root_of_the_inverse_covariance(d, q):
    rng = np.random.default_rng([d, q])
    check(rng.uniform(0.5, 2, (12, q)), **model(rng, d=d, q=q))


@pytest.mark.parametrize("seed", range(8))
def test_gaps_and_steps_of_several_lengths_are_whitened_exactly(seed):
    rng = np.random.default_rng(seed)
    d, q, n = rng.integers(1, 5), rng.integers(1, 4), 25
    variance = rng.uniform(0.5, 2, (n, q))
    variance[rng.random((n, q)) < 0.3] = np.inf
    variance[8:11] = np.inf
    check(variance, steps=rng.integers(0, 3, n), **model(rng, d=d, q=q, kinds=3))


@pytest.mark.parametrize("missing", [False, True])
def test_gains_that_are_kept_once_they_have_converged_are_right_to_the_end_and_after_a_change(missing):
    rng = np.random.default_rng(3)
    variance = np.ones((300, 2))
    if missing:
        variance[:, 1] = np.inf
    variance[120] = np.inf  # a gap in the steady state, then another noise level, then another step
    variance[200:, 0] = 2.0
    steps = np.where(np.arange(300) < 250, 0, 1)
    check(variance, steps=steps, **model(rng, d=3, q=2, kinds=2))


@pytest.mark.parametrize("slow", [1e-5, *(pytest.param(x, marks=pytest.mark.full) for x in (1e-3, 0.0))])
def test_slow_convergence_is_not_taken_for_the_steady_state(slow):
    n = 500  # of a random walk that moves little: gains fall as 1/row for 30, 300, all rows
    variance = np.ones((n, 1))
    check(
        variance,
        transition=np.ones((1, 1, 1)),
        process=np.full((1, 1, 1), slow),
        initial=np.ones((1, 1)),
        readout=np.ones((1, 1)),
    )


def test_a_state_that_no_channel_shows_does_not_disturb_and_is_right_when_it_comes_in():
    """A random walk in the second state grows while the first converges; the second step adds it to the first."""
    transition = np.stack([np.diag([0.5, 1.0]), np.array([[0.5, 1.0], [0.0, 1.0]])])
    process = np.stack([np.eye(2)] * 2)
    steps = np.zeros(200, dtype=int)
    steps[150] = 1
    noise = {"transition": transition, "process": process, "initial": np.eye(2), "readout": np.array([[1.0, 0.0]])}
    check(np.ones((200, 1)), steps=steps, **noise)


def test_an_initial_variance_of_1e8_of_the_noise_loses_no_digits():
    """Level and slope of one channel, both unknown, against 60 digits."""
    n, h = 15, 0.3
    transition = np.array([[[1.0, h], [0.0, 1.0]]])
    process = np.array([[[h**3 / 3, h**2 / 2], [h**2 / 2, h]]])
    noise = {"transition": transition, "process": process, "initial": 1e8 * np.eye(2), "readout": np.eye(2)[:1]}
    variance = np.ones((n, 1))
    with mpmath.workdps(60):
        f, sigma = mpmath.matrix(transition[0].tolist()), mpmath.matrix(n, n)
        p = mpmath.matrix(noise["initial"].tolist())
        for j in range(n):
            if j > 0:
                p = f * p * f.T + mpmath.matrix(process[0].tolist())
            column = p.copy()
            for k in range(j, n):
                sigma[j, k] = sigma[k, j] = column[0, 0] + (1 if j == k else 0)
                column = f * column
        lower = mpmath.cholesky(sigma)
        exact = np.array((lower**-1).tolist(), dtype=float)
        log_determinant = float(2 * sum(mpmath.log(lower[j, j]) for j in range(n)))
    w, logarithms = whitening(variance, **noise)
    assert np.abs(w - exact).max() < 1e-9
    assert logarithms == pytest.approx(log_determinant, abs=1e-8)


def test_many_diffuse_states_and_channels_leave_every_covariance_sound():
    rng = np.random.default_rng(5)
    d, q, n = 24, 8, 400
    noise = model(rng, d=d, q=q) | {"initial": 1e8 * np.eye(d)}
    variance = np.where(rng.random((n, q)) < 0.2, np.inf, 1.0)
    sigma = dense(variance[:100], **noise)
    sample = cholesky(sigma, lower=True) @ rng.normal(size=(len(sigma), 64))
    columns = np.zeros((100 * q, 64))
    columns[np.isfinite(variance[:100].ravel())] = sample
    w, _ = whiten(columns.reshape(100, q, 64), variance[:100], **noise)
    samples = w.reshape(100 * q, 64)[np.isfinite(variance[:100].ravel())]
    assert np.mean(samples**2) == pytest.approx(1, abs=6 * np.sqrt(2 / samples.size))  # six deviations
    everything, log_determinant = whiten(rng.normal(size=(n, q, 3)), variance, **noise)
    assert np.isfinite(everything).all() and np.isfinite(log_determinant)


def test_columns_go_through_together_as_each_alone():
    rng = np.random.default_rng(7)
    noise, variance = model(rng, d=4, q=2), rng.uniform(0.5, 2, (80, 2))
    columns = rng.normal(size=(80, 2, 64))
    together, sum_together = whiten(columns, variance, **noise)
    for c in (0, 63):
        alone, sum_alone = whiten(columns[:, :, c : c + 1], variance, **noise)
        assert np.array_equal(alone[:, :, 0], together[:, :, c]) and sum_alone == sum_together


def test_each_sample_is_divided_by_its_size_first():
    rng = np.random.default_rng(8)
    own = gains(rng.uniform(0.5, 2, (80, 2)), **model(rng, d=3, q=2))
    columns, size = rng.normal(size=(80, 2, 5)), rng.uniform(0.5, 2, (80, 2))
    assert np.array_equal(own.whiten(columns, size), own.whiten(columns / size[:, :, None]))
    with pytest.raises(ValueError, match="sizes one of each sample"):
        own.whiten(columns, size[:, :1])


def test_the_likelihood_is_that_of_a_normal_distribution_of_the_dense_covariance():
    rng = np.random.default_rng(9)
    noise, variance = model(rng, d=3, q=2), rng.uniform(0.5, 2, (30, 2))
    variance[rng.random((30, 2)) < 0.2] = np.inf
    residuals = rng.normal(size=(30, 2))
    there = np.isfinite(variance)
    log_density = multivariate_normal(cov=dense(variance, **noise)).logpdf(residuals[there])
    residuals[~there] = np.nan
    white, log_determinant = whiten(residuals[:, :, None], variance, **noise)
    likelihood = np.sum(white**2) + log_determinant + there.sum() * np.log(2 * np.pi)
    assert likelihood == pytest.approx(-2 * log_density, rel=1e-9)


def test_white_noise_without_a_state_is_divided_by_its_deviation():
    columns = np.arange(12.0).reshape(3, 2, 2)
    none = {
        "transition": np.zeros((1, 0, 0)),
        "process": np.zeros((1, 0, 0)),
        "initial": np.zeros((0, 0)),
        "readout": np.zeros((2, 0)),
    }
    white, log_determinant = whiten(columns, np.full((3, 2), 4.0), **none)
    assert np.array_equal(white, columns / 2) and log_determinant == pytest.approx(6 * np.log(4))


def test_a_deterministic_state_that_dies_out_is_no_trouble():
    """Covariance and means fall below the smallest normal number."""
    noise = {
        "transition": np.full((1, 1, 1), 0.5),
        "process": np.zeros((1, 1, 1)),
        "initial": np.ones((1, 1)),
        "readout": np.ones((1, 1)),
    }
    columns = np.zeros((3000, 1, 1))
    columns[0] = 1.0
    white, _ = whiten(columns, np.ones((3000, 1)), **noise)
    assert white[0, 0, 0] == pytest.approx(1 / np.sqrt(2)) and white[-1, 0, 0] == 0.0


def good():
    rng = np.random.default_rng(0)
    return {"columns": np.ones((5, 2, 1)), "variance": np.ones((5, 2)), **model(rng, d=3, q=2)}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"columns": np.ones((5, 2))}, r"columns \(5, 2\) must be \(5, 2, c\)"),
        ({"variance": np.ones((5, 1))}, r"are of shapes .*\(2, 3\)\); expected .*\(1, 3\)\)"),
        ({"variance": np.ones((4, 2))}, r"columns \(5, 2, 1\) must be \(4, 2, c\)"),
        ({"variance": np.ones(5)}, r"variance \(5,\) must be \(rows, q\)"),
        ({"readout": np.ones((3, 2))}, r"are of shapes .*\(3, 2\)\); expected"),
        ({"variance": np.zeros((5, 2))}, "a measurement variance is not above 0"),
        ({"variance": np.full((5, 2), np.nan)}, "a measurement variance is not above 0"),
        ({"steps": np.zeros(4, dtype=int)}, "steps must be 5 indices from 0 to 0"),
        ({"steps": np.array([0, 0, 1, 0, 0])}, "steps must be 5 indices from 0 to 0"),
        ({"steps": np.array([0, 0, -1, 0, 0])}, "steps must be 5 indices from 0 to 0"),
    ],
)
def test_what_does_not_fit_is_refused(change, message):
    with pytest.raises(ValueError, match=message):
        whiten(**(good() | change))


def test_a_missing_library_is_told(monkeypatch, tmp_path):
    monkeypatch.setattr(kalman, "KALMAN", tmp_path / "kalman.so")
    kalman.filters.cache_clear()
    with pytest.raises(InputError, match="kalman.so is missing: an installation compiles it"):
        whiten(**good())


def test_a_library_of_an_older_version_is_told(monkeypatch):
    monkeypatch.setattr(kalman, "KALMAN", STEPPER)  # one without the filter's functions
    kalman.filters.cache_clear()
    with pytest.raises(InputError, match="is of an older version: install fmu-estimator again"):
        kalman.filters()
    kalman.filters.cache_clear()

"""Outputs that jump as parameters move: found, searched without derivatives, and honest standard errors."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import fmu_build
from estimator.cases.case import read_case
from estimator.estimating.estimate import estimate
from estimator.judging.jumps import drawn_errors, jumping
from estimator.plans.parameters import Box

pytestmark = pytest.mark.usefixtures("compiled_quickly")

MODEL = Path(__file__).parent / "models" / "bouncing.c"
TRUTH = {"e": 0.72, "g": -9.5}
CASE = """
[fmu]
path = "bouncing.fmu"
[outputs]
h = "h [m]"
[parameters]
e = { start = 0.6, min = 0.5, max = 0.95 }
g = { start = -9, min = -20, max = -5 }
[[recording]]
file = "ball.csv"
"""


def heights(n, e, g, step=0.01):
    h, v, rows = 1.0, 0.0, []
    for _ in range(n):
        rows.append(h)
        v += g * step
        h += v * step
        if h < 0:
            h, v = 0.0, -e * v
    return np.array(rows)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    where = tmp_path_factory.mktemp("ball")
    fmu_build.build(MODEL, output=where / "bouncing.fmu")
    return where


@pytest.mark.parametrize("seed", [2, *(pytest.param(k, marks=pytest.mark.full) for k in (0, 1))])
def test_a_ball_that_bounces_is_estimated_within_its_standard_errors(folder, seed):
    noisy = heights(201, **TRUTH) + 0.002 * np.random.default_rng(seed).standard_normal(201)
    rows = np.column_stack([np.arange(201) * 0.01, noisy])
    np.savetxt(folder / "ball.csv", rows, delimiter=",", header="time [s],h [m]", comments="")
    case = folder / "ball.case.toml"
    case.write_text(CASE)
    result = estimate(read_case(case))
    assert result.verdict == "ok", result.reasons
    for name, truth in TRUTH.items():
        p = result.parameters[name]
        assert abs(p.value - truth) < 4 * p.standard_error
        assert p.standard_error < 2e-3 * abs(truth)
    assert not result.effects  # a false optimum would have been explained by a lag or an offset
    assert any("h jumps as e" in note and "without derivatives" in note for note in result.notes)


AT = np.linspace(0, 1, 50)


def problem(shown):
    """Return a problem of a and b between 0.5 and 2 that shows a function of them."""
    count = 50
    return SimpleNamespace(
        parameters=tuple(SimpleNamespace(name=n, place=None) for n in "ab"),
        outputs=("y",),
        sigma={"y": 0.01},
        box=Box(np.full(2, 0.5), np.full(2, 2.0), np.full(2, True)),
        residuals=lambda x: np.array([shown(*row) for row in x]),
        spread=np.ones(1),
        output_of_residual=np.zeros(count, dtype=int),
    )


@pytest.mark.parametrize(
    ("shown", "names"),
    [
        (lambda a, b: a * AT + np.floor(40 * b) / 40, ("b",)),
        (lambda a, b: np.where(a * b > AT, 1.0, 0.0), ("a", "b")),  # an event between two samples
        (lambda a, b: a * np.exp(-b * AT), ()),
        (lambda a, b: np.sin(300 * a * AT) * b, ()),  # steep, and smooth
        (lambda a, b: np.maximum(a - AT, 0) * b, ()),  # a kink is no jump
        (lambda a, b: a * AT + 1e-4 * np.sin(1e9 * b), ()),  # a solver's numerical noise
    ],
)
def test_a_jump_is_told_from_what_is_steep_from_a_kink_and_from_numerical_noise(shown, names):
    assert jumping(problem(shown), np.array([0.8, 0.9])) == names


def fitted(covariance, values=(1.0, 1.0)):
    """Return a fit whose covariance differences have given."""
    from estimator.fitting.least_squares_fit import LeastSquaresFit

    covariance = np.array(covariance)
    zero = np.zeros((3, len(values)))
    return LeastSquaresFit(
        values=np.array(values),
        cost=0.0,
        deviations=np.ones(1),
        covariance=covariance,
        standard_errors=np.sqrt(np.diag(covariance)),
        at_bound=np.zeros(len(values), dtype=np.int64),
        jacobian=zero,
        residuals=np.zeros(3),
        scores=covariance,
    )


LINE = Box(np.full(2, -10.0), np.full(2, 10.0), np.full(2, False))


@pytest.mark.parametrize("claimed", [1e-6, 1.0, 30.0])
def test_standard_errors_are_the_likelihoods_whatever_differences_across_a_jump_claim(claimed):
    def residuals(x):
        return np.column_stack([(x[:, 0] - 1) / 0.1, (x[:, 1] - 1) / 0.02 + (x[:, 0] - 1) / 0.1])

    drawn = drawn_errors(residuals, LINE, fitted(np.diag([0.1, 0.1]) ** 2 * claimed**2), np.random.default_rng(1))
    assert drawn.holds
    assert drawn.polish.standard_errors == pytest.approx([0.1, 0.02 * np.sqrt(2)], rel=0.15)


def test_a_point_that_is_far_better_than_the_optimum_leaves_no_standard_errors():
    def residuals(x):
        return np.where(x[:, :1] > 1.05, 0.0, 10 + 10 * (x[:, :1] - 1))

    drawn = drawn_errors(residuals, LINE, fitted(np.diag([0.1, 0.1]) ** 2), np.random.default_rng(1))
    assert not drawn.holds
    assert np.isinf(drawn.polish.standard_errors).all()

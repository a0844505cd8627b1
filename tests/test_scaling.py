"""Parameters that scale together: found behind a solver's noise, said, and given no standard errors."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from exact_motor import exact_response
from motors import CML050

import fmu_build
from estimator import estimate_parameters
from estimator.cases.case import read_case
from estimator.estimating.estimate import estimate
from estimator.judging.scaling import exact_scaling, written
from estimator.plans.parameters import Box

pytestmark = pytest.mark.usefixtures("compiled_quickly")

MODEL = Path(__file__).parent / "models" / "two_resistances.c"
R1, R2, C = 0.1, 0.25, 2000.0
CASE = """
[fmu]
path = "house.fmu"
[inputs]
T1 = "T1"
T2 = "T2"
[outputs]
shown = "T"
[parameters]
R1 = { start = 0.08, min = 0.001, max = 5 }
R2 = { start = 0.08, min = 0.001, max = 5 }
C = { start = 1000, min = 10, max = 1e5 }
[[recording]]
file = "house.csv"
"""


@pytest.fixture(scope="module")
def house(tmp_path_factory):
    """Write a case whose recording is the closed form between samples of held inputs, with noise."""
    folder = tmp_path_factory.mktemp("house")
    fmu_build.build(MODEL, output=folder / "house.fmu")
    rng = np.random.default_rng(3)
    n, step = 400, 30.0
    inputs = np.repeat(10 * rng.standard_normal((20, 2)), 20, axis=0)
    rate = (1 / R1 + 1 / R2) / C
    rest = (inputs[:, 0] / R1 + inputs[:, 1] / R2) / (1 / R1 + 1 / R2)
    temperature = np.zeros(n)
    for k in range(n - 1):
        temperature[k + 1] = rest[k] + (temperature[k] - rest[k]) * np.exp(-rate * step)
    rows = np.column_stack([np.arange(n) * step, inputs, temperature + 0.02 * rng.standard_normal(n)])
    np.savetxt(folder / "house.csv", rows, delimiter=",", header="time [s],T1,T2,T", comments="")
    (folder / "house.case.toml").write_text(CASE)
    return folder / "house.case.toml"


@pytest.fixture(scope="module")
def result(house):
    return estimate(read_case(house))


def test_parameters_that_scale_together_are_doubted_and_their_products_are_told(result):
    assert result.verdict == "doubtful"
    said = (
        "shown alone cannot tell R1, R2, C apart: only R1*C and R2*C are determined, whatever the noise; fix 1 of them"
    )
    assert any(reason.startswith(said) for reason in result.reasons), result.reasons
    for name in ("R1", "R2", "C"):
        assert result.parameters[name].status == "not identified"
        assert result.parameters[name].standard_error is None
    for name, truth in (("R1*C", R1 * C), ("R2*C", R2 * C)):
        product = result.derived[name]
        assert product.unit == "(K/W)*(J/K)"
        assert abs(product.value - truth) < 4 * product.standard_error < 0.02 * truth


def test_with_one_of_them_fixed_the_others_are_told(house):
    fixed = house.with_name("fixed.case.toml")
    fixed.write_text(CASE.replace("C = { start = 1000, min = 10, max = 1e5 }", "[fixed]\nC = 2000"))
    result = estimate(read_case(fixed))
    assert result.verdict == "ok", result.reasons
    for name, truth in (("R1", R1), ("R2", R2)):
        p = result.parameters[name]
        assert abs(p.value - truth) < 4 * p.standard_error < 0.02 * truth
    assert not result.derived


def test_a_column_of_an_fmu_that_is_no_motor_is_taken_in_the_fmus_unit(result):
    read = {name: signal["unit"] for name, signal in result.read[0]["signals"].items()}
    assert (read["shown"], read["T1"]) == ("K", "K")  # a T of a motor's file would be its time


def problem(shown, point, *, noise=0.0):
    """Return a problem of some parameters that shows a function of them, with the noise of a solver."""
    count = len(point)
    named = tuple(SimpleNamespace(name=name, place=None) for name in "abcd"[:count])
    weights = np.linspace(1e7, 2e7, count)

    def residuals(candidates):
        at = np.linspace(0.1, 3.0, 200)
        clean = np.array([shown(at, *x) for x in candidates])
        return clean + noise * np.sin(candidates @ weights + 1e3 * at[:, None]).T.reshape(clean.shape)

    low, high = np.full(count, 1e-3), np.full(count, 1e3)
    return SimpleNamespace(
        parameters=named,
        box=Box(low, high, np.full(count, True)),
        residuals=residuals,
        spread=np.ones(1),
        output_of_residual=np.zeros(200, dtype=int),
    )


@pytest.mark.parametrize(
    ("shown", "names", "products"),
    [
        (lambda t, a, b, c: np.exp(-t / (a * b)) + c * t, ("a", "b"), ("a*b",)),
        (lambda t, a, b, c: a / c * np.exp(-b * t), ("a", "c"), ("a/c",)),
        (lambda t, a, b, c: np.exp(-t * a * b * c), ("a", "b", "c"), ("a*b*c",)),
        (lambda t, a, b, c: np.exp(-a / c * t) * b / c, ("a", "b", "c"), ("a/b", "a/c")),
        (lambda t, a, b, c: np.cos(a**2 / b * t) + c * t, ("a", "b"), ("a^2/b",)),
        (lambda t, a, b, c, d: np.exp(-a * b * t) + c * d * t, ("a", "b", "c", "d"), ("a*b", "c*d")),
    ],
)
@pytest.mark.parametrize("noise", [0.0, 1e-5])
def test_what_a_model_shows_is_found_from_its_outputs_alone(shown, names, products, noise):
    count = shown.__code__.co_argcount - 1
    points = [np.array([0.8, 1.3, 0.6, 1.1])[:count] * x for x in (1.0, 1.2, 0.8)]
    found = exact_scaling(problem(shown, points[0], noise=noise), points)
    assert found is not None
    assert found.names == names
    assert found.products == products
    assert found.missing == len(names) - len(products)


@pytest.mark.parametrize(
    "shown",
    [
        lambda t, a, b, c: np.exp(-t / (a * b)) + c * t + 1e-2 * b * t,  # b is seen, though hardly
        lambda t, a, b, c: a * np.exp(-b * t) + c,
        lambda t, a, b, c: np.exp(-t / (a * b)) + c * t + 1e-3 * a * t**2,
    ],
)
def test_what_shows_a_little_is_no_exact_scaling(shown):
    points = [np.array([0.8, 1.3, 0.6]) * x for x in (1.0, 1.2)]
    assert exact_scaling(problem(shown, points[0]), points) is None


def test_products_are_written_as_one_reads_them():
    assert written({"R1": 1, "C": 1}) == "R1*C"
    assert written({"K": 2, "J": -1}) == "K^2/J"
    assert written({"K": 1, "J": -1, "B": -1}) == "K/(J*B)"
    assert written({"J": -1}) == "1/J"


def test_a_parameter_that_moves_little_with_those_that_cannot_be_told_is_none_that_is():
    """By its angle alone, with R known: L moves by 7 % while K does by 20 %, and was told to 0.07 %."""
    voltage = np.repeat([0.0, 10.0, 4.0, -5.0], [50, 200, 200, 200])
    angle = exact_response(CML050.parameters, voltage, step=1e-3)[:, 2].astype(float)
    shown = np.concatenate([[0.0], angle[:-1]]) + 1e-3 * np.random.default_rng(2).standard_normal(len(voltage))
    table = {"time [s]": 1e-3 * np.arange(len(voltage)), "voltage [V]": voltage, "angle [rad]": shown}
    found = estimate_parameters(table, workers=1, fix={"R": CML050.R})
    assert {n for n, p in found.parameters.items() if p.status == "not identified"} == {"K", "L", "J", "B"}
    assert any("angle alone cannot tell K, L, J, B apart" in reason for reason in found.reasons), found.reasons

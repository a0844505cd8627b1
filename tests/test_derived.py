"""Gains and time constants against the poles of the matrix, and their standard errors over seeds."""

import dataclasses

import numpy as np
import pytest
from motors import CML050, RMCS2004, recording_of, step_recording

from estimator.cases.case import Case, OutputSpec
from estimator.estimating.estimate import estimate_recordings

pytestmark = pytest.mark.usefixtures("shared_workers")


def truth(motor):
    """Return what the motor's matrix says: its steady state and its eigenvalues."""
    R, K, L, J, B = motor.parameters.values()
    matrix = np.array([[-R / L, -K / L], [K / J, -B / J]])
    i, w = np.linalg.solve(matrix, [-1 / L, 0])
    poles = np.linalg.eigvals(matrix)
    found = {"speed_per_volt": w, "current_per_volt": i}
    forward = {"kV": 1 / w, "kA": (R * J + L * B) / K}
    if np.isreal(poles).all():
        slow, fast = sorted(-1 / poles.real, reverse=True)
        return found | {"slow_time_constant": slow, "fast_time_constant": fast} | forward
    return found | {"natural_frequency": abs(poles[0]), "damping_ratio": -poles[0].real / abs(poles[0])} | forward


def noisy(motor, seeds, *, outputs=("current", "speed")):
    clean = step_recording(motor)
    shown = np.column_stack([clean.signals["current"], clean.signals["speed"]])
    for seed in range(seeds):
        made = recording_of(motor.name, clean.time, clean.signals["voltage"], shown, noise=(0.02, 1.0), seed=seed)
        kept = {name: made.signals[name] for name in ("voltage", *outputs)}
        yield dataclasses.replace(made, signals=kept, units={name: made.units[name] for name in kept})


@pytest.mark.parametrize(
    ("seeds", "least", "most"), [(6, 0.01, 5.78), pytest.param(40, 0.05, 2.3, marks=pytest.mark.full)]
)
@pytest.mark.parametrize("motor", [RMCS2004, CML050], ids=lambda m: m.name)
def test_gains_and_time_constants_are_those_of_the_matrix_and_their_errors_hold(
    motor, seeds, least, most, noisy_estimates
):
    """Mean square of errors over standard errors: beyond either bound by chance: 1e-5 a quantity (chi-square).

    Below, the bars hold besides what a single step leaves open: a dry part of the friction, a supply's resistance.
    """
    estimates = noisy_estimates(motor, seeds)
    expected = truth(motor)
    for name, value in expected.items():
        found = [e.derived[name] for e in estimates]
        ratios = np.array([(q.value - value) / q.standard_error for q in found])
        assert least < np.mean(ratios**2) < most, name
    assert {tuple(e.derived) for e in estimates} == {tuple(expected)}


def test_speed_alone_tells_no_parameter_but_the_speed_per_volt():
    """Of five parameters, w/v has three numbers: none of the five is told. Five standard errors by chance: 6e-7."""
    case = Case(inputs={"v": "voltage [V]"}, outputs={"w": OutputSpec("speed [rad/s]")})
    recording = next(iter(noisy(CML050, 1, outputs=("speed",))))
    (estimate,) = estimate_recordings([case], [[recording]])
    assert {p.status for p in estimate.parameters.values()} == {"not identified"}
    gain = estimate.derived["speed_per_volt"]
    assert abs(gain.value - truth(CML050)["speed_per_volt"]) < 5 * gain.standard_error < 0.01 * gain.value
    assert "current_per_volt" not in estimate.derived


def test_another_model_has_none():
    from estimator.judging.derived import told_quantities

    assert told_quantities({"R": 1.0, "Kt": 0.1}, ["R", "Kt"], np.array([True, True]), None) == {}

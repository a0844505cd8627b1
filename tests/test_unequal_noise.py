"""Recordings of one motor by sensors of other ranges: each has its own noise, and more of them never tell less."""

import numpy as np
import pytest
from fine_motor import FINE, bench, off

from estimator import estimate_parameters, recording_from_arrays
from estimator.cases.case import Case, OutputSpec
from estimator.fitting.repeated_samples import without_repeats
from estimator.fmus.probe import bundled_model
from estimator.plans.noise_level import noise_shares
from estimator.plans.planning import plan_case

CASE = Case(inputs={"v": "voltage"}, outputs={"i": OutputSpec("current"), "w": OutputSpec("speed")})

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


@pytest.mark.parametrize("times", [3.0, 30.0, pytest.param(10.0, marks=pytest.mark.full)])
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


def test_a_fast_recording_beside_one_slower_than_the_motor_is_ok():
    slow = recorded(5)
    few = {f"{n} [{u}]": slow.signals[n][::50] for n, u in (("voltage", "V"), ("current", "A"), ("speed", "rad/s"))}
    both = estimate_parameters([recorded(4), recording_from_arrays("slow", slow.time[::50], few)], workers=1)
    assert not any("follows the voltage within" in reason for reason in both.reasons), both.reasons
    assert off(both).max() < 4.5, off(both)


def test_samples_that_a_logger_holds_are_no_more_than_they_are():
    """Each is shown in ten rows: few tell no noise from another. Of 30 recordings of one noise all are alike."""
    held = []
    for seed in range(30):
        shown = recorded(seed)
        columns = {f"{n} [{u}]": shown.signals[n] for n, u in (("voltage", "V"), ("speed", "rad/s"))}
        columns["current [A]"] = shown.signals["current"][np.arange(len(shown.time)) // 10 * 10]
        held.append(recording_from_arrays(f"held {seed}", shown.time, columns))
    plan = plan_case(CASE, bundled_model("dc_motor"), recordings=held)
    assert noise_shares(plan, [without_repeats(o, plan.outputs) for o in plan.observed]) is None

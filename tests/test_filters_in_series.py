"""Filters that act on one output are in series: a voltage that rises behind its command, and a sensor's low-pass."""

import numpy as np
import pytest
from effect_bench import TRUE, recording

from estimator.cases.case import Case, OutputSpec
from estimator.explaining.effects.low_pass import LowPass
from estimator.explaining.effects.voltage_ramp import VoltageRamp
from estimator.explaining.effects.voltage_rise import VoltageRise
from estimator.fitting.simulator import Simulator
from estimator.fmus.probe import bundled_model
from estimator.fmus.workers import Workers
from estimator.plans.planning import plan_case

pytestmark = pytest.mark.usefixtures("shared_workers")

CASE = Case(inputs={"v": "voltage"}, outputs={"i": OutputSpec("current"), "w": OutputSpec("speed")})
RISE, LAG, RAMP = 8e-3, 5e-3, 12e-3  # s


def shown(effects, known):
    """Return what the sensors show of the true motor, (candidates, rows, 2), with each of some values set."""
    plan = plan_case(CASE, bundled_model("dc_motor"), recordings=[recording("two levels")])
    with Workers(1) as crew:
        nuisances = [n for effect in effects for n in effect.nuisances(plan)]
        simulator = Simulator(plan, tuple(nuisances), crew, {"i": 1.0, "w": 1.0})
        return simulator.shown(np.stack([simulator.values(TRUE | one) for one in known]))


def test_a_rise_and_a_low_pass_of_one_output_are_the_low_pass_twice():
    """The low-pass read what the motor does, and showed nothing of the rise: no fit found both."""
    effects = (VoltageRise(), LowPass(name="lag"), LowPass(name="second-order lag"))
    known = [{"voltage rise": LAG, "lag of i": LAG}, {"voltage rise": LAG}, {"second-order lag of i": LAG}]
    both, risen, alone = shown(effects, known)
    sizes = np.max(np.abs(both), axis=0)
    np.testing.assert_allclose(both[:, 0] / sizes[0], alone[:, 0] / sizes[0], atol=2e-4)  # lines between four points
    np.testing.assert_array_equal(both[:, 1], risen[:, 1])  # the speed has no low-pass of its own


def test_the_order_in_which_filters_act_shows_in_nothing():
    (one,) = shown((VoltageRise(), VoltageRamp()), [{"voltage rise": RISE, "voltage ramp": RAMP}])
    (other,) = shown((VoltageRamp(), VoltageRise()), [{"voltage rise": RISE, "voltage ramp": RAMP}])
    (rise,) = shown((VoltageRise(),), [{"voltage rise": RISE}])
    sizes = np.max(np.abs(one), axis=0)
    np.testing.assert_allclose(one / sizes, other / sizes, atol=2e-4)
    assert np.max(np.abs(one - rise) / sizes) > 0.05

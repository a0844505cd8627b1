"""How late sensors show a steady slope: by closed forms, and by the filters themselves on a ramp."""

from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import sosfilt

from estimator.explaining.effects.average import mean_of_last, mean_over_interval
from estimator.explaining.effects.base import longest_lateness
from estimator.explaining.effects.low_pass import FORMS, lag, through
from estimator.fitting.lateness import lateness, soon_shown
from estimator.fitting.simulator import Nuisance
from estimator.plans.parameters import SensorPlace
from estimator.plans.plan import ChainSpec
from estimator.recordings.sensors import chebyshev1_sections
from estimator.stepping import layout

STEP = 1e-3


def fit_of(*nuisances, values=(), chain=None, sensor=layout.IDENTITY):
    chains = {} if chain is None else {"w": chain}
    plan = SimpleNamespace(chains=chains, sensors={"w": sensor, "i": layout.IDENTITY})
    simulator = SimpleNamespace(
        clocks=[SimpleNamespace(step=STEP)], names=[n.name for n in nuisances], nuisances=nuisances, plan=plan
    )
    known = dict(zip(simulator.names, map(float, values), strict=True))
    return SimpleNamespace(simulator=simulator, value=known.__getitem__)


def late(fit, output):
    return lateness(fit.simulator, fit.value, output)


def acts(act, *, output="w", neutral=0.0):
    return Nuisance("act", "s", 0.0, 1.0, neutral, STEP, output=output, act=act)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("tau", [0.4e-3, 5e-3, 60e-3])
def test_a_low_pass_is_late_by_its_time_constants(form, tau):
    of, constants, _ = FORMS[form]
    act = partial(through, of)
    assert late(fit_of(acts(act), values=[tau]), "w") == (0.0, pytest.approx(constants * tau, rel=1e-5))


def test_means_are_late_by_half_of_what_they_span():
    mean = acts(mean_of_last, neutral=1.0)
    assert late(fit_of(mean, values=[5]), "w") == (0.0, pytest.approx(2 * STEP))
    assert late(fit_of(acts(mean_over_interval), values=[1]), "w") == (0.0, pytest.approx(0.5 * STEP))
    assert late(fit_of(sensor=layout.MEAN), "w") == (0.5 * STEP, 0.0)
    assert late(fit_of(chain=ChainSpec(average=4)), "w") == (1.5 * STEP, 0.0)


def test_what_is_neutral_or_another_outputs_is_not_late():
    other = acts(partial(through, lag), output="i")
    assert late(fit_of(acts(partial(through, lag)), values=[0.0]), "w") == (0.0, 0.0)
    assert late(fit_of(other, values=[2e-3]), "w") == (0.0, 0.0)


def test_a_delay_of_a_channel_is_simulated_with_the_fmu_and_that_of_the_recording_is_everyones():
    own = Nuisance("delay of w", "s", 0.0, 1.0, 0.0, STEP, place=SensorPlace("delay", None, "w"))
    all_of_them = Nuisance("delay", "s", 0.0, 1.0, 0.0, STEP, place=SensorPlace("delay", 0))
    fit = fit_of(own, all_of_them, values=[1.3e-3, 0.2], chain=ChainSpec(delay=2e-3))
    assert late(fit, "w") == (pytest.approx(3.3e-3), 0.0)


def test_a_declared_filter_is_as_late_as_it_shows_a_ramp(monkeypatch):
    sections = chebyshev1_sections(order=4, ripple=0.5, cutoff=100.0, step=STEP)
    monkeypatch.setattr(ChainSpec, "sections", lambda self, step: sections)
    ramp = STEP * np.arange(2_000)
    shown = sosfilt([[b0, b1, b2, 1.0, a1, a2] for b0, b1, b2, a1, a2 in sections], ramp)
    gain = 10 ** (-0.5 / 20)  # at rest, of an even order
    assert late(fit_of(chain=ChainSpec()), "w")[0] == pytest.approx(ramp[-1] - shown[-1] / gain, rel=1e-6)


@pytest.mark.parametrize("rows", [1, 2, 3, 7, 12])
def test_a_sensor_that_is_late_has_the_noise_of_what_the_machine_does_already(rows):
    own = Nuisance("delay of w", "s", 0.0, 1.0, 0.0, STEP, place=SensorPlace("delay", None, "w"))
    fit = fit_of(own, values=[(rows - 0.3) * STEP])
    fit.simulator.outputs = ("i", "w")
    fit.simulator.clocks = [
        SimpleNamespace(step=STEP, rows=slice(0, 40)),
        SimpleNamespace(step=STEP, rows=slice(40, 50)),
    ]
    shown = np.random.default_rng(rows).standard_normal((50, 2))
    shown[20] = np.nan
    soon = soon_shown(fit.simulator, fit.value, shown)
    ends = [*[40] * 40, *[50] * 10]
    largest = [np.nanmax(np.abs(shown[k : min(k + rows + 1, ends[k]), 1])) for k in range(50)]
    np.testing.assert_array_equal(soon[:, 1], largest)
    np.testing.assert_array_equal(soon[:, 0], np.abs(shown[:, 0]))


def test_a_signal_of_each_recording_is_late_by_rows_of_its_own():
    fit = fit_of(acts(partial(through, lag)), values=[2 * STEP])
    fit.simulator.outputs = ("w",)
    steps = (STEP, STEP / 4)
    fit.simulator.clocks = [SimpleNamespace(step=h, rows=slice(20 * e, 20 * e + 20)) for e, h in enumerate(steps)]
    shown = np.zeros((40, 1))
    shown[[15, 35]] = 1.0
    soon = soon_shown(fit.simulator, fit.value, shown)
    assert np.flatnonzero(soon[:20]).tolist() == [13, 14, 15]
    assert np.flatnonzero(soon[20:]).tolist() == [*range(7, 16)]


def test_a_mean_over_the_interval_is_not_late_enough_to_matter():
    fit = fit_of(acts(mean_over_interval), values=[1])
    fit.simulator.outputs = ("w",)
    fit.simulator.clocks[0].rows = slice(0, 8)
    shown = np.arange(8.0)[:, None]
    assert soon_shown(fit.simulator, fit.value, shown) is shown


@pytest.mark.parametrize(("step", "samples"), [(1e-3, 60), (1e-4, 500), (1e-2, 60)])
def test_a_sensor_may_be_as_late_in_time_however_fast_it_is_sampled(step, samples):
    recording = SimpleNamespace(time=np.array([0.0, 2.0]))
    plan = SimpleNamespace(shortest_step=step, observed=[SimpleNamespace(recording=recording)])
    assert longest_lateness(plan) == pytest.approx(samples * step)

"""A recording with white noise and no effect is explained by one estimate of its noise and one round of score tests."""

import dataclasses

import numpy as np
import pytest
from effect_bench import lagged, recording, worst

from estimator.cases.case import Case, OutputSpec
from estimator.estimating.estimate import estimate_recordings
from estimator.explaining import selection
from estimator.explaining.addition_tests import AdditionTests

pytestmark = pytest.mark.usefixtures("shared_workers")

CASE = Case(inputs={"v": "voltage"}, outputs={"i": OutputSpec("current"), "w": OutputSpec("speed")})


def counted(monkeypatch, shown):
    """Return an estimate, how often its noise was estimated, and how often additions were tested."""
    noises, tests = [], []
    with_noise, scored = selection.with_noise, AdditionTests._scored
    with monkeypatch.context() as patch:
        patch.setattr(selection, "with_noise", lambda *a, **k: (noises.append(k), with_noise(*a, **k))[1])
        patch.setattr(AdditionTests, "_scored", lambda self, *a, **k: (tests.append(k), scored(self, *a, **k))[1])
        (found,) = estimate_recordings([CASE], [[shown]], workers=1)
    return found, len(noises), len(tests)


def test_a_clean_recording_takes_one_estimate_of_the_noise_and_one_round_of_tests(monkeypatch):
    found, noises, tests = counted(monkeypatch, recording("step"))
    assert worst(found) < 4.5 and not found.effects
    assert (noises, tests) == (1, 1)


def test_it_is_the_estimate_that_every_stage_would_give(monkeypatch):
    clean, _, _ = counted(monkeypatch, recording("two levels"))
    monkeypatch.setattr(selection, "NO_NOISE", -1.0)
    whole, noises, tests = counted(monkeypatch, recording("two levels"))
    assert noises > 1 and tests > 1
    assert (clean.verdict, clean.reasons, clean.effects) == (whole.verdict, whole.reasons, whole.effects)
    for name, one in clean.parameters.items():
        other = whole.parameters[name]
        assert abs(one.value - other.value) < 1e-3 * other.standard_error
        assert one.standard_error == pytest.approx(other.standard_error, rel=1e-2)


@pytest.mark.parametrize("how", ["lag", "colour", "outlier"])
def test_a_recording_that_is_not_clean_goes_through_every_stage(monkeypatch, how):
    shown = recording("two levels", **({"i": lambda y: lagged(y, 2e-3)} if how == "lag" else {}))
    if how != "lag":
        i = next(name for name in shown.signals if "current" in name)
        wrong, rng = np.zeros(len(shown.time)), np.random.default_rng(1)
        if how == "outlier":
            wrong[700] = 30 * np.std(np.diff(shown.signals[i][-50:]))
        else:
            wrong = (
                3
                * np.std(np.diff(shown.signals[i][-50:]))
                * np.convolve(rng.standard_normal(len(wrong)), np.ones(9) / 9, "same")
            )
        shown = dataclasses.replace(shown, signals={**shown.signals, i: shown.signals[i] + wrong})
    found, noises, tests = counted(monkeypatch, shown)
    assert noises > 1 and tests > 1
    assert ("lag" in str(found.effects)) == (how == "lag")

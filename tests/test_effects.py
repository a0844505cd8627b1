"""Each effect on recordings of a bench beside the estimator's: found, named, and the parameters right; or doubted."""

import numpy as np
import pytest
from effect_bench import H, lagged, late, recording, worst

from estimator.cases.case import Case, OutputSpec
from estimator.estimating.estimate import estimate_recordings

CASE = Case(inputs={"v": "voltage"}, outputs={"i": OutputSpec("current"), "w": OutputSpec("speed")})
CHAIN = {  # what stands in the bench, what is estimated of it, its true value; what leaves it unknown
    "delay": ({"i": lambda y: late(y, 3.4e-3), "w": lambda y: late(y, 3.4e-3)}, "delay", 3.4e-3, "delay"),
    "lag": ({"i": lambda y: lagged(y, 2e-3)}, "lag of i", 2e-3, "lag,second-order lag"),
    "offset": ({"i": lambda y: y + 0.05}, "offset i", 0.05, "offset"),
    "delay of": ({"w": lambda y: late(y, 3e-3)}, "delay of w", 3e-3, "delay of"),
    "dry friction": ({"friction": 6e-3}, "friction", 6e-3, "dry friction"),
    "brush drop": ({"brush": 0.8}, "brush", 0.8, "brush drop"),
}
TOLD_BY_ONE_STEP = {"delay", "lag", "offset", "delay of"}
UNTOLD = ("brush drop", "reversal")  # of one voltage's size a drop is a gain: the errors have to allow for it
CASES = [(e, x) for e in CHAIN for x in ("step", "two levels", "reversal") if x != "step" or e in TOLD_BY_ONE_STEP]


def run(recording):
    return estimate_recordings([CASE], [[recording]], workers=1)[0]


@pytest.mark.parametrize(("effect", "excitation"), CASES)
def test_an_effect_is_found_and_the_parameters_are_right(effect, excitation):
    bench, name, size, _ = CHAIN[effect]
    result = run(recording(excitation, **bench))
    assert worst(result) < 4.5, result.reasons
    if (effect, excitation) == UNTOLD and name not in result.chain:
        assert result.parameters["K"].standard_error > 0.02 * result.parameters["K"].value
        return
    assert name in result.chain, (list(result.chain), result.notes)
    found = result.chain[name]
    assert abs(found.value - size) < 5 * found.standard_error + 0.02 * size


@pytest.mark.parametrize("excitation", ["step", "two levels", "reversal"])
def test_a_mean_of_the_last_samples_is_found(excitation):
    result = run(recording(excitation, i=lambda y: mean(y, 4)))
    assert result.sensors["i"]["average"] == 4 and worst(result) < 4.5


def mean(y, n):
    """Return the mean over n samples, a tenth of a sample apart, as a logger shows that adds its samples up."""
    whole = round(H / 1e-4)
    return sum(np.concatenate([np.full(k * whole, y[0]), y[: len(y) - k * whole]]) for k in range(n)) / n


USUAL = {"delay": "step", "lag": "reversal", "offset": "two levels", "delay of": "step", "dry friction": "reversal"}
UNKNOWN = [
    pytest.param(*c, marks=() if USUAL.get(c[0], "two levels") == c[1] else pytest.mark.full)
    for c in CASES
    if c != UNTOLD
]


@pytest.mark.parametrize(("effect", "excitation"), UNKNOWN)
def test_an_effect_that_is_not_known_is_doubted_or_within_the_errors(effect, excitation, monkeypatch):
    bench, _, _, unknown = CHAIN[effect]
    monkeypatch.setenv("FMU_ESTIMATOR_WITHOUT", unknown)
    result = run(recording(excitation, **bench))
    assert result.verdict != "ok" or worst(result) < 4.5, (result.chain.keys(), worst(result))


@pytest.mark.parametrize("excitation", ["step", "two levels", "reversal"])
@pytest.mark.parametrize("seed", range(3))
def test_a_good_recording_has_no_effect_and_is_not_doubted(excitation, seed):
    result = run(recording(excitation, seed=100 + seed))
    assert result.verdict == "ok", result.reasons
    assert not result.chain and worst(result) < 4.5

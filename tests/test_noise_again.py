"""A noise that is estimated again takes the place of that before, but where all rows tell that this is the better."""

import dataclasses

import numpy as np
import pytest
from effect_bench import recording

from estimator.cases.case import Case, OutputSpec
from estimator.estimating.estimate import estimate_recordings
from estimator.explaining import explanation_noise, selection

pytestmark = pytest.mark.usefixtures("shared_workers")

CASE = Case(inputs={"v": "voltage"}, outputs={"i": OutputSpec("current"), "w": OutputSpec("speed")})
LARGER = (0.5, 1.2, 2.0)  # times the deviation; half of -2 log L a sample: log 2 - (1 - 1 / 4) / 2, and so on
IS_KEPT = (True, False, True)


def test_settled_rows_that_mislead_do_not_make_the_noise_worse(monkeypatch):
    """They hardly tell how noise grows: of one bench -2 log L rose by 0.8 a sample, for which others made up."""
    with_noise, fit_noise, kept = selection.with_noise, explanation_noise.fit_noise, []

    def tried(explanation, differenced, **how):
        found = with_noise(explanation, differenced, **how)
        if not kept:
            for times in LARGER:
                with monkeypatch.context() as patch:
                    patch.setattr(
                        explanation_noise, "fit_noise", lambda *a, t=times, **k: _larger(fit_noise(*a, **k), t)
                    )
                    kept.append(with_noise(found, differenced, again=True) is found)
        return found

    monkeypatch.setattr(selection, "with_noise", tried)
    (result,) = estimate_recordings([CASE], [[recording("two levels")]], workers=1)
    assert result.verdict == "ok"
    assert tuple(kept) == IS_KEPT


def _larger(noise, times):
    return dataclasses.replace(noise, white=np.asarray(times * noise.white))

"""Residuals that are louder in a window, and noise in all other ways, widen the bars; all else is a doubt."""

from types import SimpleNamespace

import numpy as np
import pytest

from estimator.explaining.adequacy import LOUDER, Adequacy, Failure
from estimator.judging.misfit import louder, misfit


def checked(*failures):
    return Adequacy(failures, np.ones((1, 1)), (), np.zeros(1), 1)


LOUD = Failure("size", "the settled part", "i", 1.3)


def test_residuals_up_to_twice_as_large_are_told_and_no_doubt():
    found = checked(LOUD)
    assert not found.doubts
    (told,) = louder(found)
    assert told == (
        "the residuals of i in the settled part are noise, 1.3 times that of the rest: the standard errors hold it"
    )


@pytest.mark.parametrize(
    "other",
    [
        Failure("size", "the settled part", "w", LOUDER + 0.1),
        Failure("neighbours", "the settled part", "i", 0.2),
        Failure("own values", "the settled part", "", 1.2),
        Failure("response", "i and w", "i", 1.2),
        Failure("friction", "", "", 1.2),
    ],
)
def test_beside_anything_else_they_are_a_doubt_too(other):
    found = checked(LOUD, other)
    assert found.doubts == (LOUD, other) and not louder(found)


def test_what_is_a_doubt_alone_is_told_before_what_is_doubted_beside_it():
    loud = [Failure("size", f"window {k}", "i", 1.3) for k in range(5)]
    failures = (*loud, Failure("own values", "the settled part", "", 1.2))
    explained = SimpleNamespace(adequacy=checked(*failures), noise=[0.0], at_rest=[0.0])
    reasons = misfit(SimpleNamespace(outputs=["i"]), None, explained, None, [1.0])
    assert "would fit other parameters" in reasons[0] and "1.3 times the noise found" in reasons[1]

"""An exponential filter that a logger takes from row to row, beside a low-pass before the converter."""

import pytest
from effect_bench import FINE, H, lagged, recording, worst
from scipy.signal import lfilter

from estimator import estimate_parameters

pytestmark = pytest.mark.usefixtures("shared_workers")


def by_rows(share):
    """Return what takes so much of each row, of a signal at tenths of a row."""

    def filtered(y):
        y = y.copy()
        y[::FINE] = lfilter([share], [1.0, share - 1.0], y[::FINE])
        return y

    return filtered


OTHERS = [("i", "step", 0.6), ("i", "reversal", 0.05), ("w", "two levels", 0.2), ("w", "reversal", 0.4)]


@pytest.mark.parametrize(
    ("output", "excitation", "share"),
    [("i", "two levels", 0.25), *(pytest.param(*other, marks=pytest.mark.full) for other in OTHERS)],
)
def test_an_exponential_filter_is_no_low_pass_before_the_converter(output, excitation, share):
    """It was told as a low-pass and outputs that come half a row before the input: doubtful, in other emulators off."""
    found = estimate_parameters(recording(excitation, 1, **{output: by_rows(share)}), workers=1)
    assert found.verdict == "ok" and worst(found) < 4.5, (worst(found), found.reasons)
    if share > 0.5:
        return  # of half a row a low-pass does nearly the same
    if {"lag", "scan"} <= set(found.effects):
        return  # a low-pass before a converter that samples this channel half a row late
    assert "exponential filter" in found.effects, found.effects
    (note,) = [note for note in found.notes if "shown through an exponential filter" in note]
    assert float(note.split()[-4]) == pytest.approx(share, rel=0.05), note


@pytest.mark.parametrize(
    ("excitation", "rows"), [("two levels", 3.0), pytest.param("reversal", 1.0, marks=pytest.mark.full)]
)
def test_a_low_pass_before_the_converter_is_no_exponential_filter(excitation, rows):
    found = estimate_parameters(recording(excitation, 1, i=lambda y: lagged(y, rows * H)), workers=1)
    assert found.verdict == "ok" and worst(found) < 4.5, (worst(found), found.reasons)
    assert "lag" in found.effects and "exponential filter" not in found.effects

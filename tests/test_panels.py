"""What a figure of measured against simulated shows, and which part of it is enlarged."""

import dataclasses

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from made_estimates import comparison
from test_plots import unequal

from estimator.results.panels import envelope, joined, panels, transient
from estimator.results.result import FineSignals


def test_the_enlarged_part_of_a_step_is_its_transient():
    start, end = transient(comparison())
    assert 0.48 < start < 0.5
    assert 0.52 < end < 0.6  # the slower time constant is 12 ms


def test_the_enlarged_part_of_a_switching_voltage_is_a_piece_of_it():
    made = comparison(unequal(100_000), step=1e-4)
    start, end = transient(made)
    assert 0.05 < (end - start) / (made.time[-1] - made.time[0]) < 0.15


def test_without_movement_everything_is_enlarged():
    made = comparison(np.zeros(100), noise=(0.0, 0.0))
    assert transient(made) == (0.0, made.time[-1])


@settings(derandomize=True)
@given(
    values=arrays(np.float64, st.integers(1, 500), elements=st.floats(-1e6, 1e6) | st.just(np.nan)),
    bins=st.integers(1, 40),
)
def test_an_envelope_keeps_every_extreme_and_the_order_of_time(values, bins):
    time = np.arange(len(values)) * 0.1
    t, y = envelope(time, values, bins=bins)
    assert len(t) == len(y) <= max(4 * bins, 1)
    assert np.all(np.diff(t) > 0)
    assert np.array_equal(y, values[np.searchsorted(time, t)], equal_nan=True)
    if np.isfinite(values).any():
        assert np.nanmax(y) == np.nanmax(values)
        assert np.nanmin(y) == np.nanmin(values)
    assert t[0] == time[0] and t[-1] == time[-1]


def test_an_envelope_of_a_spike_shows_the_spike():
    values = np.zeros(100_000)
    values[54_321] = 1.0
    t, y = envelope(np.arange(100_000.0), values, bins=500)
    assert t[y == 1.0] == [54_321.0]
    assert len(t) <= 2000


def late(made, samples):
    """Return a comparison whose outputs come later than its input."""
    outputs = {
        kind: {name: np.concatenate([np.full(samples, y[0]), y[:-samples]]) for name, y in getattr(made, kind).items()}
        for kind in ("measured", "simulated")
    }
    return dataclasses.replace(made, **outputs)


def test_with_a_delay_the_enlarged_part_still_shows_the_step_of_the_voltage():
    made = comparison()
    for samples in (31, 250):
        start, end = transient(late(made, samples))
        assert start < 0.5 < 0.5 + samples * 1e-3 < end


def test_the_rows_are_inputs_then_each_signal_with_its_residual():
    made = comparison()
    rows = panels(made, noise={"i": 0.02})
    assert [(row.kind, row.title) for row in rows] == [
        ("input", "voltage v"),
        ("signal", "current i"),
        ("residual", "residual"),
        ("signal", "speed w"),
        ("residual", "residual"),
    ]
    assert [row.band for row in rows] == [0, 0, 0.04, 0, 0]
    residual = rows[2].lines[0].values
    assert np.array_equal(residual, made.measured["i"] - made.simulated["i"])


def test_a_signal_that_is_called_by_its_quantity_is_named_once():
    (row, *_) = panels(comparison())
    titles = [dataclasses.replace(row, name=name, unit=unit).title for name, unit in (("angle", "rad"), ("w", "rad/s"))]
    assert titles == ["angle", "speed w"]


def test_what_was_not_simulated_has_no_residual():
    rows = panels(dataclasses.replace(comparison(), simulated={}))
    assert [row.kind for row in rows] == ["input", "signal", "signal"]
    assert all(line.style != "simulated" for row in rows for line in row.lines)


def test_the_enlarged_part_takes_the_finer_grid_where_there_is_one():
    made = comparison()
    time = 0.5 + 1e-4 * np.arange(500)
    made = dataclasses.replace(made, fine=FineSignals(time, {"i": np.sin(time)}))
    (line,) = [x for x in panels(made, enlarged=True)[1].lines if x.style == "simulated"]
    assert np.all(np.diff(line.time) > 0) and set(time) <= set(line.time)
    assert np.array_equal(line.values[np.isin(line.time, time)], np.sin(time))
    (coarse,) = [x for x in panels(made)[1].lines if x.style == "simulated"]
    assert coarse.time is made.time
    t, y = joined(np.array([0.0, 1.0, 2.0]), np.array([0.0, 10.0, 20.0]), np.array([0.5, 1.5]), np.array([5.0, 15.0]))
    assert t.tolist() == [0.0, 0.5, 1.5, 2.0] and y.tolist() == [0.0, 5.0, 15.0, 20.0]

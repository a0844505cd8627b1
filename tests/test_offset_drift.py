"""An offset of the current that drifts: of which output and recording its columns are."""

from types import SimpleNamespace

import numpy as np

from estimator.explaining.effects.offset_drift import OffsetDrift
from estimator.noise.clock import Clock


def test_the_drift_is_of_the_current_alone_and_named_by_its_recording():
    """Another output whose name begins with an i had no clock left, and a name that says offset said it was a drift."""
    names, outputs = ("offset of the clamp", "b"), ("i", "i_field", "w")
    clocks = [Clock(1e-3 * np.arange(20), slice(20 * e, 20 * e + 20)) for e in range(2)]
    observed = [
        SimpleNamespace(recording=SimpleNamespace(name=name), outputs={y: np.ones(20) for y in outputs})
        for name in names
    ]
    parameters = [SimpleNamespace(name=name, quantity="") for name in "RKLJB"]
    plan = SimpleNamespace(observed=observed, parameters=parameters, fixed={}, declared=frozenset(), unit=lambda y: "")
    simulator = SimpleNamespace(plan=plan, clocks=clocks, outputs=outputs, rows=40)
    groups = OffsetDrift().linear(SimpleNamespace(simulator=simulator))
    assert [g.name for g in groups] == ["offset drift i offset of the clamp", "offset drift i b"]
    for group, clock in zip(groups, clocks, strict=True):
        (rows, channels, _) = np.nonzero(group.columns)
        assert set(channels.tolist()) == {0} and set(rows.tolist()) == set(range(40)[clock.rows])

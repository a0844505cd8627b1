"""Control charts of a batch: values in their order, limits, what is beyond. Knows plain rows only.

A point is a motor: the mean of its runs, which are shown beside it. The limits are those of an individuals chart,
mean ± 2.66 times the mean moving range (Wheeler and Chambers 1992), that is three standard deviations of what changes
from one motor to the next; a drift and a jump do not widen them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from estimator.batches.gauge import FEWEST, FloatArray, natural

MOVING_RANGE = 2.66  # 3 / d₂, d₂ = 1.128 of two values


@dataclass(frozen=True)
class ControlChart:
    """One quantity over a line of motors, in its unit.

    Attributes
    ----------
    points : names of the motors, or of the cases where motors have no name
    values : (n,) array, mean of each point's runs
    errors : (n,) array, standard error of the mean as the estimates say it; NaN where none does
    runs : (point, value) of every run
    mean, lower, upper : centre line and limits; limits None where there are too few points
    """

    name: str
    unit: str
    points: tuple[str, ...]
    values: FloatArray
    errors: FloatArray
    runs: tuple[tuple[int, float], ...]
    mean: float
    lower: float | None
    upper: float | None

    @property
    def beyond(self) -> tuple[str, ...]:
        """Points outside the limits."""
        if self.lower is None or self.upper is None:
            return ()
        return tuple(
            p for p, v in zip(self.points, self.values.tolist(), strict=True) if not self.lower <= v <= self.upper
        )


def control_charts(rows: Iterable[Mapping[str, Any]]) -> list[ControlChart]:
    """Return a chart for each parameter and nameplate quantity that two points or more have."""
    found: dict[tuple[str, str], dict[str, list[tuple[float, float | None]]]] = {}
    for row in sorted(rows, key=lambda row: natural(str(row["case"]))):
        if row["verdict"] not in ("ok", "doubtful"):
            continue
        known = {n: p for n, p in row["parameters"].items() if p["status"] != "not identified"}
        known |= {f"nameplate {n}": p for n, p in row["nameplate"].items()}
        for name, p in known.items():
            if p["standard_error"] is not None:
                runs = found.setdefault((name, p["unit"]), {}).setdefault(str(row["motor"] or row["case"]), [])
                runs.append((p["value"], p["standard_error"]))
    return [_chart(name, unit, groups) for (name, unit), groups in found.items() if len(groups) > 1]


def _chart(name: str, unit: str, groups: Mapping[str, Sequence[tuple[float, float | None]]]) -> ControlChart:
    values = np.array([np.mean([v for v, _ in runs]) for runs in groups.values()])
    errors = np.array([np.sqrt(np.sum([(e or np.nan) ** 2 for _, e in runs])) / len(runs) for runs in groups.values()])
    mean, reach = float(values.mean()), None
    if len(values) >= FEWEST:
        reach = MOVING_RANGE * float(np.mean(np.abs(np.diff(values))))
    every = tuple((k, v) for k, runs in enumerate(groups.values()) for v, _ in runs)
    return ControlChart(
        name=name,
        unit=unit,
        points=tuple(groups),
        values=values,
        errors=errors,
        runs=every,
        mean=mean,
        lower=None if reach is None else mean - reach,
        upper=None if reach is None else mean + reach,
    )

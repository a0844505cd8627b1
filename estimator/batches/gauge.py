"""What a batch says of a line of motors: spread, gauge R&R, outliers, drift. Knows plain rows only.

With several runs of each motor the variance splits into that between motors and that of repeating (one-way
random effects; AIAG, Measurement Systems Analysis, 4th ed., for %GRR and the number of distinct categories). One bench
and one operator: reproducibility is not in it.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator.batches.batch_table import csv_of
from estimator.conventions import FALSE_TREND, MEDIAN_SIZE, MODIFIED_Z
from estimator.results.text_table import TextTable

FloatArray = NDArray[np.float64]
FEWEST = 5  # values below which nothing is called an outlier or a drift
SPREAD_COLUMNS = (
    "quantity",
    "unit",
    "motors",
    "runs",
    "mean",
    "minimum",
    "maximum",
    "deviation between motors",
    "deviation of repeats",
    "total deviation",
    "mean standard error",
    "gauge R&R percent",
    "distinct categories",
    "drift per case",
    "drift probability",
)


@dataclass(frozen=True)
class Spread:
    """One quantity over a batch, in its unit; None where there are too few values to say.

    Attributes
    ----------
    motors, runs : number of motors, and of estimates in all
    between, repeats : standard deviations between motors, and of the runs of one motor
    total : √(between² + repeats²), or the deviation of all values where every motor has one run
    standard_error : median of what the estimates themselves say: one that leaves much open is not all of them
    gauge_percent : 100 repeats / total; below 10 is good, above 30 useless
    categories : how many kinds of motors the measurement can tell apart; 5 and more is good
    drift : slope over the cases in their order, a case; drift_probability : of such a slope without a drift
    outliers : (motor or case, value, modified z-score)
    """

    name: str
    unit: str
    motors: int
    runs: int
    mean: float
    minimum: float
    maximum: float
    between: float | None
    repeats: float | None
    total: float | None
    standard_error: float | None
    gauge_percent: float | None
    categories: int | None
    drift: float | None
    drift_probability: float | None
    outliers: tuple[tuple[str, float, float], ...]


def spreads(rows: Iterable[Mapping[str, Any]]) -> list[Spread]:
    """Return the spread of every parameter and nameplate quantity over the rows that have it.

    Refused and failed cases are left out, and parameters that were not identified.
    """
    values: dict[tuple[str, str], list[tuple[str, str, float, float | None]]] = {}
    for row in sorted(rows, key=lambda row: natural(str(row["case"]))):
        if row["verdict"] not in ("ok", "doubtful"):
            continue
        for name, p in row["parameters"].items():
            if p["status"] != "not identified" and not (p["standard_error"] is None and p["at_bound"] is None):
                entry = (row["case"], row["motor"] or row["case"], p["value"], p["standard_error"])
                values.setdefault((name, p["unit"]), []).append(entry)
        for name, p in row["nameplate"].items():
            entry = (row["case"], row["motor"] or row["case"], p["value"], p["standard_error"])
            values.setdefault((f"nameplate {name}", p["unit"]), []).append(entry)
    return [_spread(name, unit, entries) for (name, unit), entries in values.items() if len(entries) > 1]


def statistics_files(rows: Iterable[Mapping[str, Any]]) -> dict[str, bytes]:
    """Return statistics.csv and outliers.csv."""
    found = spreads(rows)
    lines = [
        [
            *(s.name, s.unit, s.motors, s.runs, s.mean, s.minimum, s.maximum, s.between, s.repeats, s.total),
            *(s.standard_error, s.gauge_percent, s.categories, s.drift, s.drift_probability),
        ]
        for s in found
    ]
    outliers = [[s.name, s.unit, motor, value, z] for s in found for motor, value, z in s.outliers]
    return {
        "statistics.csv": csv_of(SPREAD_COLUMNS, lines),
        "outliers.csv": csv_of(("quantity", "unit", "motor", "value", "modified z-score"), outliers),
    }


def statistics_text(rows: Iterable[Mapping[str, Any]]) -> list[str]:
    """Return the spread as lines for a person; none where there is nothing to compare."""
    found = spreads(rows)
    if not found:
        return []
    lines = spread_table(found).lines()
    for s in found:
        for motor, value, z in s.outliers:
            lines.append(f"outlier: {motor}, {s.name} = {value:.6g} {s.unit} (modified z-score {z:.1f})")
    return lines


def spread_table(found: Sequence[Spread]) -> TextTable:
    """Return a row for each quantity: how it spreads between motors and in repeats."""
    header = ["quantity", "mean", "unit", "between motors", "repeats", "std. error", "gauge R&R", "drift"]
    cells = [
        [
            s.name,
            f"{s.mean:.6g}",
            s.unit,
            _share(s.between if s.repeats is not None else s.total, s.mean),
            _share(s.repeats, s.mean),
            _share(s.standard_error, s.mean),
            "" if s.gauge_percent is None else f"{s.gauge_percent:.0f} %",
            _drift_text(s),
        ]
        for s in found
    ]
    return TextTable(header, cells, (1, 3, 4, 5, 6))


def components(groups: Sequence[FloatArray]) -> tuple[float, float] | None:
    """Return the variances between groups and within them, one-way random effects; None without repeats.

    Unequal groups are allowed (Searle, Casella and McCulloch 1992, eq. 3.3); a negative estimate is zero.
    """
    k, n = len(groups), sum(len(g) for g in groups)
    if n == k:
        return None
    within = sum(float(np.sum((g - g.mean()) ** 2)) for g in groups) / (n - k)
    if k == 1:
        return 0.0, within
    grand = float(np.concatenate(groups).mean())
    between = sum(len(g) * (float(g.mean()) - grand) ** 2 for g in groups) / (k - 1)
    size = (n - sum(len(g) ** 2 for g in groups) / n) / (k - 1)
    return max(0.0, (between - within) / size), within


def outliers(values: FloatArray) -> FloatArray:
    """Return the modified z-scores, (n,): 0.6745 (x − median) / MAD; zero where the MAD is."""
    distance = values - np.median(values)
    mad = float(np.median(np.abs(distance)))
    return np.asarray(MEDIAN_SIZE * distance / mad) if mad > 0 else np.zeros(len(values))


def trend(values: FloatArray, motors: Sequence[str] | None = None) -> tuple[float, float] | None:
    """Return the slope over the index and the probability of one as steep without a trend; None for few values.

    Parameters
    ----------
    values : (n,) array
    motors : (n,) names, optional
        Whose each value is; by default each is another one's. Runs of a motor have in common what the motor has. So
        the trend is of the motors' means, or of the distances from them, whichever are spread further in the order.
    """
    n = len(values)
    _, which, runs = np.unique(range(n) if motors is None else motors, return_inverse=True, return_counts=True)
    x, y = np.arange(n) - (n - 1) / 2, values - values.mean()
    means = [np.bincount(which, own) / runs for own in (x, y)]
    across, along = float(runs @ means[0] ** 2), float(np.sum((x - means[0][which]) ** 2))
    if across > along:
        x, y = (own - own.mean() for own in means)
        free = len(runs) - 2
    else:
        x, y = x - means[0][which], y - means[1][which]
        free = n - len(runs) - 1
    if free < FEWEST - 2:
        return None
    from scipy.special import stdtr  # scipy.stats would cost a second

    sxx = float(x @ x)
    slope = float(x @ y) / sxx
    rest = y - slope * x
    error = math.sqrt(float(rest @ rest) / free / sxx)
    if error == 0:
        return slope, 1.0 if slope == 0 else 0.0
    return slope, 2 * float(stdtr(free, -abs(slope) / error))


def natural(text: str) -> list[tuple[int, int, str]]:
    """Return a key that sorts ``run 2`` before ``run 10``."""
    return [(1, int(part), "") if part.isdecimal() else (0, 0, part) for part in re.split(r"([0-9]+)", text)]


def _spread(name: str, unit: str, entries: Sequence[tuple[str, str, float, float | None]]) -> Spread:
    groups: dict[str, list[float]] = {}
    for _, motor, value, _ in entries:
        groups.setdefault(motor, []).append(value)
    values = np.array([value for _, _, value, _ in entries])
    arrays = [np.array(group) for group in groups.values()]
    parts = components(arrays)
    between = repeats = gauge = None
    categories = None
    total: float | None = float(values.std(ddof=1))
    if parts is not None:
        repeats = math.sqrt(parts[1])
        between = math.sqrt(parts[0]) if len(arrays) > 1 else None
        total = math.sqrt(parts[0] + parts[1])
        if between is not None and total > 0:
            gauge = 100 * repeats / total
            categories = max(1, math.floor(math.sqrt(2) * between / repeats)) if repeats > 0 else None
    errors = [error for *_, error in entries if error is not None]
    means = np.array([group.mean() for group in arrays])
    named: list[tuple[str, float]] = list(zip(groups, means.tolist(), strict=True))
    if len(arrays) == 1:
        named, means = [(case, value) for case, _, value, _ in entries], values
    scores = outliers(means) if len(means) >= FEWEST else np.zeros(len(means))
    found = trend(values, [motor for _, motor, _, _ in entries])
    return Spread(
        name=name,
        unit=unit,
        motors=len(groups),
        runs=len(entries),
        mean=float(values.mean()),
        minimum=float(values.min()),
        maximum=float(values.max()),
        between=between,
        repeats=repeats,
        total=total,
        standard_error=float(np.median(errors)) if errors else None,
        gauge_percent=gauge,
        categories=categories,
        drift=None if found is None else found[0],
        drift_probability=None if found is None else found[1],
        outliers=tuple((m, v, z) for (m, v), z in zip(named, scores.tolist(), strict=True) if abs(z) > MODIFIED_Z),
    )


def _share(deviation: float | None, mean: float) -> str:
    if deviation is None:
        return ""
    return f"{100 * deviation / abs(mean):.2g} %" if mean else f"{deviation:.2g}"


def _drift_text(s: Spread) -> str:
    if s.drift is None or s.drift_probability is None or s.drift_probability >= FALSE_TREND:
        return ""
    return f"{s.drift:+.2g} a case (p = {s.drift_probability:.1g})"

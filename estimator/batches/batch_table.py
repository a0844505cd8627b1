"""The outcomes of a batch as tables: CSV, JSON lines, Parquet. Knows plain rows only; the same rows, the same bytes."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from estimator.errors import InputError, to_install
from estimator.results.spreadsheet_cells import harmless

TIMING_COLUMNS = ("case", "seconds", "search_seconds", "files_seconds", "host")


def table_files(
    rows: Sequence[Mapping[str, Any]], timings: Mapping[str, Mapping[str, Any]], *, parquet: bool = False
) -> dict[str, bytes]:
    """Return results.csv, results.jsonl, timings.csv, and results.parquet if asked for, sorted by case.

    Parameters
    ----------
    rows : as `estimator.batches.case_worker.row_of` makes them
    timings : case → what differs from run to run
    """
    ordered = sorted(rows, key=lambda row: str(row["case"]))
    columns, cells = flat(ordered)
    lines = (json.dumps(row, ensure_ascii=False, allow_nan=False) for row in ordered)
    times = [[timings[name].get(c, "") if c != "case" else name for c in TIMING_COLUMNS] for name in sorted(timings)]
    files = {
        "results.csv": csv_of(columns, cells),
        "results.jsonl": "".join(f"{line}\n" for line in lines).encode(),
        "timings.csv": csv_of(TIMING_COLUMNS, times),
    }
    if parquet:
        files["results.parquet"] = _parquet(columns, cells)
    return files


def flat(rows: Iterable[Mapping[str, Any]]) -> tuple[list[str], list[list[Any]]]:
    """Return columns and cells of rows: one line a case, one column a number; None where a case has none."""
    rows = list(rows)
    units: dict[str, str] = {}
    plate: dict[str, str] = {}
    for row in rows:
        for name, parameter in row["parameters"].items():
            units[name] = units.get(name) or parameter["unit"]
        plate |= {name: p["unit"] for name, p in row["nameplate"].items()}
    outputs, checked = _names(rows, "rmse"), _names(rows, "checks")
    columns = ["case", "motor", "recordings", "verdict", "reasons"]
    for name, unit in units.items():
        columns += [f"{name} [{unit}]" if unit else name, f"{name} standard error", f"{name} status"]
    columns += [f"{what} {name}" for name in outputs for what in ("rmse", "fit percent")]
    for name, unit in plate.items():
        columns += [f"nameplate {name} [{unit}]", f"nameplate {name} standard error"]
    columns += [f"check {name}" for name in checked]
    columns += ["method", "seed", "simulations", "failed simulations"]
    cells = []
    for row in rows:
        line = [row["case"], row["motor"], "; ".join(row["recordings"]), row["verdict"], "; ".join(row["reasons"])]
        for name in units:
            p = row["parameters"].get(name, {})
            bound = p.get("at_bound")
            status = f"{p['status']}, at the {bound} bound" if bound else p.get("status")
            line += [p.get("value"), p.get("standard_error"), status]
        for name in outputs:
            line += [row["rmse"].get(name), row["fit_percent"].get(name)]
        for name in plate:
            p = row["nameplate"].get(name, {})
            line += [p.get("value"), p.get("standard_error")]
        line += [row["checks"].get(name) for name in checked]
        cells.append([*line, row["method"], row["seed"], row["simulations"], row["failed_simulations"]])
    return columns, cells


def csv_of(columns: Sequence[str], rows: Iterable[Sequence[Any]]) -> bytes:
    """Return a table as CSV: numbers exact to the bit, an empty cell where there is none."""
    stream = io.StringIO(newline="")
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow([harmless(column) for column in columns])
    for row in rows:
        writer.writerow(["" if c is None else repr(c) if isinstance(c, float) else harmless(c) for c in row])
    return stream.getvalue().encode()


def _names(rows: Iterable[Mapping[str, Any]], key: str) -> list[str]:
    """Return the names below a key in the order in which they come up."""
    return list(dict.fromkeys(name for row in rows for name in row[key]))


def check_parquet() -> None:
    """See that Parquet can be written, before any time is spent.

    Raises
    ------
    InputError
        The extra is not installed.
    """
    try:
        import pyarrow  # noqa: F401
    except ImportError:
        raise InputError(f"--parquet needs pyarrow; {to_install('parquet')}") from None


def _parquet(columns: Sequence[str], cells: Sequence[Sequence[Any]]) -> bytes:
    import pyarrow
    from pyarrow import parquet

    table = pyarrow.table({name: [row[j] for row in cells] for j, name in enumerate(columns)})
    stream = pyarrow.BufferOutputStream()
    parquet.write_table(table, stream)
    return bytes(stream.getvalue().to_pybytes())

"""What was measured and simulated, as a file that numpy reads: signals.npz. Knows only the result.

For every recording k: "k/time", "k/input NAME", "k/measured NAME", "k/simulated NAME", (n,) each, SI, NaN where a
sample is missing; "about" is a JSON text with the recordings' names, units, and which were held out of the fit.
"""

from __future__ import annotations

import io
import json
import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from estimator.errors import InputError
from estimator.results.result import Comparison, Estimate

SIGNALS_FILE = "signals.npz"
KINDS = ("input", "measured", "simulated")


@dataclass(frozen=True)
class Signals:
    """The comparisons of an estimate, those it was fitted to first; `held_out` counts the others."""

    comparisons: tuple[Comparison, ...]
    held_out: int = 0


def signals_file(estimate: Estimate) -> bytes:
    """Return the content of the file; the same estimate gives the same bytes."""
    seen = () if estimate.validation is None else estimate.validation.comparisons
    comparisons = (*estimate.comparisons, *seen)
    about = {
        "names": [c.name for c in comparisons],
        "units": [dict(c.units) for c in comparisons],
        "held_out": len(seen),
    }
    arrays = {"about": np.array(json.dumps(about))}
    for k, c in enumerate(comparisons):
        arrays[f"{k}/time"] = c.time
        for kind, signals in zip(KINDS, (c.inputs, c.measured, c.simulated), strict=True):
            arrays |= {f"{k}/{kind} {name}": signal for name, signal in signals.items()}
    stream = io.BytesIO()
    np.savez_compressed(stream, allow_pickle=False, **arrays)
    return stream.getvalue()


def read_signals(path: Path) -> Signals:
    """Read the file.

    Raises
    ------
    InputError
        It is damaged, or none.
    """
    try:
        with open(path, "rb") as file, np.load(file, allow_pickle=False) as stored:
            about = json.loads(str(stored["about"]))
            arrays = {key: stored[key] for key in stored.files if key != "about"}
        comparisons = []
        for k, (name, units) in enumerate(zip(about["names"], about["units"], strict=True)):
            parts = {
                kind: {
                    key.removeprefix(f"{k}/{kind} "): array
                    for key, array in arrays.items()
                    if key.startswith(f"{k}/{kind} ")
                }
                for kind in KINDS
            }
            time = arrays[f"{k}/time"]
            if any(array.shape != time.shape for signals in parts.values() for array in signals.values()):
                raise ValueError("lengths differ")
            comparisons.append(
                Comparison(str(name), time, parts["input"], parts["measured"], parts["simulated"], dict(units))
            )
        return Signals(tuple(comparisons), int(about["held_out"]))
    except (OSError, EOFError, ValueError, KeyError, TypeError, AttributeError, zipfile.BadZipFile) as error:
        raise InputError(
            f"{path}: is no file of signals that can be read; run estimate again with --signals"
        ) from error

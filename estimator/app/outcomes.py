"""Result folders, whoever made them: what they hold, as the page shows it. Estimates nothing."""

from __future__ import annotations

import json
import tempfile
import threading
from pathlib import Path
from typing import Any

import numpy as np

from estimator.app import program
from estimator.app.place import RESULT, Place
from estimator.app.series import Series, spectrum
from estimator.errors import InputError
from estimator.results.handover_files import FORMATS
from estimator.results.panels import transient
from estimator.results.result import Comparison
from estimator.results.signals import SIGNALS_FILE, Signals, read_signals

SERVED = {
    RESULT: "application/json",
    "report.html": "text/html; charset=utf-8",
    "parameters.ssv": "application/xml",
    "figure.png": "image/png",
    "figure.svg": "image/svg+xml",
    "figure.pdf": "application/pdf",
    SIGNALS_FILE: "application/octet-stream",
}
EXPORT_LIMIT, COMPARE_LIMIT = 120.0, 60.0  # s: for an export an FMU is built again
KEPT = 8
LARGEST = 64 << 20  # bytes of a result.json


class Outcomes:
    """The result folders of a folder.

    Parameters
    ----------
    place : Place
    """

    def __init__(self, place: Place) -> None:
        self._place = place
        self._lock = threading.Lock()
        self._signals: dict[Path, tuple[int, Signals]] = {}

    def outcome(self, name: str) -> dict[str, Any]:
        """Return what a result folder says, and of which recordings it holds signals.

        Raises
        ------
        InputError
            It is none, or damaged.
        """
        folder = self._folder(name)
        signals = self._signals_of(folder)
        shown = []
        for k, c in enumerate(() if signals is None else signals.comparisons):
            first, last = transient(c)
            shown.append(
                {
                    "name": c.name,
                    "held_out": signals is not None and k >= len(signals.comparisons) - signals.held_out,
                    "units": dict(c.units),
                    "inputs": list(c.inputs),
                    "outputs": list(c.measured),
                    "transient": [first, last],
                    "begin": float(c.time[0]),
                    "end": float(c.time[-1]),
                    "fitted": bool(c.simulated),
                    "rmse": {n: _rms(c.measured[n] - c.simulated[n]) for n in c.measured if n in c.simulated},
                }
            )
        return {
            "name": name,
            "result": self._result(folder),
            "files": [file for file in SERVED if (folder / file).is_file()],
            "signals": shown,
            "formats": FORMATS,
        }

    def written(self, name: str) -> float:
        """Return when a result was written, s since the epoch; 0 if it has gone."""
        try:
            return (self._folder(name) / RESULT).stat().st_mtime
        except (InputError, OSError):
            return 0.0

    def summary(self, name: str) -> dict[str, Any]:
        """Return a result's name, verdict and when it was written; its verdict is None if it cannot be read."""
        try:
            verdict = self._result(self._folder(name))["verdict"]
        except InputError:
            verdict = None
        return {"name": name, "verdict": verdict, "written": self.written(name)}

    def series(self, name: str, recording: int) -> Series:
        """Return a recording's signals: "input v", "measured i", "simulated i", "residual i"."""
        c = self._comparison(name, recording)
        signals = {f"input {n}": u for n, u in c.inputs.items()}
        for n, measured in c.measured.items():
            signals[f"measured {n}"] = measured
            if n in c.simulated:
                signals |= {f"simulated {n}": c.simulated[n], f"residual {n}": measured - c.simulated[n]}
        return Series(c.time, signals)

    def ripple(self, name: str, recording: int) -> dict[str, Any]:
        """Return frequencies in Hz and amplitudes of every output's residual."""
        c = self._comparison(name, recording)
        found = {n: spectrum(c.time, c.measured[n] - c.simulated[n]) for n in c.measured if n in c.simulated}
        return {
            n: {"frequency": frequency.tolist(), "amplitude": np.nan_to_num(amplitude).tolist()}
            for n, (frequency, amplitude) in found.items()
        }

    def file(self, name: str, file: str) -> tuple[Path, str]:
        """Return the path and the type of one of a result's files.

        Raises
        ------
        InputError
            It is none of them, or not there.
        """
        if file not in SERVED:
            raise InputError(f"{file!r} is no file of a result ({', '.join(SERVED)})")
        path = self._folder(name) / file
        if not path.is_file() or path.is_symlink():
            raise InputError(f"{name} has no {file}")
        return path, SERVED[file]

    def export(self, name: str, form: str) -> tuple[str, bytes]:
        """Return name and content of a file for another tool, as the command `export` writes it.

        Raises
        ------
        InputError
            There is no such format, or the FMU does not allow it.
        """
        if form not in FORMATS:
            raise InputError(f"there is no format {form!r} ({', '.join(FORMATS)})")
        self._folder(name)
        with tempfile.TemporaryDirectory() as folder:
            program.output_of(
                ["export", name, "--format", form, "-o", folder], folder=self._place.path, limit=EXPORT_LIMIT
            )
            (written,) = Path(folder).iterdir()
            return written.name, written.read_bytes()

    def compared(self, names: list[str]) -> dict[str, str]:
        """Return what the command `compare` says of results, the first being the reference, and the command.

        Raises
        ------
        InputError
            One of them is none, or they cannot be compared.
        """
        for name in names:
            self._folder(name)
        text = program.output_of(
            ["compare", "--", *names], folder=self._place.path, limit=COMPARE_LIMIT, good=(0, 1)
        )  # 1: something differs
        if not text:
            raise InputError(f"{program.shown(['compare', *names])} has said nothing; run it in a terminal")
        return {"text": text, "command": program.shown(["compare", *names])}

    def _folder(self, name: str) -> Path:
        folder = self._place.inside(name)
        if not (folder / RESULT).is_file():
            raise InputError(f"{name!r} holds no {RESULT}; a result folder is what estimate -o writes")
        return folder

    def _result(self, folder: Path) -> dict[str, Any]:
        path = folder / RESULT
        try:
            if path.stat().st_size > LARGEST:
                raise ValueError("too large")
            result = json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise InputError(f"{folder.name}/{RESULT} cannot be read: {error}") from error
        if not isinstance(result, dict) or result.get("verdict") not in ("ok", "doubtful", "refused"):
            raise InputError(f"{folder.name}/{RESULT} is no result of an estimate: it has no verdict")
        return result

    def _comparison(self, name: str, recording: int) -> Comparison:
        signals = self._signals_of(self._folder(name))
        if signals is None:
            raise InputError(f"{name} has no {SIGNALS_FILE}; estimate again with --signals")
        if not 0 <= recording < len(signals.comparisons):
            raise InputError(f"{name} has no recording number {recording}")
        return signals.comparisons[recording]

    def _signals_of(self, folder: Path) -> Signals | None:
        path = folder / SIGNALS_FILE
        if not path.is_file():
            return None
        stamp = path.stat().st_mtime_ns
        with self._lock:
            known = self._signals.pop(path, None)
            if known is None or known[0] != stamp:
                known = (stamp, read_signals(path))
            self._signals[path] = known
            while len(self._signals) > KEPT:
                del self._signals[next(iter(self._signals))]
        return known[1]


def _rms(residual: np.ndarray) -> float | None:
    value = float(np.sqrt(np.nanmean(residual**2))) if np.isfinite(residual).any() else float("nan")
    return value if np.isfinite(value) else None

"""MDF (.mf4, .mdf, .dat of ASAM) → columns. Knows asammdf (extra: mdf); units come from the file."""

from __future__ import annotations

import gc
import sys
from pathlib import Path
from typing import Any

import numpy as np

from estimator.errors import RecordingError, to_install
from estimator.recordings.columns import Columns, Signal, distinct, on_one_clock
from estimator.recordings.headers import parse_header


def read_mdf(path: Path) -> Columns:
    """Read all channels of numbers, each group on its own clock.

    Raises
    ------
    RecordingError
        asammdf is not installed, the file is damaged, or it holds no channel of numbers with a clock.
    """
    try:
        import asammdf  # noqa: F401
    except ImportError:
        raise RecordingError(f"{path.name} is an MDF file, which needs asammdf; {to_install('mdf')}") from None
    unraisable, sys.unraisablehook = sys.unraisablehook, _nothing  # asammdf stumbles again when it cleans up
    try:
        channels = _channels(path)
        if isinstance(channels, str):
            gc.collect()
    finally:
        sys.unraisablehook = unraisable
    if isinstance(channels, str):
        raise RecordingError(f"{path.name} is a damaged MDF file ({channels}); export it again")
    if not channels:
        raise RecordingError(f"{path.name} holds no channel of numbers with a clock; export voltage, current and speed")
    headers = [_header(channel.name, channel) for channel in channels]
    longer = [_header(f"{channel.name} group {channel.group_index}", channel) for channel in channels]
    return on_one_clock(
        path,
        [
            Signal(header, np.asarray(channel.samples, dtype=np.float64), np.asarray(channel.timestamps, np.float64))
            for header, channel in zip(distinct(headers, longer), channels, strict=True)
        ],
    )


def _channels(path: Path) -> list[Any] | str:
    """Return the channels of numbers, or why they cannot be read."""
    from asammdf import MDF

    try:
        with MDF(path) as file:
            return [channel for channel in file.iter_channels() if _is_numeric(channel)]
    except Exception as error:  # asammdf raises whatever it stumbles over
        return " ".join(str(error).split())[:100] or type(error).__name__


def _nothing(_: Any) -> None:
    """Say nothing."""


def _is_numeric(channel: Any) -> bool:
    samples = channel.samples
    return samples.ndim == 1 and samples.dtype.kind in "iufb" and len(samples) == len(channel.timestamps) > 0


def _header(name: str, channel: Any) -> str:
    name = name.split("\\")[0]  # source or device behind a backslash
    unit = (channel.unit or "").strip()
    return f"{name} [{unit}]" if unit and parse_header(name).unit_text is None else name

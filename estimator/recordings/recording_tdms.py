"""TDMS (LabVIEW) → columns. Knows npTDMS (extra: tdms); units and clocks come from the channels' properties."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

import numpy as np

from estimator.errors import RecordingError, to_install
from estimator.recordings.columns import Columns, Signal, distinct, on_one_clock
from estimator.recordings.headers import parse_header, role_of
from estimator.recordings.units import FloatArray, parse_unit

MAGIC = b"TDSm"
UNITS = ("unit_string", "NI_UnitDescription", "Unit", "unit")  # properties that hold a unit
INTERVAL, START, OFFSET = "wf_increment", "wf_start_time", "wf_start_offset"  # of a waveform's clock


def read_tdms(path: Path) -> Columns:
    """Read all channels of numbers, each on its clock: its waveform's, or the time channel of its group.

    Raises
    ------
    RecordingError
        npTDMS is not installed, the file is damaged, or it holds no channel of numbers with a clock.
    """
    try:
        import nptdms
    except ImportError:
        raise RecordingError(f"{path.name} is a TDMS file, which needs npTDMS; {to_install('tdms')}") from None
    logging.getLogger("nptdms").setLevel(logging.CRITICAL)  # what it would say is said below
    try:
        groups = [[_Channel(group.name, c) for c in group.channels()] for group in nptdms.TdmsFile.read(path).groups()]
    except Exception as error:  # npTDMS raises whatever it stumbles over
        words = " ".join(str(error).split())[:100] or type(error).__name__
        raise RecordingError(f"{path.name} is a damaged TDMS file ({words}); export it again") from None
    if not groups:
        raise RecordingError(f"{path.name} is a damaged TDMS file, or an empty one; export it again")
    starts = [c.start for group in groups for c in group if c.start is not None]
    channels: list[tuple[_Channel, FloatArray]] = []
    for group in groups:
        clock = next((c for c in group if role_of(parse_header(c.name).name) == "time" and c.values is not None), None)
        for channel in group:
            time = channel.time(min(starts, default=None)) if channel is not clock else None
            if time is None and clock is not None and channel is not clock and len(channel) == len(clock):
                time = clock.seconds()
            if time is not None and channel.values is not None and len(channel):
                channels.append((channel, time))
    if not channels:
        raise RecordingError(
            f"{path.name} holds no channel of numbers with a clock; write waveforms (with {INTERVAL}), or a channel"
            " time [s] in the group"
        )
    headers = distinct([c.header(c.name) for c, _ in channels], [c.header(f"{c.name} {c.group}") for c, _ in channels])
    signals = []
    for header, (channel, time) in zip(headers, channels, strict=True):
        assert channel.values is not None
        signals.append(Signal(header, channel.values, time))
    return on_one_clock(path, signals)


class _Channel:
    """A channel's name, unit, clock and samples."""

    def __init__(self, group: str, channel: Any) -> None:
        self.group, self.name = group, str(channel.name)
        self.properties = dict(channel.properties)
        self.samples = np.asarray(channel[:])
        self.values = self.samples.astype(np.float64) if self.samples.dtype.kind in "iufb" else None
        if self.samples.dtype.kind == "M":
            nanoseconds = self.samples.astype("datetime64[ns]").astype(np.int64)
            self.values = (nanoseconds - nanoseconds[:1]) / 1e9
        start = self.properties.get(START)
        self.start = None if start is None else np.datetime64(start, "ns")

    def __len__(self) -> int:
        return len(self.samples)

    def header(self, name: str) -> str:
        """Return the name with the unit that the properties say, if the name says none."""
        unit = next((str(self.properties[key]).strip() for key in UNITS if self.properties.get(key)), "")
        return f"{name} [{unit}]" if unit and parse_header(name).unit_text is None else name

    def time(self, origin: np.datetime64 | None) -> FloatArray | None:
        """Return the waveform's times, (n,) s since the earliest start of the file; None if it has no clock."""
        interval = self.properties.get(INTERVAL)
        if not isinstance(interval, (int, float)) or interval <= 0:
            return None
        late = 0.0 if self.start is None or origin is None else float((self.start - origin) / np.timedelta64(1, "ns"))
        first = late / 1e9 + float(self.properties.get(OFFSET) or 0.0)
        return np.asarray(first + np.arange(len(self)) * float(interval))

    def seconds(self) -> FloatArray:
        """Return the samples of a time channel, (n,) s."""
        assert self.values is not None
        unit = parse_header(self.header(self.name)).unit or parse_unit("s")
        assert unit is not None
        return self.values if self.samples.dtype.kind == "M" else unit.to_si(self.values)

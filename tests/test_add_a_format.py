"""The page on how to add a format: its code is run, and reads what it says."""

import re
from pathlib import Path

import numpy as np
import pytest
from motors import CML050, NAMES, step_recording

from estimator.api import estimate_parameters
from estimator.errors import RecordingError
from estimator.recordings import formats
from estimator.recordings.reading import read_recording

PAGE = Path(__file__).parent.parent / "docs" / "add-a-format.md"


@pytest.fixture
def of_the_page(monkeypatch):
    (code,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.S)
    names = {"__name__": "page"}
    exec(compile(code, str(PAGE), "exec"), names)
    monkeypatch.setattr(formats, "FORMATS", (*formats.FORMATS, names["RAW"]))


@pytest.fixture
def raw(tmp_path):
    """Return a step of the CML-050 as ngspice writes it, the speed as a voltage."""
    motor = step_recording(CML050, lead=0.05, duration=0.4)
    columns = [motor.time, *(motor.signals[n] for n in ("voltage", "current", "speed"))]
    kinds = (("time", "time"), ("v(in)", "voltage"), ("i(la)", "current"), ("v(speed)", "voltage"))
    head = "Title: dc motor\nDate: today\nPlotname: Transient Analysis\nFlags: real\n"
    head += f"No. Variables: 4\nNo. Points: {len(motor.time)}\nVariables:\n"
    head += "".join(f"\t{k}\t{name}\t{kind}\n" for k, (name, kind) in enumerate(kinds))
    path = tmp_path / "motor.raw"
    path.write_bytes(head.encode() + b"Binary:\n" + np.column_stack(columns).astype("<f8").tobytes())
    return path


def test_a_file_of_the_new_format_gives_the_motor(of_the_page, raw):
    columns = {"v": "v(in)", "i": "i(la)", "w": "v(speed)"}
    found = estimate_parameters(raw, columns=columns, units={"w": "rad/s"}, workers=1)
    assert max(abs(found.parameters[n].value / CML050.parameters[n] - 1) for n in NAMES) < 1e-6


def test_one_that_is_cut_short_is_one_sentence(of_the_page, raw):
    raw.write_bytes(raw.read_bytes()[:-5])
    with pytest.raises(RecordingError, match=r"^motor\.raw is cut short, or no binary raw file of real numbers; write"):
        read_recording(raw)


def test_without_it_the_file_is_refused_as_text(raw):
    with pytest.raises(RecordingError, match=r"motor\.raw"):
        read_recording(raw)

"""LabVIEW's measurement files of text: every layout of times, several segments, and what is wrong with one."""

import numpy as np
import pytest

from estimator.errors import RecordingError
from estimator.recordings.reading import read_recording

N, STEP = 40, 0.002
T, V = np.arange(N) * STEP, np.where(np.arange(N) < 10, 0.0, 6.0)
I = 1.5 * np.exp(-np.arange(N) / 8)  # noqa: E741
HEAD = (
    "LabVIEW Measurement\t\nWriter_Version\t2\nReader_Version\t2\nSeparator\tTab\nDecimal_Separator\t.\n"
    "Multi_Headings\tYes\n"
)
AFTER = (
    "Time_Pref\tAbsolute\nOperator\tme\nDate\t2026/11/24\nTime\t09:51:39,1970510124996275989\n"
    "***End_of_Header***\t\n\t\n"
)
LAYOUTS = ("No", "One", "Multi")


def segment(layout, rows, *, clock="09:51:40,5000000000000000000", names=("Motor Voltage", "Motor Current")):
    """Return a segment of two channels, its head's cells above the samples."""
    between = "\t\t" if layout == "Multi" else "\t"
    head = {
        "Channels": ["2"],
        "Samples": [f"{len(rows)}"] * 2,
        "Date": ["2026/11/24"] * 2,
        "Time": [clock] * 2,
        "Y_Unit_Label": ["Volts", "Amps"],
        "X_Dimension": ["Time"] * 2,
        "X0": ["0.0000000000000000E+0"] * 2,
        "Delta_X": [f"{STEP:f}"] * 2,
    }
    text = "".join(f"{key}\t{between.join(cells)}\t\n" for key, cells in head.items()) + "***End_of_Header***\t\t\t\n"
    text += "\t".join(["X_Value", names[0], *["X_Value"] * (layout == "Multi"), names[1], "Comment"]) + "\n"
    for t, v, i in rows:
        x = "" if layout == "No" else f"{t:f}"
        text += "\t".join([x, f"{v:f}", *[x] * (layout == "Multi"), "" if np.isnan(i) else f"{i:f}"]) + "\n"
    return text + "\n"


@pytest.fixture
def write(tmp_path):
    def write(layout, *segments, comma=".", separator="\t"):
        head = HEAD.replace("Separator\tTab", "Separator\tComma") if separator == "," else HEAD
        text = f"{head}X_Columns\t{layout}\n{AFTER}" + "".join(segments)
        path = tmp_path / "run.lvm"
        path.write_text(
            text.replace("\t", separator).replace(".", comma) if comma == "," else text.replace("\t", separator)
        )
        return path

    return write


@pytest.mark.parametrize(("comma", "separator"), [(".", "\t"), (",", "\t"), (".", ",")])
@pytest.mark.parametrize("layout", LAYOUTS)
def test_every_layout_of_times_is_read_with_its_units(write, layout, comma, separator):
    clock = "09:51:40.5" if separator == "," else "09:51:40,5000000000000000000"
    current = np.where(np.arange(N) == 5, np.nan, I)
    path = write(
        layout, segment(layout, list(zip(T, V, current, strict=True)), clock=clock), comma=comma, separator=separator
    )
    recording = read_recording(path)
    assert recording.step == STEP and recording.even
    assert recording.headers == {"Motor Voltage": "Motor Voltage [Volts]", "Motor Current": "Motor Current [Amps]"}
    assert recording.units == {"Motor Voltage": "V", "Motor Current": "A"}
    assert recording.signals["Motor Voltage"] == pytest.approx(V)
    assert recording.signals["Motor Current"] == pytest.approx(current, abs=1e-6, nan_ok=True)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_segments_follow_each_other_as_their_dates_say(write, layout):
    rows = list(zip(T, V, I, strict=True))
    second = segment(layout, rows[:20], clock=f"09:51:40,{500 + 20 * 2:03}0000")
    recording = read_recording(write(layout, segment(layout, rows[:20]), second))
    assert len(recording.time) == 40 and recording.step == pytest.approx(STEP) and recording.even
    assert recording.signals["Motor Current"] == pytest.approx(np.tile(I[:20], 2), abs=1e-6)


def test_what_is_wrong_with_one_is_told_in_a_sentence(write):
    rows = list(zip(T, V, I, strict=True))
    good = segment("One", rows)
    for text, sentence in (
        ("", "run.lvm holds no samples below ***End_of_Header***; write the measurement again"),
        (good + segment("One", rows, names=("u", "i")), "run.lvm holds segments of different channels; save each as"),
        (good.replace("1.500000", "OVER"), "run.lvm line 24: Motor Current is not a number ('OVER'); leave the cell"),
        (segment("No", rows).replace("0.002000", "?"), "run.lvm holds no channel with samples and a clock"),
        (segment("One", [(0.0, 1.0, 2.0)] * N), "run.lvm sample 1: time does not increase (0 s after 0 s); each row"),
    ):
        with pytest.raises(RecordingError) as caught:
            read_recording(write("One", text))
        assert str(caught.value).startswith(sentence)

"""Excel and TDMS recordings give what the same CSV gives; truth is the arrays that were written."""

import datetime
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from test_recording_files import CURRENT, RPM, TIME, N, V, W

from estimator.errors import RecordingError
from estimator.recordings.read_as import ReadAs
from estimator.recordings.reading import read_recording

HEADER = ["time [s]", "voltage [V]", "current [A]", "speed [rpm]"]
ROWS = [list(row) for row in zip(TIME.tolist(), V.tolist(), CURRENT.tolist(), RPM.tolist(), strict=True)]
NOON = datetime.datetime(2026, 11, 21, 12, 0, 0)


def xlsx(path: Path, *sheets: list[list]) -> Path:
    import openpyxl

    book = openpyxl.Workbook()
    book.remove(book.active)
    for k, rows in enumerate(sheets):
        sheet = book.create_sheet(f"run {k + 1}")
        for row in rows:
            sheet.append(row)
    book.save(path)
    return path


def refused(path: Path) -> str:
    with pytest.raises(RecordingError) as caught:
        read_recording(path)
    assert "\n" not in str(caught.value)
    return str(caught.value)


SHEETS = {
    "a header": [HEADER, *ROWS],
    "a title and a line of units": [
        ["Bench 4", None, "motor 17"],
        [],
        ["time", "voltage", "current", "speed"],
        ["s", "V", "A", "rpm"],
        *ROWS,
    ],
    "groups above the names": [["Time", "Electrical", None, "Mechanical"], HEADER, *ROWS],
    "a time that spans both rows": [["time [s]", "Motor", None, None], [None, *HEADER[1:]], *ROWS],
    "milliseconds": [["t [ms]", *HEADER[1:]], *([1e3 * row[0], *row[1:]] for row in ROWS)],
    "dates": [["timestamp", *HEADER[1:]], *([NOON + datetime.timedelta(seconds=r[0]), *r[1:]] for r in ROWS)],
    "times of day": [
        ["time", *HEADER[1:]],
        *([(NOON + datetime.timedelta(seconds=row[0])).time(), *row[1:]] for row in ROWS),
    ],
    "numbers as text": [HEADER, *([repr(row[0]).replace(".", ","), *row[1:]] for row in ROWS)],
    "columns of nothing": [[*HEADER, None, None], *([*row, None] for row in ROWS), [None] * 4],
    "a comment below the names": [HEADER, [None, None, None, "behind the gear"], *ROWS],
    "a mean and words below": [HEADER, *ROWS, [], ["Mean", 1.0, 2.0, 3.0], ["End of test"]],
    "a column of text": [[*HEADER, "note"], *([*row, "x"] for row in ROWS)],
}


@pytest.mark.parametrize("shape", SHEETS)
def test_every_usual_shape_of_an_excel_file_is_read(shape: str, tmp_path: Path) -> None:
    check_nearly(xlsx(tmp_path / "run3.xlsx", [["a plot"]], SHEETS[shape]))  # Excel keeps 16 digits


def test_words_below_the_last_row_of_excel_are_told(tmp_path: Path) -> None:
    recording = read_recording(xlsx(tmp_path / "run3.xlsx", [HEADER, *ROWS, [], ["Mean", 1.0], ["End"]]))
    assert recording.not_read == (f"rows {N + 3} to {N + 4}, below the last row, are left out: 'Mean', …",)


def test_a_sheet_of_few_rows_with_a_time_is_no_recording_beside_one(tmp_path: Path) -> None:
    check_nearly(xlsx(tmp_path / "run3.xlsx", [["time", "by"], [12, "J. Doe"]], [HEADER, *ROWS]))


@pytest.mark.parametrize("cell", [None, "NaN", "#N/A", "#DIV/0!"])
def test_an_empty_cell_of_excel_is_a_missing_sample(cell: str | None, tmp_path: Path) -> None:
    rows = [list(row) for row in ROWS]
    rows[7][2] = cell
    recording = read_recording(xlsx(tmp_path / "run3.xlsx", [HEADER, *rows]))
    assert np.flatnonzero(np.isnan(recording.signal("current"))).tolist() == [7]


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        (ROWS, ReadAs(columns={"time": "1", "v": "2"})),
        ([["", "bench 4", "", ""], *ROWS], ReadAs(columns={"time": "column 1", "v": "bench 4"})),
        ([HEADER[1:], ["V", "A", "rpm"], *(row[1:] for row in ROWS)], ReadAs(rate=1 / (ROWS[1][0] - ROWS[0][0]))),
        ([*ROWS, *([None, *row[1:]] for row in ROWS)], ReadAs(columns={"time": "1", "v": "2"})),
    ],
    ids=["no header", "a header without a time", "no time", "a time that ends before the others"],
)
def test_an_excel_file_without_a_header_or_a_time_is_read_as_the_user_says(rows, said, tmp_path: Path) -> None:
    path = xlsx(tmp_path / "run3.xlsx", rows)
    assert "there is no time column (" in refused(path) and "--rate HZ" in refused(path)
    recording = read_recording(path, said)
    volts = recording.signals[recording.roles.get("v") or "voltage"]
    assert volts == pytest.approx([row[1] for row in ROWS], rel=1e-15)


def test_an_excel_file_that_does_not_do_is_told_in_a_sentence(tmp_path: Path) -> None:
    path = tmp_path / "run3.xlsx"
    rows = [list(row) for row in ROWS]
    rows[7][2] = "overload"
    told = refused(xlsx(path, [HEADER, *rows]))
    assert told.startswith("run3.xlsx sheet 'run 1' row 9: current is not a number ('overload'); leave the cell")
    told = refused(xlsx(path, [HEADER, *ROWS], [HEADER, *ROWS]))
    assert told == "run3.xlsx holds recordings on the sheets 'run 1' and 'run 2'; save each as a file of its own"
    assert refused(xlsx(path, [["motor", "R"], [1, 2]])).startswith("run3.xlsx has no sheet with a time column; give")
    whole = path.read_bytes()
    path.write_bytes(whole[:2000])
    assert refused(path).startswith("run3.xlsx is a damaged Excel file (")
    listed = whole.index(b"PK\1\2")  # the first entry of the table of contents, its version 6 bytes on
    path.write_bytes(whole[: listed + 6] + b"\x41" + whole[listed + 7 :])
    assert refused(path) == "run3.xlsx is a damaged Excel file (zip file version 6.5); save it again"
    path.write_bytes(b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(600))
    assert refused(path) == "run3.xlsx is an Excel file of before 2007; save it as .xlsx or as CSV"


def test_another_archive_is_no_excel_file(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "run3.csv", "w") as archive:
        archive.writestr("modelDescription.xml", "<fmiModelDescription/>")
    assert "Excel" not in refused(tmp_path / "run3.csv")


def tdms(path: Path, groups: dict[str, dict[str, tuple[np.ndarray, dict]]]) -> Path:
    from nptdms import ChannelObject, TdmsWriter

    with TdmsWriter(path) as writer:
        for group, channels in groups.items():
            writer.write_segment([ChannelObject(group, n, values, p) for n, (values, p) in channels.items()])
    return path


def waveforms(step: float = 1e-3, **more: object) -> dict[str, tuple[np.ndarray, dict]]:
    of = {"wf_increment": step, "wf_start_offset": 0.0, **more}
    return {
        "voltage": (V, {**of, "unit_string": "V"}),
        "current": (1e3 * CURRENT, {**of, "unit_string": "mA"}),
        "speed": (RPM, {**of, "NI_UnitDescription": "rpm"}),
    }


def check_nearly(path: Path) -> None:
    recording = read_recording(path)
    np.testing.assert_allclose(recording.signal("current"), CURRENT, rtol=1e-14)
    np.testing.assert_allclose(recording.signal("speed"), W, rtol=1e-14)
    np.testing.assert_array_equal(recording.signal("voltage"), V)
    np.testing.assert_allclose(recording.time - recording.time[0], TIME, atol=1e-12)


def test_waveforms_of_labview_are_read_with_units_and_clock(tmp_path: Path) -> None:
    check_nearly(tdms(tmp_path / "run3.tdms", {"bench": waveforms()}))


@pytest.mark.parametrize(
    "clock",
    [
        {"time [ms]": (1e3 * TIME, {})},
        {"Time": (TIME, {"unit_string": "s"})},
        {"Time": (np.datetime64("2026-11-21T12:00:00", "us") + np.round(TIME * 1e6).astype("timedelta64[us]"), {})},
    ],
    ids=["ms", "s", "dates"],
)
def test_a_time_channel_of_labview_is_its_groups_clock(clock: dict, tmp_path: Path) -> None:
    plain = {
        name: (values, {k: p for k, p in properties.items() if not k.startswith("wf")})
        for name, (values, properties) in waveforms().items()
    }
    check_nearly(tdms(tmp_path / "run3.tdms", {"bench": {**clock, **plain}}))


def test_groups_of_labview_that_start_at_different_times_are_put_on_one_clock(tmp_path: Path) -> None:
    start = np.datetime64("2026-11-21T12:00:00", "us")
    first = waveforms(wf_start_time=start)
    late = {"speed": (RPM[5::5], {"wf_increment": 5e-3, "wf_start_time": start + 5000, "unit_string": "rpm"})}
    groups = {"fast": {n: first[n] for n in ("voltage", "current")}, "slow": late}
    recording = read_recording(tdms(tmp_path / "run3.tdms", groups))
    speed = recording.signal("speed")
    assert np.flatnonzero(~np.isnan(speed)).tolist() == list(range(5, N, 5))
    np.testing.assert_allclose(speed[5::5], W[5::5], rtol=1e-14)


def test_a_tdms_file_that_does_not_do_is_told_in_a_sentence(tmp_path: Path) -> None:
    path = tdms(tmp_path / "run3.tdms", {"bench": {"voltage": (V, {}), "note": (np.array(["a"] * N), {})}})
    assert refused(path).startswith("run3.tdms holds no channel of numbers with a clock; write waveforms")
    path.write_bytes(b"TDSm" + b"\7" * 100)
    assert refused(path).startswith("run3.tdms is a damaged TDMS file")


@pytest.mark.parametrize(("package", "extra", "name"), [("openpyxl", "xlsx", "openpyxl"), ("nptdms", "tdms", "npTDMS")])
def test_a_missing_extra_of_a_bench_is_told_with_how_to_install_it(package, extra, name, tmp_path, monkeypatch):
    path = tmp_path / f"run3.{extra}"
    if extra == "xlsx":
        xlsx(path, [HEADER, *ROWS])
    else:
        tdms(path, {"bench": waveforms()})
    monkeypatch.setitem(sys.modules, package, None)
    assert refused(path) == (
        f"run3.{extra} is {'an Excel' if extra == 'xlsx' else 'a TDMS'} file, which needs {name};"
        f" install it with: pip install 'fmu-estimator[{extra}]'"
    )


def test_a_row_of_units_of_a_sheet_may_hold_one_with_a_slash(tmp_path: Path) -> None:
    rows = [["Zeit", "Spannung", "Drehzahl"], ["ms", "V", "1/min"], *([k, 12.0, 30.0 * k] for k in range(20))]
    recording = read_recording(xlsx(tmp_path / "log.xlsx", rows))
    assert recording.units == {"Spannung": "V", "Drehzahl": "rad/s"}
    assert recording.signal("Drehzahl")[10] == pytest.approx(10 * np.pi)

"""Forms in which other labs publish logs, made anew from arrays that are known: headings, clocks, lines that broke."""

import bz2
import gzip
import json
import lzma
import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from estimator.cli import main
from estimator.errors import RecordingError
from estimator.recordings.files import recordings_in
from estimator.recordings.measured_signals import MeasuredSignals
from estimator.recordings.motor_columns import motor_columns
from estimator.recordings.plausibility import implausible
from estimator.recordings.read_as import AS_WRITTEN, ReadAs
from estimator.recordings.reading import read_recording, read_recordings

N, STEP, SPEED = 400, 5e-3, 27.5  # rows, s, rad/s
TIME = np.arange(N) * STEP
V = np.where(np.arange(N) < 50, 0.0, 10.0)
W = np.where(V > 0, SPEED * (1 - np.exp(-(TIME - 50 * STEP) / 0.16)), 0.0)
RNG = np.random.default_rng(7)


def save(folder: Path, header: str, *columns: np.ndarray, name: str = "log.csv", mark: str = ",") -> Path:
    rows = [mark.join(f"{x:.10g}" for x in row) for row in zip(*columns, strict=True)]
    path = folder / name
    path.write_text("\n".join([*([header] if header else []), *rows]) + "\n")
    return path


def sentence(path: Path, read_as: ReadAs = AS_WRITTEN) -> str:
    with pytest.raises(RecordingError) as caught:
        motor_columns(read_recording(path, read_as), required=("v",), either=("i", "w"))
    return str(caught.value)


@pytest.mark.parametrize("unit", ["steps/s", "step/s", "steps per second"])
def test_steps_of_an_encoder_a_second_are_a_speed_once_a_turn_is_said(unit: str, tmp_path: Path) -> None:
    path = save(tmp_path, f"Time (s),Voltage (V),Speed ({unit})", TIME, V, W * 1320 / (2 * np.pi))
    assert "say how many make a turn with --counts" in sentence(path)
    (recording,) = recordings_in(path, ReadAs(counts=1320))
    np.testing.assert_allclose(recording.signals[motor_columns(recording, required=("v", "w"))["w"]], W, atol=1e-6)


def test_a_column_called_steps_counts_no_encoder(tmp_path: Path) -> None:
    path = save(tmp_path, "time [s],step,speed [rad/s]", TIME, V, W)
    recording = read_recording(path, ReadAs(columns={"v": "step"}))
    np.testing.assert_array_equal(recording.signals[recording.roles["v"]], V)


@pytest.mark.parametrize(("unit", "factor"), [("millisec", 1e3), ("milisegundos", 1e3), ("microsec", 1e6)])
def test_units_of_time_in_other_spellings_are_known(unit: str, factor: float, tmp_path: Path) -> None:
    recording = read_recording(save(tmp_path, f"time ({unit}),voltage [V],speed [rad/s]", TIME * factor, V, W))
    np.testing.assert_allclose(recording.time, TIME, atol=1e-12)


def test_an_excel_file_that_is_called_csv_is_read(tmp_path: Path) -> None:
    import openpyxl

    book = openpyxl.Workbook()
    for row in [["time [s]", "voltage [V]", "speed [rad/s]"], *zip(TIME.tolist(), V.tolist(), W.tolist(), strict=True)]:
        book.active.append(list(row))
    book.save(tmp_path / "log.xlsx")
    shutil.move(tmp_path / "log.xlsx", tmp_path / "log.csv")
    recording = read_recording(tmp_path / "log.csv")
    np.testing.assert_allclose(recording.signals["speed"], W, rtol=1e-14)


class TestClocks:
    """Stamps of a computer that reads a serial line, and of a logger that begins."""

    begin = 1.7523602290e9  # s since 1970
    jitter = TIME + RNG.uniform(0, 0.3 * STEP, N)

    def test_a_row_that_a_jittering_clock_stamps_as_the_row_before_is_left_out_and_told(self, tmp_path: Path) -> None:
        stamps = self.jitter.copy()
        stamps[163] = stamps[162]
        recording = read_recording(save(tmp_path, "time [s],voltage [V],speed [rad/s]", stamps, V, W))
        kept = np.delete(np.arange(N), 163)
        np.testing.assert_array_equal(recording.signals["speed"], [float(f"{x:.10g}") for x in W[kept]])
        np.testing.assert_allclose(recording.time, stamps[kept], atol=1e-9)
        assert recording.not_read == ("log.csv line 165 is left out: stamped as the row before",)

    def test_of_an_exact_clock_or_in_many_rows_it_is_an_error(self, tmp_path: Path) -> None:
        exact = TIME.copy()
        exact[163] = exact[162]
        path = save(tmp_path, "time [s],voltage [V],speed [rad/s]", exact, V, W)
        assert "log.csv line 165: time does not increase (0.81 s after 0.81 s)" in sentence(path)
        many = self.jitter.copy()
        many[101:150:2] = many[100:149:2]
        path = save(tmp_path, "time [s],voltage [V],speed [rad/s]", many, V, W)
        assert "time does not increase" in sentence(path)

    def test_rows_that_are_stored_twice_with_their_time_are_left_out_and_told(self, tmp_path: Path) -> None:
        stored = np.sort(np.concatenate([np.arange(N), [57, 163]]))
        path = save(tmp_path, "time [s],voltage [V],speed [rad/s]", TIME[stored], V[stored], W[stored])
        recording = read_recording(path)
        np.testing.assert_array_equal(recording.signals["speed"], [float(f"{x:.10g}") for x in W])
        assert recording.not_read == (
            "2 rows, the first at log.csv line 60, are left out: the row before once more, its time too",
        )

    def test_rows_of_one_time_that_hold_a_signal_each_are_one_row(self, tmp_path: Path) -> None:
        """The second of them was left out, and a column was empty then, or lost half of its samples."""
        twice = np.repeat(np.arange(N), 2)
        first = np.arange(2 * N) % 2 == 0
        v, w = np.where(first, V[twice], np.nan), np.where(first, np.nan, W[twice])
        recording = read_recording(save(tmp_path, "time [s],voltage [V],speed [rad/s]", TIME[twice], v, w))
        np.testing.assert_array_equal(recording.signals["speed"], [float(f"{x:.10g}") for x in W])
        np.testing.assert_array_equal(recording.signals["voltage"], V)

    def test_times_that_count_from_a_date_are_told_with_the_digits_that_differ(self, tmp_path: Path) -> None:
        stamps = self.begin + self.jitter
        stamps[200] = stamps[199] - 0.25 * STEP
        path = tmp_path / "log.csv"
        rows = [f"{t:.6f},{v:g},{w:.4f}" for t, v, w in zip(stamps, V, W, strict=True)]
        path.write_text("\n".join(["timestamp,voltage [V],speed [rad/s]", *rows]) + "\n")
        told = sentence(path)
        later, before = told.split("(")[1].split(" s)")[0].split(" s after ")
        assert float(later) - self.begin == pytest.approx(stamps[200] - self.begin, abs=2e-4)
        assert float(before) > float(later)

    def test_a_first_row_whose_time_is_off_the_clock_is_left_out_and_told(self, tmp_path: Path) -> None:
        stamps = np.round(1e3 * (TIME + 0.1))
        stamps[0] = stamps[1] - 2
        recording = read_recording(save(tmp_path, "time [ms],voltage [V],speed [rad/s]", stamps, V, W))
        assert len(recording.time) == N - 1 and recording.even
        assert recording.not_read == ("the first row is left out: its time is off the clock of all others",)

    @pytest.mark.parametrize("stamp", [0.0, 990.0, 1.7e12])
    @pytest.mark.parametrize("print_step", [1, 20])  # ms: rows share times that are printed in the second
    def test_so_is_a_last_row(self, stamp: float, print_step: int, tmp_path: Path) -> None:
        stamps = print_step * np.floor(1e3 * TIME / print_step + 1e-6)
        stamps[-1] = stamp
        recording = read_recording(save(tmp_path, "time [ms],voltage [V],speed [rad/s]", stamps, V, W))
        assert len(recording.time) == N - 1 and recording.even
        assert "the last row is left out: its time is off the clock of all others" in recording.not_read

    def test_a_column_that_rises_evenly_is_named_where_none_is_called_time(self, tmp_path: Path) -> None:
        scipy_io = pytest.importorskip("scipy.io")
        path = tmp_path / "log.mat"
        scipy_io.savemat(path, {"data": np.vstack([TIME, V, W])})
        told = sentence(path)
        assert "'column 1' rises evenly, from 0 to 1.995: if it is the time" in told and "--column time=1" in told
        recording = read_recording(path, ReadAs(columns={"time": "1", "v": "2", "w": "3"}))
        np.testing.assert_array_equal(recording.signals[recording.roles["w"]], W)

    def test_a_column_that_counts_the_rows_is_named_as_no_time(self, tmp_path: Path) -> None:
        scipy_io = pytest.importorskip("scipy.io")
        scipy_io.savemat(tmp_path / "log.mat", {"data": np.vstack([np.arange(N), V, W])})
        assert "rises evenly" not in sentence(tmp_path / "log.mat")


class TestBrokenLines:
    """A serial line loses characters."""

    def broken(self, folder: Path, *at: int, header: str = "time [s],voltage [V],speed [rad/s]") -> Path:
        path = save(folder, header, TIME, V, W)
        lines = path.read_text().splitlines()
        for k in at:
            lines[k] = lines[k].partition(",")[2]
        path.write_text("\n".join(lines) + "\n")
        return path

    def test_a_row_without_all_its_cells_is_left_out_and_its_place_is_kept(self, tmp_path: Path) -> None:
        recording = read_recording(self.broken(tmp_path, 100))
        expected = np.array([float(f"{x:.10g}") for x in W])
        expected[99] = np.nan
        np.testing.assert_array_equal(recording.signals["speed"], expected)
        assert recording.missing_rows == 1
        assert (
            "line 101, '10,21.55270791', is left out" in recording.not_read[0]
            and "not as many cells" in recording.not_read[0]
        )

    def test_several_are_counted(self, tmp_path: Path) -> None:
        recording = read_recording(self.broken(tmp_path, 100, 200, 300))
        assert recording.missing_rows == 3 and "and 2 more are left out" in recording.not_read[0]

    def test_many_are_an_error(self, tmp_path: Path) -> None:
        assert "line 101 has too few cells (2, the header has 3)" in sentence(self.broken(tmp_path, *range(100, 105)))

    def test_without_times_in_the_file_one_is_an_error(self, tmp_path: Path) -> None:
        path = self.broken(tmp_path, 100)
        assert "line 101 has too few cells" in sentence(path, ReadAs(rate=200.0))

    def test_without_a_header_the_first_row_says_how_many_there_are(self, tmp_path: Path) -> None:
        path = self.broken(tmp_path, *range(100, 110), header="")
        told = sentence(path, ReadAs(columns={"time": "1", "v": "2", "w": "3"}))
        assert "has too few cells (2, the first row has 3)" in told


class TestNames:
    """Columns of which the name says that they drive the motor, and no more."""

    @pytest.mark.parametrize("name", ["final_u", "sig_volt", "input", "Input Signal"])
    def test_the_one_that_drives_is_suggested(self, name: str, tmp_path: Path) -> None:
        told = sentence(save(tmp_path, f"time,alpha,{name},vel", TIME, 0 * V, V, W))
        assert f"is it {name!r}?" in told

    def test_of_two_and_of_the_supplys_none_is(self, tmp_path: Path) -> None:
        assert "is it" not in sentence(save(tmp_path, "time,input_a,final_u,vel", TIME, V, V, W))
        assert "is it" not in sentence(save(tmp_path, "time,V bus,vel", TIME, V, W))


class TestAngles:
    """An angle of which nobody said the unit."""

    turned = np.cumsum(W) * STEP * 180 / np.pi

    def found(self, angle: np.ndarray, *, guessed: bool = True) -> list[str]:
        said = frozenset({"angle"}) if guessed else frozenset()
        found = implausible(MeasuredSignals("log.csv", TIME, {"v": V, "angle": angle}, guessed=said))
        return [f.sentence for f in found if f.kind == "unit angle"]

    def test_one_that_starts_again_at_360_looks_like_degrees(self) -> None:
        (told,) = self.found(self.turned % 360)
        assert "--unit angle=deg" in told
        (told,) = self.found((self.turned + 180) % 360 - 180)
        assert "--unit angle=deg" in told

    def test_whole_numbers_look_like_degrees_or_counts(self) -> None:
        (told,) = self.found(np.round(self.turned))
        assert "--unit angle=deg" in told and "--counts" in told

    def test_radians_and_what_is_said_are_not_doubted(self) -> None:
        radians = np.deg2rad(self.turned)
        assert self.found(radians) == self.found(radians % (2 * np.pi)) == []
        assert self.found(np.round(radians, 3)) == []
        assert self.found(self.turned % 360, guessed=False) == self.found(np.round(self.turned), guessed=False) == []


class TestConstantVoltage:
    """A step that begins before the log does, whose volts stand in the file's name."""

    def path(self, folder: Path) -> Path:
        return save(folder, "time angle speed", TIME, np.cumsum(W) * STEP, W, name="data_10V.txt", mark=" ")

    def test_check_takes_it_as_estimate_does(self, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
        assert main(["check", str(self.path(tmp_path)), "--fix", "v=10"]) == 0
        assert "v ← 10 V, constant, as you said · w ← speed" in capsys.readouterr().out

    def test_the_mended_copy_needs_no_option(self, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
        out = tmp_path / "mended.csv"
        assert main(["check", str(self.path(tmp_path)), "--fix", "v=10", "--mend", str(out)]) == 0
        (again,) = read_recordings(out)
        found = motor_columns(again, required=("v", "w"))
        assert set(again.signals[found["v"]]) == {10.0}
        np.testing.assert_allclose(again.signals[found["w"]], W, atol=1e-8)

    def test_what_check_cannot_hold_is_an_error(self, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
        assert main(["check", str(self.path(tmp_path)), "--fix", "R=3"]) == 2
        assert "check knows no parameters" in capsys.readouterr().err
        with_volts = save(tmp_path, "time [s],voltage [V],speed [rad/s]", TIME, V, W)
        assert main(["check", str(with_volts), "--fix", "v=10"]) == 2
        assert "has a voltage, 'voltage [V]'" in capsys.readouterr().err


class TestCurrentMeansPresent:
    """What a controller logs beside its setpoints: the current speed, which is no electric current."""

    @pytest.mark.parametrize(
        ("name", "role"),
        [
            ("current_speed", "w"),
            ("currentVelocity", "w"),
            ("current_velocity [rad/s]", "w"),
            ("current_speed_left", "w"),
            ("current wheel speed", "w"),
            ("current_position", "angle"),
        ],
    )
    def test_the_current_speed_is_a_speed(self, name: str, role: str, tmp_path: Path) -> None:
        recording = read_recording(save(tmp_path, f"time,voltage,{name},target_speed", TIME, V, W, 3 * V))
        found = motor_columns(recording, required=("v",), either=("i", "w"))
        assert found.keys() == {"v", role}
        np.testing.assert_allclose(recording.signals[found[role]], W, atol=1e-8)

    def test_in_rpm_too(self, tmp_path: Path) -> None:
        path = save(tmp_path, "time,voltage,current_rpm,desired_rpm", TIME, V, W * 30 / np.pi, V)
        recording = read_recording(path)
        found = motor_columns(recording, required=("v",), either=("i", "w"))
        assert found.keys() == {"v", "w"}
        np.testing.assert_allclose(recording.signals[found["w"]], W, atol=1e-8)

    def test_the_current_of_a_motor_or_in_amperes_is_one(self, tmp_path: Path) -> None:
        for name in ("current", "motor_current", "current [mA]", "current_ma", "current_a", "current sensor"):
            recording = read_recording(save(tmp_path, f"time,voltage,{name},speed,target", TIME, V, W, W, V))
            assert "i" in motor_columns(recording, required=("v",), either=("i", "w")), name

    def test_beside_what_is_desired_it_is_asked_for(self, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
        path = save(tmp_path, "time,u,current_m1,desired_m1", TIME, V, W, V)
        assert "--column w=current_m1, a speed, or --column i=current_m1" in sentence(path)
        for role, unit in (("w", "rad/s"), ("i", "A")):
            assert main(["check", str(path), "--column", f"{role}=current_m1"]) == 0
            assert f"{role} ← current_m1 (no unit: taken as {unit})" in capsys.readouterr().out


class TestWithoutAHeader:
    """The example of a file without a header is one that can be right."""

    def test_the_column_that_rises_is_the_examples_time(self, tmp_path: Path) -> None:
        assert "as in --column time=2 --column v=1" in sentence(save(tmp_path, "", V, TIME, W))
        assert "as in --column time=1 --column v=2" in sentence(save(tmp_path, "", np.tile(TIME[: N // 4], 4), V, W))

    def test_of_columns_that_do_not_rise_none_is(self, tmp_path: Path) -> None:
        told = sentence(save(tmp_path, "", V, RNG.normal(0, 1, N)))
        assert "as in --column v=1 --column w=2 --rate HZ, as no column rises like a time" in told


class TestABlockOfSettingsAboveBareNumbers:
    """Oscilloscopes that say names, units and the sampling interval once, above numbers without a header."""

    ROWS = tuple(zip(V.tolist(), W.tolist(), strict=True))

    def read(self, folder: Path, *lines: str) -> None:
        path = folder / "scope.csv"
        path.write_text("\n".join(lines) + "\n")
        recording = read_recording(path)
        assert recording.headers == {"CH1": "CH1 [V]", "CH2": "CH2 [A]"}
        np.testing.assert_allclose(recording.time, TIME, atol=1e-9)
        np.testing.assert_allclose(recording.signals["CH1"], V)
        np.testing.assert_allclose(recording.signals["CH2"], W)

    def test_yokogawa(self, tmp_path: Path) -> None:
        settings = ('"Model","DL850"', '"TraceName","CH1","CH2"', '"VUnit","V","A"', '"HResolution","5e-3","5e-3"')
        self.read(tmp_path, *settings, '"HUnit","s","s"', '"Time","12:00:00","12:00:00"', "",
                  *(f",{v!r},{w!r}" for v, w in self.ROWS))  # fmt: skip

    def gw_instek(self, mode: str) -> list[str]:
        said = {"Source": ("CH1", "CH2"), "Vertical Units": "VA", "Horizontal Units": "SS"}
        said |= {"Sampling Period": ("5.0E-03",) * 2, "Mode": (mode,) * 2, "Waveform Data": ("", "")}
        return ["Format,1.0B,", *("".join(f"{key},{value}," for value in values) for key, values in said.items())]

    def test_gw_instek_with_a_time_before_each_sample(self, tmp_path: Path) -> None:
        rows = (f"{t:.6e},{v!r},{t:.6e},{w!r}," for t, (v, w) in zip(TIME, self.ROWS, strict=True))
        self.read(tmp_path, *self.gw_instek("Detail"), *rows)

    def test_gw_insteks_counts_are_no_volts(self, tmp_path: Path) -> None:
        path = tmp_path / "scope.csv"
        rows = [f"{round(v * 10)},,{round(w)},," for v, w in self.ROWS]
        path.write_text("\n".join([*self.gw_instek("Fast"), *rows]) + "\n")
        assert "has no voltage column" in sentence(path)
        assert set(read_recording(path).headers) == {"CH1 raw", "CH2 raw"}

    @pytest.mark.parametrize("named", ["", "Time(s),"])
    def test_rigol_with_start_and_step_behind_the_names(self, named: str, tmp_path: Path) -> None:
        path = tmp_path / "scope.csv"
        rows = [f"{v!r},{w!r},," for v, w in self.ROWS]
        for times in ("", "with") if named else ("",):
            rows = [f"{t:.6e},{row}" for t, row in zip(TIME - 0.1, rows, strict=True)] if times else rows
            path.write_text("\n".join([f"{named}CH1V,CH2V,t0 = -0.1000000, tInc = 5.0e-03,", *rows]) + "\n")
            recording = read_recording(path)
            assert set(recording.headers.values()) == {"CH1 [V]", "CH2 [V]"}
            np.testing.assert_allclose(recording.time, TIME - 0.1, atol=1e-9)
            np.testing.assert_allclose(recording.signals["CH2"], W)


ROWS = tuple(zip([f"{t:.3f}" for t in TIME], map(repr, V.tolist()), map(repr, W.tolist()), strict=True))


def assert_read(path: Path) -> None:
    found = read_recording(path)
    columns = motor_columns(found, required=("v", "w"))
    np.testing.assert_allclose(found.time - found.time[0], TIME, atol=1e-9)
    np.testing.assert_array_equal(found.signals[columns["v"]], V)
    np.testing.assert_array_equal(found.signals[columns["w"]], W)


class TestCellsBetweenBars:
    """Tables of Markdown, psql and mysql, and programs that part cells by bars."""

    NAMES, RULE = "| time [s] | voltage [V] | speed [rad/s] |", "|---:|:---|----|"

    @pytest.mark.parametrize(
        ("above", "below"),
        [
            ((NAMES, RULE), ()),
            (("# A motor", "", "Its step:", "", NAMES, RULE), ("", "That was it.")),
            (("+------+---+----+", NAMES, "+------+---+----+"), ("+------+---+----+", "400 rows in set (0.00 sec)")),
            ((NAMES.strip("| "), "------+-------+-----"), ("(400 rows)",)),
        ],
    )
    def test_are_read(self, above: tuple[str, ...], below: tuple[str, ...], tmp_path: Path) -> None:
        path = tmp_path / "log.md"
        rows = (" | ".join(("", *row, ""))[1:-1] for row in ROWS)
        rows = (row.strip("| ") for row in rows) if above[0][0] == "t" else rows
        path.write_text("\n".join([*above, *rows, *below]) + "\n")
        assert_read(path)

    def test_a_decimal_comma_is_one(self, tmp_path: Path) -> None:
        path = tmp_path / "log.txt"
        path.write_text("\n".join(["time|voltage|speed", *("|".join(row).replace(".", ",") for row in ROWS)]) + "\n")
        assert_read(path)

    def test_bars_of_the_header_alone_part_nothing(self, tmp_path: Path) -> None:
        found = read_recording(save(tmp_path, "time,voltage,|speed|", TIME, V, W))
        assert "|speed|" in found.signals


class TestOneValueARow:
    """Rows of a time, a name and a value: of databases and message logs."""

    def write(self, folder: Path, *lines: str) -> Path:
        path = folder / "log.csv"
        path.write_text("\n".join(lines) + "\n")
        return path

    def test_foxglove_names_topics(self, tmp_path: Path) -> None:
        rows = (f"{t},17{t},/motor/{name},{x}" for t, v, w in ROWS for name, x in (("voltage", v), ("velocity", w)))
        assert_read(self.write(tmp_path, "elapsed time,receive time,topic,value", *rows))

    def test_influxdb_has_a_table_for_each_field_and_may_repeat_the_header(self, tmp_path: Path) -> None:
        header = ["#datatype,string,long,dateTime:RFC3339,double,string", ",result,table,_time,_value,_field"]
        stamps = [f"2026-11-20T10:00:0{t}Z".replace(".000Z", "Z") for t, _, _ in ROWS]
        tables = (
            [f",,{k - 1},{stamp},{row[k]},{name}" for stamp, row in zip(stamps, ROWS, strict=True)]
            for k, name in ((1, "voltage"), (2, "speed"))
        )
        assert_read(self.write(tmp_path, *(line for table in tables for line in (*header, *table, ""))))

    def test_a_state_that_is_said_now_and_then_makes_no_row(self, tmp_path: Path) -> None:
        rows = (f"{t},NT:/motor/{name},{x}" for t, v, w in ROWS for name, x in (("voltage", v), ("velocity", w)))
        said = ("-0.7,systemTime,1700000000", '-0.5,messages,"on, ok"', "0.1012,DS:enabled,true")
        path = self.write(tmp_path, "Timestamp,Name,Value", *said, *rows)
        assert_read(path)
        assert {"systemTime", "messages", "DS:enabled"} <= set(read_recording(path).headers)

    def test_too_many_names_at_too_many_times_are_told(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        """16 MB of a robot's log, 200 names at 600 000 times, took two minutes."""
        monkeypatch.setattr("estimator.recordings.long_lines.CELLS", 799)
        rows = (f"{t},{name},{x}" for t, v, w in ROWS for name, x in (("voltage", v), ("speed", w)))
        told = sentence(self.write(tmp_path, "time,name,value", *rows))
        assert told == "log.csv holds values of 2 names at 400 times; keep the motor's signals alone"

    def test_a_name_and_a_value_beside_a_motors_columns_are_columns(self, tmp_path: Path) -> None:
        rows = (f"{t},run 7,{k},{v},{w}" for k, (t, v, w) in enumerate(ROWS))
        assert_read(self.write(tmp_path, "time,name,value,voltage,speed", *rows))

    def test_a_column_of_units_says_them(self, tmp_path: Path) -> None:
        rows = (f"{t};{n};{x};{u}" for t, v, w in ROWS for n, x, u in (("voltage", v, "V"), ("speed", w, "rad/s")))
        path = self.write(tmp_path, "time;signal;value;unit", *(row.replace(".", ",") for row in rows))
        assert_read(path)
        assert set(read_recording(path).headers.values()) == {"voltage [V]", "speed [rad/s]"}

    def test_what_is_logged_less_often_is_missing_between(self, tmp_path: Path) -> None:
        rows = (
            f"{t},{name},{x}"
            for k, (t, v, w) in enumerate(ROWS)
            for name, x in (("voltage", v), *([("speed", w)] if k % 10 == 0 else []))
        )
        found = read_recording(self.write(tmp_path, "time [s],signal,value", *rows))
        np.testing.assert_array_equal(found.signals["voltage"], V)
        np.testing.assert_array_equal(found.signals["speed"], np.where(np.arange(N) % 10, np.nan, W))

    def test_a_bad_value_is_told_with_the_line_that_it_stands_in(self, tmp_path: Path) -> None:
        rows = [f"{t},{name},{x}" for t, v, w in ROWS for name, x in (("voltage", v), ("speed", w))]
        rows[41] += "x"  # in line 43
        assert "log.csv line 43: speed is not a number" in sentence(self.write(tmp_path, "time,signal,value", *rows))

    @pytest.mark.parametrize("unit", ["", "§V|g"])
    def test_teleplot(self, unit: str, tmp_path: Path) -> None:
        rows = (f">{name}:{round(1000 * float(t))}:{x}{unit if name == 'voltage' else ''}" for t, v, w in ROWS
                for name, x in (("voltage", v), ("speed", w)))  # fmt: skip
        path = self.write(tmp_path, "booting", *rows)
        assert_read(path)

    def test_teleplots_lines_may_hold_several_samples_and_times_of_day_are_none(self, tmp_path: Path) -> None:
        parts = [ROWS[k : k + 50] for k in range(0, N, 50)]
        rows = (
            f"{name}:{';'.join(f'{round(1000 * float(row[0]))}:{row[j]}' for row in part)}"
            for part in parts
            for j, name in ((1, "voltage"), (2, "speed"))
        )
        assert_read(self.write(tmp_path, *rows))
        many = ":".join(["7" * 40] * 40)  # each of its ways to be split was tried
        assert "there is no time column" in sentence(self.write(tmp_path, *[f"Time:12:34:{many} x|y z"] * 20))

    @pytest.mark.parametrize("series", ["motor,bench=2", "motor"])
    def test_influx_line_protocol(self, series: str, tmp_path: Path) -> None:
        lines = (
            f'{series} voltage={v},speed={w},count={k}i,state="run, 1" {1_700_000_000_000_000_000 + 5_000_000 * k}'
            for k, (_, v, w) in enumerate(ROWS)
        )
        found = read_recording(self.write(tmp_path, *lines))
        np.testing.assert_allclose(found.time, TIME, atol=1e-9)
        np.testing.assert_array_equal(found.signals["voltage"], V)
        np.testing.assert_array_equal(found.signals["speed"], W)
        np.testing.assert_array_equal(found.signals["count"], np.arange(N))

    def test_series_of_influx_are_told_apart_by_their_names(self, tmp_path: Path) -> None:
        rows = [(k, row, bench) for k, row in enumerate(ROWS) for bench in "ab"]
        lines = (f"motor,bench={b} voltage={v},speed={w}{'0' * (b == 'b')} {5_000_000 * k}" for k, (_, v, w), b in rows)
        found = read_recording(self.write(tmp_path, *lines), ReadAs(units={"time": "ns"}))
        assert [name for name in found.signals if name.endswith("speed")] == [
            "motor,bench=a speed",
            "motor,bench=b speed",
        ]

    @pytest.mark.parametrize("mark", ["\t", ";"])
    def test_twincat_scope_has_a_time_for_each_signal(self, mark: str, tmp_path: Path) -> None:
        settings = [("Name", "Scope"), ("Starttime of export", "133123456789012345"), ("",)]
        settings += [(key, of_v, key, of_w) for key, of_v, of_w in (("Name", "voltage", "speed"),
                     ("SampleTime[ms]", "5", "50"), ("Port", "851", "851"), ("Unit", "V", "rad/s"))]  # fmt: skip
        speeds = [(f"{50 * k}", row[2]) for k, row in enumerate(ROWS[::10])]
        rows = ((f"{5 * k}", v, *(speeds[k] if k < len(speeds) else ("", ""))) for k, (_, v, _) in enumerate(ROWS))
        path = self.write(tmp_path, *(mark.join(cells) for cells in (*settings, *rows)))
        found = read_recording(path)
        assert found.headers == {"voltage": "voltage [V]", "speed": "speed [rad/s]"}
        np.testing.assert_allclose(found.time, TIME, atol=1e-9)
        np.testing.assert_array_equal(found.signals["speed"], np.where(np.arange(N) % 10, np.nan, W))


COLUMNS = {"time": TIME.tolist(), "voltage": V.tolist(), "speed": W.tolist()}
OBJECTS = [dict(zip(COLUMNS, row, strict=True)) for row in zip(*COLUMNS.values(), strict=True)]
NESTED = [{"time": row["time"], "motor": {"voltage": row["voltage"], "speed": row["speed"]}} for row in OBJECTS]
LINES = "\n".join(map(json.dumps, OBJECTS))


@pytest.mark.parametrize(
    "text",
    [
        json.dumps(OBJECTS, indent=1),
        json.dumps(COLUMNS),
        json.dumps(NESTED),
        json.dumps({"channel": {"id": 7}, "feeds": OBJECTS}),
        json.dumps({name: dict(enumerate(column)) for name, column in COLUMNS.items()}),  # as pandas writes it
        LINES,
        f"{LINES}\n\n",
    ],
)
def test_a_table_in_json_is_read(text: str, tmp_path: Path) -> None:
    path = tmp_path / "log.json"
    path.write_text(text)
    assert_read(path)
    assert len(recordings_in(path)) == 1


def test_in_json_null_is_a_missing_sample_and_a_stamp_a_time(tmp_path: Path) -> None:
    path = tmp_path / "log.json"
    stamps = [f"2026-11-20T10:00:0{t:.3f}Z" for t in TIME]
    rows = [row | {"time": stamp} for row, stamp in zip(OBJECTS, stamps, strict=True)]
    rows[5] = rows[5] | {"speed": None}
    path.write_text(json.dumps(rows))
    found = read_recording(path)
    np.testing.assert_allclose(found.time, TIME, atol=1e-9)
    assert np.flatnonzero(np.isnan(found.signals["speed"])).tolist() == [5]


def test_a_last_line_of_json_that_is_cut_off_is_told_and_another_is_no_json(tmp_path: Path) -> None:
    path = tmp_path / "log.jsonl"
    path.write_text(f'{LINES}\n{{"time": 2.0, "vol')
    assert read_recording(path).not_read == (
        f"""line {N + 1}, the last row, is cut off and left out: '{{"time": 2.0, "vol'""",
    )
    path.write_text(f"{LINES}\nend\n{LINES}")
    assert "log.jsonl begins as JSON and is none" in sentence(path)


@pytest.mark.parametrize("kind", ["npz", "fields", "matrix"])
def test_arrays_of_numpy_are_read(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "log.npz"
    says = AS_WRITTEN
    with path.open("wb") as file:
        if kind == "npz":
            np.savez(file, time=TIME, voltage=V, speed=W, about=np.array(7.0))
        elif kind == "fields":
            np.save(file, np.array(list(zip(TIME, V, W, strict=True)), dtype=[(name, "f8") for name in COLUMNS]))
        else:
            np.save(file, np.array([TIME, V, W]))
            says = ReadAs(columns={"time": "1", "v": "2", "w": "3"})
    found = read_recording(path, says)
    columns = motor_columns(found, required=("v", "w"))
    np.testing.assert_allclose(found.time, TIME, atol=1e-12)
    np.testing.assert_array_equal(found.signals[columns["w"]], W)


def test_arrays_of_objects_and_damaged_ones_are_refused_in_a_sentence(tmp_path: Path) -> None:
    path = tmp_path / "log.npz"
    np.savez(path, time=np.array([{}], dtype=object))
    assert "log.npz cannot be read (Object arrays cannot be loaded" in sentence(path)
    np.savez(path, time=np.array(1.0))
    assert "log.npz holds no vectors" in sentence(path)
    np.savez(path, time=TIME)
    path.write_bytes(path.read_bytes()[:2000])
    assert "log.npz cannot be read" in sentence(path)


@pytest.mark.parametrize("pack", [gzip.compress, bz2.compress, lzma.compress])
def test_a_compressed_file_is_told_to_be(pack: Callable[[bytes], bytes], tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_bytes(pack(b"time,voltage\n0,1\n" * 99))
    assert "log.csv is compressed; unpack it" in sentence(path)


def test_a_motors_columns_go_before_the_batterys_of_the_same_device(tmp_path: Path) -> None:
    names = ",".join(f"knee[Dephy]:{of}_{name}" for name in ("current", "voltage") for of in ("battery", "motor"))
    found = read_recording(save(tmp_path, f"time,{names},velocity", TIME, V / 9, V / 7, V + 30, V, W))
    columns = motor_columns(found)
    assert (columns["i"], columns["v"]) == ("knee[Dephy]:motor_current", "knee[Dephy]:motor_voltage")


def test_a_path_before_the_times_name_is_passed_over(tmp_path: Path) -> None:
    for name in ("OSL:timestamp", "/clock/time", "log.timestamp"):
        found = read_recording(save(tmp_path, f"{name},knee[Dephy]:motor_voltage,/motor/velocity", TIME, V, W))
        assert motor_columns(found, required=("v", "w")) == {"v": "knee[Dephy]:motor_voltage", "w": "/motor/velocity"}
        np.testing.assert_allclose(found.time, TIME, atol=1e-12)


@pytest.mark.parametrize("clock", [TIME, 1000 + TIME])
def test_an_index_without_a_name_is_the_time_unless_it_counts_rows(clock: np.ndarray, tmp_path: Path) -> None:
    recording = read_recording(save(tmp_path, ",voltage,speed [rad/s]", clock, V, W))
    np.testing.assert_allclose(recording.time - recording.time[0], TIME, atol=1e-6)
    assert "there is no time column" in sentence(save(tmp_path, ",voltage,speed [rad/s]", np.arange(N) + 7.0, V, W))


class TestAVoltageThatStaysWhileTheDutyCycleIsNone:
    """It is the supply's, whatever it is called."""

    def test_is_multiplied_by_it(self, tmp_path: Path) -> None:
        path = save(
            tmp_path, "time,input_voltage,motor_temp,duty,speed [rad/s]", TIME, 24 - V / 20, 0 * V + 30, V / 20, W
        )
        (recording,) = recordings_in(path)
        found = motor_columns(recording, required=("v", "w"))
        np.testing.assert_allclose(recording.signals[found["v"]], V / 20 * (24 - V / 20), atol=1e-9)

    def test_is_not_taken_beside_counts_of_it(self, tmp_path: Path) -> None:
        path = save(tmp_path, "time,present_input_voltage,present_pwm,speed [rad/s]", TIME, 0 * V + 120, 88 * V, W)
        assert "'present_pwm' is a duty cycle: say of which supply" in sentence(path)

    def test_a_voltage_that_follows_it_is_the_motors(self, tmp_path: Path) -> None:
        for part in (V / 20, V / 10 - 0.5):  # and of a bridge that rests at a half
            path = save(tmp_path, "time,input_voltage,duty,speed [rad/s]", TIME, 24 * part, V / 20, W)
            (recording,) = recordings_in(path)
            np.testing.assert_allclose(
                recording.signals[motor_columns(recording, required=("v", "w"))["v"]], 24 * part, atol=1e-9
            )


def test_an_electrical_speed_needs_its_pole_pairs(tmp_path: Path) -> None:
    path = save(tmp_path, "time,voltage,ERPM", TIME, V, 7 * W * 30 / np.pi)
    says = ReadAs(columns={"w": "ERPM"})
    assert "'ERPM' is no unit of angular speed" in sentence(path, says)
    assert "--unit w=rpm --scale w=0.25 that there are 4 pole pairs" in sentence(path, says)
    recording = read_recording(path, ReadAs(columns={"w": "ERPM"}, units={"w": "rpm"}))
    np.testing.assert_allclose(recording.signals[recording.roles["w"]], 7 * W, atol=1e-8)


@pytest.mark.parametrize("unit", ["giri/min", "obr/min", "ot/min", "devir/dk"])
def test_turns_a_minute_are_known_in_other_languages(unit: str, tmp_path: Path) -> None:
    recording = read_recording(save(tmp_path, f"time [s],voltage [V],speed [{unit}]", TIME, V, W * 30 / np.pi))
    np.testing.assert_allclose(recording.signals["speed"], W, atol=1e-8)


def test_a_long_line_of_json_is_told_at_once(tmp_path: Path) -> None:
    path = tmp_path / "log.json"
    row = '{"time": 0.001, "voltage": 12.0, "current": 0.5}'
    path.write_text(f"[{', '.join([row] * 20_000)}]")  # a header's brackets were looked for from each character on
    with pytest.raises(RecordingError, match=r"log\.json sample 1: time does not increase"):
        recordings_in(path)
    path = path.rename(tmp_path / "log.txt")
    path.write_text(f"x {' '.join([row] * 20_000)})")
    with pytest.raises(RecordingError, match="there is no time column"):
        recordings_in(path)


def test_cells_may_hold_their_unit_if_it_is_one_for_all(tmp_path: Path) -> None:
    rows = [f"{t:.3f} s,{v:.1f} V,{w:.6f} rad/s" for t, v, w in zip(TIME, V, W, strict=True)]
    rows[7] = rows[7].rsplit(",", 1)[0] + ","
    path = tmp_path / "log.csv"
    path.write_text("\n".join(["time,voltage,speed", *rows]) + "\n")
    recording = read_recording(path)
    assert recording.headers == {"voltage": "voltage [V]", "speed": "speed [rad/s]"}
    np.testing.assert_allclose(recording.time, TIME, atol=1e-9)
    np.testing.assert_allclose(np.delete(recording.signals["speed"], 7), np.delete(W, 7), atol=1e-6)
    assert np.isnan(recording.signals["speed"][7])
    path.write_text(path.read_text().replace("10.0 V", "10000 mV", 5))
    assert "is not a number" in sentence(path)  # of two units none is everybody's


def test_labels_may_stand_before_equals_signs(tmp_path: Path) -> None:
    path = tmp_path / "log.txt"
    path.write_text("".join(f"t={t:.3f}, v={v:.1f}, w={w:.6f}\n" for t, v, w in zip(TIME, V, W, strict=True)))
    recording = read_recording(path)
    np.testing.assert_allclose(recording.signals["w"], W, atol=1e-6)
    settings = "".join(f"setting {k} = {k}\n" for k in range(40))  # above the header they are no rows
    path.write_text(settings + save(tmp_path, "time,voltage,speed", TIME, V, W).read_text())
    np.testing.assert_allclose(read_recording(path).time, TIME, atol=1e-9)


def test_a_functions_argument_is_no_unit(tmp_path: Path) -> None:
    recording = read_recording(save(tmp_path, "t,u(t) [V],w(t)", TIME, V, W))
    found = motor_columns(recording, required=("v", "w"))
    np.testing.assert_array_equal(recording.signals[found["v"]], V)
    path = save(tmp_path, "t,V(motor),speed", TIME, V, W)
    assert "'motor' is not a known unit" in sentence(path) and "--unit" in sentence(path)


def test_a_speed_in_kilometres_an_hour_needs_the_wheel(tmp_path: Path) -> None:
    path = save(tmp_path, "time,voltage,speed [km/h]", TIME, V, W * 0.05 * 3.6)
    assert "or say with --per-turn how many metres a turn goes" in sentence(path)
    (recording,) = recordings_in(path, ReadAs(per_turn=0.1 * np.pi))
    np.testing.assert_allclose(recording.signals[motor_columns(recording, required=("w",))["w"]], W, atol=1e-6)


def test_an_input_of_iddata_without_a_name_is_suggested(tmp_path: Path) -> None:
    assert "is it 'u1'?" in sentence(save(tmp_path, "time,u1,y1", TIME, V, W))
    assert "is it" not in sentence(save(tmp_path, "time,u1,u2,y1", TIME, V, V, W))


class TestMessagesOfRos:
    """What `rostopic echo` and `ros2 topic echo` print of a topic, kept in a file."""

    def save(self, folder: Path, message: Callable[[int, int, int], str], end: str = "---\n") -> Path:
        ticks = [divmod(round(t * 1e9), 10**9) for t in TIME]
        path = folder / "motor.yaml"
        path.write_text("---\n".join(message(k, *tick) for k, tick in enumerate(ticks)) + end)
        return path

    def test_each_message_is_a_row_at_its_stamp(self, tmp_path: Path) -> None:
        def message(k: int, s: int, ns: int) -> str:
            stamp = f"header: \n  seq: {k}\n  stamp: \n    secs: {s + 1700000000}\n    nsecs: {ns}\n  frame_id: ''\n"
            return f"{stamp}voltage: {V[k]}\nspeed: {float(W[k])}\nmode: running\n"

        recording = read_recording(self.save(tmp_path, message))
        np.testing.assert_allclose(recording.time, TIME, atol=1e-6)
        np.testing.assert_array_equal(recording.signals["speed"], W)
        np.testing.assert_array_equal(recording.signals["voltage"], V)

    @pytest.mark.parametrize("is_flow", [False, True])
    def test_values_of_a_list_have_the_names_beside_it(self, is_flow: bool, tmp_path: Path) -> None:
        def listed(key: str, *values: object) -> str:
            items = [f"{key}: [{', '.join(map(str, values))}]"] if is_flow else [f"{key}:", *(f"- {x}" for x in values)]
            return "\n".join(items) + "\n"

        def message(k: int, s: int, ns: int) -> str:
            names = listed("name", "left_wheel", "right_wheel")
            stamp = f"header:\n  stamp:\n    sec: {s}\n    nanosec: {ns}\n  frame_id: ''\n"
            return stamp + names + listed("velocity", float(W[k]), 0.5) + "effort: []\n"

        recording = read_recording(self.save(tmp_path, message))
        np.testing.assert_array_equal(recording.signals["left_wheel.velocity"], W)
        np.testing.assert_array_equal(recording.signals["right_wheel.velocity"], 0.5)

    @pytest.mark.parametrize("item", ["- ", "- \n    "])
    def test_items_of_structures_are_numbered_and_a_message_that_is_cut_off_is_left_out(
        self, item: str, tmp_path: Path
    ) -> None:
        def message(k: int, s: int, ns: int) -> str:
            motors = f"motors:\n  {item}id: 4\n    speed: {float(W[k])}\n  {item}id: 5\n    speed: 0.0\n"
            return f"stamp:\n  sec: {s}\n  nanosec: {ns}\n{motors}volts: {V[k]}\n"

        recording = read_recording(self.save(tmp_path, message, end="---\nstamp:\n  sec: 9\n"))
        np.testing.assert_array_equal(recording.signals["motors.1.speed"], W)
        np.testing.assert_array_equal(recording.signals["volts"], V)
        assert recording.not_read == ("the last message is cut off and left out",)

    def test_messages_of_words_are_told_to_be_such(self, tmp_path: Path) -> None:
        told = sentence(self.save(tmp_path, lambda k, s, ns: "data: stop\n"))
        assert told == "motor.yaml holds messages of ROS without numbers; record a topic that has the signals"

    def test_messages_without_a_stamp_are_rows_without_a_time(self, tmp_path: Path) -> None:
        path = self.save(tmp_path, lambda k, s, ns: f"data: {float(W[k])}\n")
        assert sentence(path).startswith("motor.yaml: there is no time column (data); one column should be called time")
        np.testing.assert_array_equal(read_recording(path, ReadAs(rate=200)).signals["data"], W)


class TestSignalsInLines:
    """A table whose lines are signals."""

    @pytest.mark.parametrize(
        ("names", "line"),
        [
            (("time [s]", "voltage [V]", "speed [rad/s]"), "{},{}"),
            (('"time"', '"voltage"', '"speed"'), "{};{}"),
            (("time\ts", "voltage\tV", "speed\trad/s"), "{}\t{}\t"),
            (("time", "voltage", "speed"), "{}: [{}]"),
        ],
    )
    def test_it_is_read(self, names: tuple[str, ...], line: str, tmp_path: Path) -> None:
        mark = next((m for m in ";\t" if m in line), ",")
        samples = [mark.join(f"{x:.10g}" for x in signal) for signal in (TIME, V, W)]
        samples = [text.replace(".", ",") for text in samples] if mark == ";" else samples
        path = tmp_path / "log.csv"
        path.write_text("\n".join(line.format(*pair) for pair in zip(names, samples, strict=True)) + "\n")
        recording = read_recording(path)
        np.testing.assert_allclose(recording.time, TIME, atol=1e-12)
        np.testing.assert_allclose(recording.signals["speed"], W, atol=1e-7)
        np.testing.assert_array_equal(recording.signals["voltage"], V)

    @pytest.mark.parametrize("between", [" ", ", ", ",\n  "])
    @pytest.mark.parametrize("end", ["]\n", "];\n"])
    def test_a_list_is_read_however_it_is_written(self, between: str, end: str, tmp_path: Path) -> None:
        path = tmp_path / "log.m"
        pairs = (("time", TIME), ("voltage", V), ("speed", W))
        path.write_text("".join(f"{name} = [{between.join(map(str, x.tolist()))}{end}" for name, x in pairs))
        np.testing.assert_array_equal(read_recording(path).signals["speed"], W)

    def test_lists_of_yaml_with_an_item_in_each_line_are_read(self, tmp_path: Path) -> None:
        path = tmp_path / "log.yaml"
        pairs = (("time", TIME), ("voltage", V), ("speed", W))
        path.write_text("".join(f"{name}:\n" + "".join(f"- {x}\n" for x in signal) for name, signal in pairs))
        recording = read_recording(path)
        np.testing.assert_array_equal(recording.signals["speed"], W)
        np.testing.assert_array_equal(recording.signals["voltage"], V)

    def test_a_line_that_is_shorter_is_named(self, tmp_path: Path) -> None:
        path = tmp_path / "log.csv"
        pairs = (("time [s]", TIME), ("voltage [V]", V), ("speed [rad/s]", W[:-1]))
        path.write_text("\n".join(",".join([name, *map(str, signal)]) for name, signal in pairs))
        told = sentence(path)
        assert told.startswith(
            "log.csv holds a signal in each line, and line 3 is none, or not as long as the first (400"
        )

    def test_lines_without_names_are_told_to_be_signals(self, tmp_path: Path) -> None:
        path = tmp_path / "log.txt"
        np.savetxt(path, [TIME, V, W], fmt="%.6g")
        told = sentence(path)
        assert told.startswith("log.txt holds a signal in each line (3 lines of 400 numbers) and no names; write")


class TestPages:
    """Tables of HTML, which some programs call .xls, and of a spreadsheet's XML."""

    def rows(self, row: str, cell: str, between: str) -> str:
        cells = [["time [s]", "voltage [V]", "speed [rad/s]"], *np.column_stack([TIME, V, W]).tolist()]
        return between.join(row.format("".join(cell.format(x) for x in line)) for line in cells)

    @pytest.mark.parametrize("between", ["", "\n"])
    def test_the_longest_table_of_a_page_is_read(self, between: str, tmp_path: Path) -> None:
        path = tmp_path / "log.xls"
        small = "<table><tr><td>motor</td><td>7</td></tr></table>"
        long = self.rows("<tr>{}</tr>", "<td> <b>{}</b>\n</td>", between)
        path.write_text(f"<!DOCTYPE html><html><style>td {{}}</style><body>{small}<table>{long}</table>{small}</body>")
        recording = read_recording(path)
        np.testing.assert_array_equal(recording.signals["speed"], W)

    def test_a_spreadsheet_of_xml_is_read(self, tmp_path: Path) -> None:
        path = tmp_path / "log.xml"
        rows = self.rows("<Row>{}</Row>", "<Cell><Data>{}</Data></Cell>", "\n")
        path.write_text(f'<?xml version="1.0"?>\n<Workbook><Worksheet><Table>{rows}</Table></Worksheet></Workbook>')
        np.testing.assert_array_equal(read_recording(path).signals["speed"], W)

    def test_a_page_without_a_table_is_told_to_have_none(self, tmp_path: Path) -> None:
        path = tmp_path / "log.html"
        path.write_text("<html><body>404</body></html>")
        assert sentence(path).startswith("log.html holds no table of samples; it should begin with a header such as")


def test_a_spreadsheet_of_opendocument_is_told_to_be_one(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "log.ods", "w") as archive:
        archive.writestr("mimetype", "application/vnd.oasis.opendocument.spreadsheet")
        archive.writestr("content.xml", "<x/>")
    assert sentence(tmp_path / "log.ods") == "log.ods is an OpenDocument file; save it as .xlsx or as CSV"

"""Logs as they come: clocks, several tests or motors in a file, duty cycles, wheels, counts, files without a header."""

import json

import numpy as np
import pytest

from estimator.cases.case import case_for_recording, read_case
from estimator.cli import main
from estimator.errors import RecordingError
from estimator.fmus.fmu import describe
from estimator.plans.planning import plan_case
from estimator.recordings.files import motors_in, recordings_in
from estimator.recordings.motor_columns import motor_columns
from estimator.recordings.read_as import ReadAs
from estimator.recordings.reading import read_recording, read_recordings
from estimator.recordings.understood import understood

N = 60
T = np.arange(N) / 100
V = np.where(np.arange(N) < 10, 0.0, 6.0)
I = 1.5 * np.exp(-np.clip(np.arange(N) - 10, 0, None) / 8) * (V > 0)  # noqa: E741
W = 100 * (1 - np.exp(-np.clip(np.arange(N) - 10, 0, None) / 12))


@pytest.fixture
def write(tmp_path):
    def write(header, *columns, name="log.csv", comma=","):
        rows = "\n".join(
            comma.join(x if isinstance(x, str) else f"{x:.9g}" for x in row) for row in zip(*columns, strict=True)
        )
        path = tmp_path / name
        path.write_text(f"{header}\n{rows}\n" if header else f"{rows}\n")
        return path

    return write


def one(path, **said):
    (recording,) = recordings_in(path, ReadAs(**said))
    return recording


def refused(path, sentence, **said):
    with pytest.raises(RecordingError) as caught:
        for recording in recordings_in(path, ReadAs(**said)):
            motor_columns(recording, required=("v",), either=("i", "w"))
    assert sentence in str(caught.value)


# --- clocks -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("spread", [0.03, 0.3, 0.8])
def test_a_clock_is_believed_whatever_its_spread(write, spread):
    rng = np.random.default_rng(1)
    times = np.cumsum(0.01 * (1 + spread * rng.uniform(-1, 1, N)))
    recording = one(write("t,u,i,w", times, V, I, W))
    assert not recording.even and recording.missing_rows == 0
    np.testing.assert_allclose(recording.time, times, atol=1e-9)


def test_of_a_clock_that_jitters_a_single_late_sample_is_believed(write):
    times = T + 2e-5 * np.sin(7 * np.arange(N))
    times[20] += 5e-4
    assert not one(write("t,u,i,w", times, V, I, W)).even


@pytest.mark.parametrize(
    ("first", "left_out"), [((0.0, 0.0), 1), ((1.074, 0.0), 1), ((3.0, 1.0, 0.0), 2), ((0.0,) * 9, 8)]
)
def test_first_stamps_that_are_no_earlier_than_the_next_are_left_out(write, capsys, first, left_out):
    times = np.concatenate([first, T[1 : N + 1 - len(first)]])
    path = write("t,u,i,w", times, V, I, W)
    recording = one(path)
    assert len(recording.time) == N - left_out
    assert main(["check", str(path)]) == 0
    first = "the first row is" if left_out == 1 else f"the first {left_out} rows are"
    assert f"{first} left out: the next is stamped no later" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("end", "told"),
    [
        ("\n", ()),
        ("", ()),
        ("\nEnd of test\n", ("line 62, below the last row, is left out: 'End of test'",)),
        ("\n^CTraceback:\n  File x\n", ("lines 62 to 63, below the last row, are left out: '^CTraceback:', …",)),
        ("\n0.6,6", ("line 62, the last row, is cut off and left out: '0.6,6'",)),
        ("\n0.6,6,0.1\n", ("line 62, the last row, is cut off and left out: '0.6,6,0.1'",)),
        ("\n0.6,6,0.1,1e-", ("line 62, the last row, is cut off and left out: '0.6,6,0.1,1e-'",)),
        (
            "\n0.6,6,0.1\nstopped\n",
            (
                "line 62, the last row, is cut off and left out: '0.6,6,0.1'",
                "line 63, below the last row, is left out: 'stopped'",
            ),
        ),
        ("\n,6,0.1,9\n,6,0.1,9\n", ("2 rows at the end without a time are left out",)),
    ],
)
def test_what_of_a_files_end_is_no_row_is_told_everywhere(write, capsys, end, told):
    path = write("t,u,i,w", T, V, I, W)
    path.write_text(path.read_text().rstrip("\n") + end)
    recording = one(path)
    assert recording.not_read == told and len(recording.time) == N
    np.testing.assert_allclose(recording.signals["w"], W, rtol=1e-8)
    assert main(["check", str(path)]) == 0
    shown = capsys.readouterr().out
    assert all(f"  {sentence}\n" in shown for sentence in told)
    assert main(["check", str(path), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["recordings"][0]["read"]["left_out"] == list(told)
    case = case_for_recording(path, fmu="dc_motor")
    notes = plan_case(case, describe("dc_motor")).notes
    assert all(f"log.csv: {sentence}" in notes for sentence in told)


@pytest.mark.parametrize("end", ["\n0.6,6,0.1\n0.61,6,0.1,9\n", "\n0.6,6,0.1,1e-\n"])
def test_a_row_that_is_short_in_the_middle_or_a_cell_that_was_ended_is_an_error(write, end):
    path = write("t,u,i,w", T, V, I, W)
    path.write_text(path.read_text().rstrip("\n") + end)
    with pytest.raises(RecordingError, match="line 62"):
        one(path)


def test_seconds_under_a_header_of_microseconds_are_told_how_to_be_read(write):
    times = T.copy()
    times[20] += 5e-4
    with pytest.raises(RecordingError, match="if the times of 'time_us' are seconds, say so with --unit time=s"):
        one(write("time_us,u,i,w", times, V, I, W))


def test_rows_at_the_end_without_a_time_are_no_samples(write):
    times = [f"{t:.2f}" for t in T[:-5]] + [""] * 5
    assert len(one(write("t,u,i,w", times, V, I, W)).time) == N - 5


# --- several tests in one file ------------------------------------------------------------------------------------


def test_a_column_that_names_tests_parts_the_file(write):
    names = ["first"] * N + ["second"] * N
    path = write("t,u,i,w,test", [*T, *(T + 0.6)], [*V, *V], [*I, *I], [*W, *W], names)
    first, second = recordings_in(path)
    assert (first.name, second.name) == ("log first", "log second") and second.title == "log.csv second"
    np.testing.assert_allclose(second.signals["w"], W, atol=1e-6)
    assert one(path, test="second").time[0] == pytest.approx(0.6)
    refused(path, "log.csv has no test 'third'; it holds first, second", test="third")


@pytest.mark.parametrize("begins", [0.0, 30.0])
def test_a_time_that_begins_anew_and_a_pause_part_the_file(write, begins):
    path = write("t,u,i,w", [*T, *(T + begins)], [*V, *V], [*I, *I], [*W, *W])
    assert [len(r.time) for r in recordings_in(path)] == [N, N]


def test_a_phase_of_one_test_does_not_part_it(write):
    assert len(one(write("t,u,i,w,phase", T, V, I, W, ["rest"] * 10 + ["run"] * (N - 10))).time) == N


def test_all_tests_of_a_file_are_fitted_together(tmp_path, capsys):
    from motors import CML050, step_recording

    rows = []
    for seed, level in enumerate((6.0, 10.5)):
        made = step_recording(CML050, noise=(0.02, 1.0), seed=seed, lead=0.1, duration=0.6, levels=(0.0, level))
        signals = (made.time, *(made.signals[c] for c in ("voltage", "current", "speed")))
        rows += [f"{t:.4f},{v},{i:.5f},{w:.4f},{seed + 1}" for t, v, i, w in zip(*signals, strict=True)]
    path = tmp_path / "both.csv"
    path.write_text("time [s],voltage [V],current [A],speed [rad/s],run\n" + "\n".join(rows))
    assert main(["estimate", str(path), "--json", "--workers", "1"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert [r["recording"] for r in found["read"]] == ["both 1", "both 2"] == [r["name"] for r in found["recordings"]]
    for name in "RKJB":
        p = found["parameters"][name]
        assert abs(p["value"] - CML050.parameters[name]) < 5 * p["standard_error"]


# --- several motors in one file -----------------------------------------------------------------------------------

TWO = "t,v_left_V,i_left_A,vel_left_rad_per_s,v_right_V,i_right_A,vel_right_rad_per_s"


def test_of_two_motors_the_user_is_asked_which(write):
    path = write(TWO, T, V, I, W, 2 * V, 2 * I, 2 * W)
    refused(path, "log.csv holds several motors, left, right; say which: --motor left, --motor right")
    right = one(path, motor="right")
    assert motor_columns(right) == {"v": "v_right", "i": "i_right", "w": "vel_right"}
    np.testing.assert_allclose(right.signals["vel_right"], 2 * W, atol=1e-6)
    refused(path, "log.csv has no motor 'middle' (left, right)", motor="middle")


def test_columns_side_by_side_that_are_no_motors_signals_make_no_several_motors(write):
    bench = "t,Servo 1,Servo 2,Servo 3,u,i,Motor Electrical Speed (rad/s),Motor Optical Speed (rad/s)"
    empty = [""] * N
    path = write(bench, T, empty, empty, empty, V, I, W + 5.0, W)
    refused(path, "log.csv has two columns for the speed, 'Motor Electrical Speed (rad/s)' and 'Motor Optical Speed")
    path = write(bench, T, empty, empty, empty, V, I, np.zeros(N), W)  # a sensor that is not there shows zero
    assert motor_columns(one(path))["w"] == "Motor Optical Speed"


def test_a_column_of_a_file_with_a_header_is_found_by_its_number_too(write):
    path = write("t [ms],u,first,n [rpm]", 1e3 * T, V, I, W)
    read = one(path, columns={"i": "3"})
    assert motor_columns(read) == {"v": "u", "i": "first", "w": "n"} and read.units["n"] == "rad/s"
    refused(path, "log.csv has no column '9' (t [ms], u, first, n [rpm])", columns={"i": "9"})


@pytest.mark.parametrize(
    "header", ["t,leftVoltage,leftSpeed,rightVoltage,rightSpeed", "t,u_1,w_1,u_2,w_2", "t,u m1,w m1,u m2,w m2"]
)
def test_motors_are_told_apart_in_usual_ways(write, header):
    refused(write(header, T, V, W, 2 * V, 2 * W), "holds several motors")


# --- units, wheels, counts, duty cycles ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("column", "factor"),
    [
        ("vel_rad_per_s", 1),
        ("speed_deg_s", 180 / np.pi),
        ("velocity_deg_per_s", 180 / np.pi),
        ("speed_rev_per_min", 30 / np.pi),
        ("Motor_Speed(RPM)", 30 / np.pi),
        ("omega_rad_s", 1),
    ],
)
def test_units_after_underscores_are_read(write, column, factor):
    recording = one(write(f"timestamp_ms,voltage_v,current_mA,{column}", 1e3 * T, V, 1e3 * I, factor * W))
    v, i, w = (recording.signals[c] for c in motor_columns(recording).values())
    for shown, true in ((v, V), (i, I), (w, W)):
        np.testing.assert_allclose(shown, true, atol=1e-6)
    assert not any(r.is_guess for r in understood(recording, motor_columns(recording)))


def test_a_wheel_s_speed_needs_the_metres_of_a_turn(write, capsys):
    path = write("t,u,i,speed [m/s]", T, V, I, W * 0.16 / (2 * np.pi))
    refused(path, "rev/s, or say with --per-turn how many metres a turn goes")
    recording = one(path, per_turn=0.16)
    np.testing.assert_allclose(recording.signals["speed"], W, atol=1e-6)
    assert understood(recording, motor_columns(recording))[2].text() == "w ← speed [m/s], 0.16 m a turn"
    assert main(["check", str(path), "--per-turn", "0.16m"]) == 0
    refused(write("t,u,i,w", T, V, I, W), "has no column in m/s or m, which --per-turn is for", per_turn=0.16)


def test_counts_need_those_of_a_turn(write):
    angle = np.cumsum(W) * 0.01
    path = write("t,u,i,encoder", T, V, I, np.round(angle * 4000 / (2 * np.pi)))
    refused(path, "--counts 4000")
    recording = one(path, counts=4000)
    assert motor_columns(recording)["angle"] == "encoder"
    np.testing.assert_allclose(recording.signals["encoder"], angle, atol=2 * np.pi / 4000)
    refused(write("t,u,i,w", T, V, I, W), "has no column of counts (u, i, w)", counts=4000)


@pytest.mark.parametrize(
    ("header", "duty", "supply", "told"),
    [
        ("t,duty,i,w,battery [V]", V / 12, None, "duty × battery [V]"),
        ("t,duty_pct,i,w,battery_voltage", 100 * V / 12, None, "duty_pct × battery_voltage"),
        ("t,pwm,i,w,supply", 255 * V / 12, "supply/255", "pwm × supply/255"),
        ("t,PWM,i,w,other", 255 * V / 12, "12/255", "PWM × 12/255 V"),
        ("t,duty,i,w,other", V / 12, "12", "duty × 12 V"),
    ],
)
def test_a_duty_cycle_times_its_supply_is_the_voltage(write, header, duty, supply, told):
    recording = one(write(header, T, duty, I, W, np.full(N, 12.0)), supply=supply)
    columns = motor_columns(recording)
    np.testing.assert_allclose(recording.signals[columns["v"]], V, atol=1e-6)
    assert understood(recording, columns)[0].text() == f"v ← {told}"


@pytest.mark.parametrize(
    ("header", "supply", "sentence"),
    [
        ("t,pwm,i,w", None, "'pwm' is a duty cycle: say of which supply, with --supply 12 (volts), --supply 12/255"),
        (
            "t,pwm,i,w",
            "12",
            "'pwm' goes up to 153, so it is no part of the supply: say how many of it are all, with --supply 12/255",
        ),
        ("t,pwm,i,w", "12/x", "--supply 12/x: 'x' is not a number; write 12, 12/255 or battery/255"),
        ("t,pwm,i,w", "12/0", "--supply 12/0: '0' is not above 0"),
        ("t,pwm,i,w", "0", "--supply 0: a supply has volts; write 12, 12/255 or battery/255"),
        ("t,pwm,i,w", "nan", "--supply nan: a supply has volts"),
        ("t,pwm,i,w", "akku", "log.csv has no column 'akku'"),
        ("t,x,i,w", "12", "log.csv has no duty cycle (x, i, w); say which column it is, with --column v=…"),
    ],
)
def test_a_duty_cycle_without_its_supply_is_asked_for(write, header, supply, sentence):
    refused(write(header, T, 255 * V / 10, I, W), sentence, supply=supply)


def test_a_measured_voltage_goes_before_a_duty_cycle_and_its_battery(write):
    recording = one(write("t,duty,battery [V],voltage [V],w", T, V / 12, np.full(N, 12.0), 0.9 * V, W))
    assert motor_columns(recording, required=("v", "w"))["v"] == "voltage"


# --- files without a header or a time -----------------------------------------------------------------------------


@pytest.mark.parametrize("comma", [",", ";", "\t", " ", "; "])
def test_columns_without_a_header_are_named_by_their_number(write, comma):
    path = write("", V, T, I, W, comma=comma)
    with pytest.raises(RecordingError, match="there is no header above the numbers.*--column time=2 --column v=1"):
        read_recording(path)
    recording = one(path, columns={"time": "2", "v": "1", "i": "3", "w": "4"}, units={"w": "rpm"})
    np.testing.assert_allclose(recording.signals["column 4"], W * np.pi / 30, atol=1e-6)
    assert motor_columns(recording) == {"v": "column 1", "i": "column 3", "w": "column 4"}
    refused(path, "log.csv has no column '9'", columns={"time": "9"})


def test_a_file_without_a_time_needs_its_rate(write):
    path = write("u,i,w", V, I, W)
    refused(path, "--column time=… says which it is, or --rate HZ that there is none")
    np.testing.assert_allclose(one(path, rate=100.0).time, np.arange(N) / 100, rtol=1e-12)


def test_a_rate_in_the_place_of_times_is_said_and_so_is_another_that_these_tell(write):
    """At half its rate a recording was estimated, twice as slow, without a word."""
    path = write("t,u,i,w", T, V, I, W)
    rate = 1 / (T[1] - T[0])
    (told,) = one(path, rate=rate / 2).not_read
    assert told == f"the times of 't' are not used: you said {rate / 2:g} Hz, and they tell {rate:.4g} Hz"
    (told,) = one(path, rate=rate).not_read
    assert told == f"the times of 't' are not used: you said {rate:g} Hz"
    assert one(write("u,i,w", V, I, W), rate=rate).not_read == ()


def test_a_file_without_a_time_may_hold_several_tests(write):
    """The last column was taken for the time where tests were told apart: the speed."""
    both = [np.concatenate([x, x]) for x in (V, I, W)]
    path = write("u,test,i,w", both[0], np.repeat([1, 2], N), *both[1:])
    first, second = read_recordings(path, ReadAs(rate=100.0))
    np.testing.assert_allclose(first.time, np.arange(N) / 100, rtol=1e-12)
    np.testing.assert_allclose(second.time, np.arange(N, 2 * N) / 100, rtol=1e-12)


@pytest.mark.parametrize("heading", ["speed [ticks/s]", "w (counts/s)", "encoder counts/s", "ticks_per_sec", "pulse/s"])
def test_counts_a_second_are_a_speed_once_a_turn_is_known(write, heading):
    path = write(f"t,u,i,{heading}", T, V, I, W / (2 * np.pi) * 2000)
    refused(path, f"{heading!r} counts the lines of an encoder; say how many make a turn with --counts 4000")
    refused(path, f'in a case file: w = {{ column = "{heading}", counts = 4000 }}')
    recording = one(path, counts=2000)
    column = motor_columns(recording)["w"]
    np.testing.assert_allclose(recording.signals[column], W, rtol=1e-7)
    assert understood(recording, {"w": column})[0].text() == f"w ← {heading}, 2000 counts a turn"


def test_a_case_takes_counts_a_second_of_a_speed_that_is_a_mean_and_differences_none(write):
    path = write("t,u,i,ticks/s", T, V, I, W / (2 * np.pi) * 2000)
    case = path.with_name("a.case.toml")
    said = 'w = { column = "ticks/s", counts = 2000, sensor = "mean" }'
    case.write_text(f'[inputs]\nv = "u"\n[outputs]\ni = "i"\n{said}\n[[recording]]\nfile = "log.csv"\n')
    (observed,) = plan_case(read_case(case), describe("dc_motor")).observed
    np.testing.assert_allclose(observed.outputs["w"], W, rtol=1e-7)


@pytest.mark.parametrize("heading", ["abs(i)", "|i|", "abs(current) [A]", "|I| (A)", "ABS( i_a )"])
def test_a_current_without_its_sign_is_refused_until_the_user_says_that_it_never_turns(write, heading):
    path = write(f"t,u,{heading},w", T, V, I, W)
    refused(path, f"{heading!r} is a current without its sign")
    np.testing.assert_allclose(one(path, columns={"i": heading}).signals[heading.split(" [")[0].split(" (")[0]], I)
    signed = one(write(f"t,u,{heading},i,w", T, V, I, I, W))
    assert motor_columns(signed)["i"] == "i"


def test_whole_numbers_that_are_raw_and_have_no_unit_are_refused_with_how_to_scale_them(write, capsys):
    """A converter of 10 bits, in the middle at no current; without "raw", or with a unit, it is what it says."""
    path = write("time [s],voltage [V],Current_raw,speed [rad/s]", T, V, np.round(I / 0.005) + 512, W)
    assert main(["check", str(path)]) == 0
    told = capsys.readouterr().out
    assert "'Current_raw' has whole numbers and no unit" in told and "512 in the first row" in told
    assert told.count("  - ") == 1 and "--scale i=FACTOR" in told, "no other unit is told of counts"
    assert main(["check", str(path), "--scale", "i=0.005", "--offset", "i=-2.56"]) == 0
    assert "whole numbers" not in capsys.readouterr().out
    smooth = write("time [s],voltage [V],Current_raw,speed [rad/s]", T, V, I, W, name="smooth.csv")
    assert main(["check", str(smooth)]) == 0
    assert "whole numbers" not in capsys.readouterr().out


def test_a_column_that_counts_the_rows_is_no_speed(write):
    assert "w" not in motor_columns(one(write("t,n,u,theta", T, np.arange(N), V, W)), required=("v",))


# --- WPILib's JSON ------------------------------------------------------------------------------------------------


def sysid(tmp_path, rows, **more):
    path = tmp_path / "sysid.json"
    path.write_text(json.dumps({test: rows for test in ("slow-forward", "fast-backward")} | more))
    return path


def test_sysid_s_tests_are_recordings(tmp_path):
    rows = np.column_stack([10 + T, V, np.cumsum(W) * 0.01 / (2 * np.pi), W / (2 * np.pi)]).tolist()
    slow, fast = recordings_in(sysid(tmp_path, rows, sysid=True, test="Simple", units="Rotations"))
    assert (slow.title, fast.title) == ("sysid.json slow-forward", "sysid.json fast-backward")
    assert motor_columns(slow, required=("v",), either=("i", "w")) == {
        "v": "voltage",
        "w": "speed",
        "angle": "position",
    }
    np.testing.assert_allclose(slow.signals["speed"], W, atol=1e-9)
    assert slow.time[0] == 0


def test_a_drive_train_s_sides_are_two_motors(tmp_path):
    zero = np.zeros(N)
    rows = np.column_stack([T, zero, zero, V, 2 * V, W, W, -W / 6, 2 * W, zero]).tolist()
    path = sysid(tmp_path, rows)
    refused(path, "holds several motors, left, right; say which")
    left = recordings_in(path, ReadAs(motor="left"))[0]
    np.testing.assert_allclose(left.signals["voltage_left"], -V)  # logged without its sign: it takes that of the speed
    np.testing.assert_allclose(left.signals["speed_left"], -W / 6 * 2 * np.pi)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ('{"a": 1', "sysid.json begins as JSON and is none"),
        ('{"a": 1}', "sysid.json is JSON without the tests of WPILib's SysId (slow-forward, slow-backward"),
        ('{"slow-forward": [[1, 2], [3, 4]]}', "'slow-forward' should hold rows of 4, 9 or 10 numbers"),
        ('{"slow-forward": [1, "x"]}', "'slow-forward' should hold rows of 4, 9 or 10 numbers"),
    ],
)
def test_other_json_is_refused_in_one_sentence(tmp_path, text, sentence):
    path = tmp_path / "sysid.json"
    path.write_text(text)
    refused(path, sentence)
    refused(
        sysid(tmp_path, np.zeros((N, 4)).tolist()),
        "has no test 'slow'; it holds slow-forward, fast-backward",
        test="slow",
    )


# --- on the command line ------------------------------------------------------------------------------------------


def test_a_case_keeps_how_its_file_is_read(write, tmp_path, capsys):
    path = write("", V, T, I, W)
    words = ["--column", "time=2", "--column", "v=1", "--column", "i=3", "--column", "w=4", "--unit", "w=rpm"]
    quick = ["--method", "integral", "--workers", "1"]
    case = tmp_path / "saved.case.toml"
    main(["estimate", str(path), *words, "--save-case", str(case), *quick])
    first = capsys.readouterr().out.splitlines()[0]
    assert first.startswith("read log: v ← column 1 (no unit: taken as V)")
    main(["estimate", str(case), *quick])
    assert capsys.readouterr().out.splitlines()[0] == first


def test_a_scopes_settings_beside_the_samples_are_passed_over(tmp_path):
    lines = ["Record Length,2.5e+03,,  -0.05,   0.1,", "Trigger Point,4.9e+02,,  -0.04,   0.2,"]
    lines += ["Source,CH1,,  -0.03,   0.3,"]
    lines += [f",,,  {0.01 * k:.2f},   {0.3 * k:.1f}," for k in range(-2, 40)]
    (tmp_path / "scope.csv").write_text("\n".join(lines))
    with pytest.raises(RecordingError, match="line 1: there is no header above .* --column time=4 --column v=5"):
        read_recording(tmp_path / "scope.csv")
    recording = read_recording(tmp_path / "scope.csv", ReadAs(columns={"time": "4", "i": "5"}))
    assert len(recording.time) == 45
    assert recording.step == pytest.approx(0.01)
    assert recording.signals["column 5"][:3] == pytest.approx([0.1, 0.2, 0.3])


def test_settings_with_empty_cells_above_the_samples_are_no_header(tmp_path):
    """As Siglent's oscilloscopes write them; the unit of the time beside "Horizontal Units" was taken for its name."""
    settings = ["Record Length,Analog:60", "Horizontal Units,s,,,", "Horizontal Scale,0.2,,,", "Source,CH1,CH2"]
    rows = [f" {t:.6f},{v:.3f},{i:.4f}" for t, v, i in zip(T, V, I, strict=True)]
    path = tmp_path / "SDS00001.csv"
    path.write_text("\n".join([*settings, "Second,Volt,Ampere", *rows]) + "\n")
    recording = read_recording(path)
    assert list(recording.signals) == ["Volt", "Ampere"] and recording.time == pytest.approx(T)


def test_names_that_are_commented_out_stand_above_rows_that_hold_a_word_too(tmp_path):
    """As rostopic writes messages, with the name of a frame; no header was found."""
    since = [1_610_000_000_000_000_000 + round(1e9 * t) for t in T]
    rows = [f"{t},base,{v},{i},{w}" for t, v, i, w in zip(since, V, I, W, strict=True)]
    path = tmp_path / "motor.csv"
    path.write_text("\n".join(["%time,field.frame_id,field.voltage,field.current,field.velocity", *rows]) + "\n")
    recording = read_recording(path)
    assert motor_columns(recording) == {"v": "field.voltage", "i": "field.current", "w": "field.velocity"}
    assert recording.time == pytest.approx(T, abs=1e-6)


def test_a_word_among_numbers_makes_no_header(tmp_path):
    (tmp_path / "log.txt").write_text("% motor log\n" + "".join(f"{0.01 * k:.2f} 0x0 {k} 1\n" for k in range(20)))
    with pytest.raises(RecordingError, match="line 2: there is no header above the numbers"):
        read_recording(tmp_path / "log.txt")


def test_a_name_that_is_a_unit_by_chance_is_what_the_user_says(tmp_path):
    (tmp_path / "log.csv").write_text("time [s],pulse,speed [rad/s]\n" + "".join(f"{k},{k % 2},1\n" for k in range(20)))
    recording = read_recording(tmp_path / "log.csv", ReadAs(columns={"v": "pulse"}))
    assert motor_columns(recording, required=("v", "w")) == {"v": "pulse", "w": "speed"}


def test_without_a_voltage_a_constant_one_may_be_held(tmp_path):
    (tmp_path / "log.csv").write_text("time [s],speed [rad/s]\n" + "".join(f"{k},{k}\n" for k in range(20)))
    with pytest.raises(RecordingError, match="or estimate with --fix v=VOLTS where it was constant"):
        motor_columns(read_recording(tmp_path / "log.csv"))


def test_a_batch_estimates_each_motor_of_a_file(tmp_path):
    from motors import CML050, held_response

    time = 1e-3 * np.arange(600)
    voltage = np.where(time < 0.1, 0.0, 10.0)
    shown = held_response(CML050, voltage, step=1e-3)[:, :2]
    noise = np.random.default_rng(2).standard_normal((600, 4)) * (0.02, 0.5, 0.02, 0.5)
    rows = np.column_stack([time, voltage, shown, voltage, 0.5 * shown]) + np.insert(noise, [0, 0, 2], 0.0, axis=1)
    header = "time_s,v_left_V,i_left_A,vel_left_rad_s,v_right_V,i_right_A,vel_right_rad_s"
    np.savetxt(tmp_path / "drive.csv", rows, delimiter=",", header=header, comments="")
    assert main(["batch", str(tmp_path / "drive.csv"), "-o", str(tmp_path / "out"), "--quiet"]) == 0
    lines = [json.loads(line) for line in (tmp_path / "out" / "results.jsonl").read_text().splitlines()]
    assert [(row["case"], row["motor"]) for row in lines] == [("drive left", "left"), ("drive right", "right")]
    left, right = (row["parameters"]["R"]["value"] for row in lines)
    assert right == pytest.approx(2 * left, rel=0.05)


NAMED = {"voltage": V.tolist(), "current": I.tolist(), "speed": W.tolist()}
ROWS = np.column_stack([T, V, I, W]).tolist()
NUMBERED = {"time": "1", "v": "2", "i": "3", "w": "4"}
TABLES = {  # as pandas writes one, and others
    "split": ({"columns": ["time", *NAMED], "index": list(range(N)), "data": ROWS}, {}),
    "split, times as the index": (
        {"columns": list(NAMED), "index": T.tolist(), "data": [row[1:] for row in ROWS]},
        {"time": "index"},
    ),
    "split, dates as the index": (
        {
            "columns": list(NAMED),
            "index": [f"2026-11-30T12:00:00.{k:02}0" for k in range(N)],
            "data": [row[1:] for row in ROWS],
        },
        {"time": "index"},
    ),
    "columns, times as the index": (
        {name: dict(zip(map(str, T), x, strict=True)) for name, x in NAMED.items()},
        {"time": "index"},
    ),
    "index": ({str(k): dict(zip(["time", *NAMED], row, strict=True)) for k, row in enumerate(ROWS)}, {}),
    "values": (ROWS, NUMBERED),
    "rows below their names": ([["time", *NAMED], *ROWS], {}),
    "below names, one level down": ({"series": {"columns": ["time", *NAMED], "values": ROWS}}, {}),
}


@pytest.mark.parametrize("table", TABLES)
def test_a_table_of_json_is_read_however_its_names_and_rows_stand(tmp_path, table):
    content, columns = TABLES[table]
    path = tmp_path / "log.json"
    path.write_text(json.dumps(content))
    found = one(path, columns=columns)
    roles = motor_columns(found)
    assert found.time == pytest.approx(T)
    assert [found.signals[roles[role]].tolist() for role in "viw"] == list(NAMED.values())


@pytest.mark.parametrize("order", [1, -1], ids=["motor by motor", "in turn"])
def test_rows_of_several_motors_are_parted_by_the_column_that_names_them(tmp_path, order):
    rows = [(name, k) for name in ("M1", "M2") for k in range(40)]
    rows.sort(key=lambda row: row[::order])
    lines = [f"{k / 100},{name},{12 * (k > 5)},{k * (1 + (name == 'M2'))}" for name, k in rows]
    path = tmp_path / "drive.csv"
    path.write_text("\n".join(["time,motor,voltage,speed", *lines]))
    assert motors_in(path) == ("M1", "M2")
    refused(path, "drive.csv holds several motors; say which: --motor M1, --motor M2")
    refused(path, "drive.csv has no motor 'M3'; did you mean", motor="M3")
    found = one(path, motor="M2")
    assert found.title == "drive.csv M2" and found.signals["speed"].tolist() == [2.0 * k for k in range(40)]


@pytest.mark.parametrize(("words", "begins"), [(("off", "on"), 0.0), ((0, 100), 0.5)], ids=["state", "command"])
def test_a_column_motor_that_tells_what_it_does_names_none(tmp_path, words, begins):
    on = [k % 50 > 9 for k in range(100)]
    rows = [(k / 100 - begins * (k > 49), words[on[k]], 12 * on[k], 2 * (k % 50)) for k in range(100)]
    path = tmp_path / "drive.csv"
    path.write_text("\n".join(["time,motor,voltage,speed", *(",".join(map(str, row)) for row in rows)]))
    assert motors_in(path) == () and len(recordings_in(path)) == (1 if begins == 0 else 2)


def test_a_column_of_words_is_asked_about_as_no_signal(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("\n".join(["time,curent,voltage,speed", *(f"{k / 100},on,12,{2 * k}" for k in range(40))]))
    assert "i" not in motor_columns(one(path), required=("v",), either=("i", "w"))


def test_a_speed_in_ms_may_be_metres_a_second(write):
    path = write("time_s,voltage,speed_ms", T, V, W / 1000)
    refused(path, "'ms' is no unit of angular speed; use one of rad/s, rpm, deg/s, rev/s, or say with --unit w=m/s")
    found = one(path, units={"w": "m/s"}, per_turn=0.2 * np.pi)
    assert found.signals["speed"] == pytest.approx(W / 100)


def test_a_command_in_words_is_no_voltage(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("\n".join(["time,pwm,command,speed", *(f"{k / 100},{k % 40},forward,{2 * k}" for k in range(80))]))
    refused(path, "'pwm' is a duty cycle: say of which supply")
    assert motor_columns(one(path, supply="12/255"), required=("v", "w"))["v"] == "pwm × 12/255 V"


@pytest.mark.parametrize("apart", [2e-6, 0.0], ids=["one by one", "with one stamp"])
def test_rows_that_arrive_in_blocks_are_asked_how_often_they_were_taken(tmp_path, apart):
    """Within a block times are those of arrival; each was taken for a test of its own."""
    n, block = 800, 16
    taken = np.arange(n) * 1e-3
    late = np.random.default_rng(1).uniform(0, 0.3, n // block)[np.arange(n) // block] * block * 1e-3
    arrived = (np.arange(n) // block + 1) * block * 1e-3 + np.arange(n) % block * apart + late
    columns = np.column_stack([arrived, np.where(taken > 0.1, 12.0, 0.0), np.ones(n), taken])
    path = tmp_path / "usb.csv"
    np.savetxt(path, columns, "%.6f", ",", header="time [s],voltage [V],current [A],speed [rad/s]", comments="")
    with pytest.raises(RecordingError, match=r"usb.csv: rows arrive in blocks.*--rate HZ.*some (99\d|100\d)(\.\d)? Hz"):
        read_recordings(path)


def test_tests_of_many_rows_with_pauses_between_are_no_blocks(tmp_path):
    times = np.concatenate([10.0 * k + 1e-3 * np.arange(100) for k in range(12)])
    columns = np.column_stack([times, np.full(1200, 12.0), np.ones(1200), np.linspace(0, 1, 1200)])
    path = tmp_path / "tests.csv"
    np.savetxt(path, columns, "%.6f", ",", header="time [s],voltage [V],current [A],speed [rad/s]", comments="")
    assert len(read_recordings(path)) == 12


@pytest.mark.parametrize("name", ["duty_V", "PWM_V", "pwm (V)"])
def test_a_duty_cycle_in_volts_is_the_voltage(write, name):
    recording = read_recording(write(f"time_s,{name},current_A,speed_rad_s", T, V, I, W))
    voltage = recording.signals[motor_columns(recording)["v"]]
    assert voltage == pytest.approx(V)


def test_one_row_that_is_stamped_a_tick_late_is_no_mistake(write):
    stamps = [f"{10 * k + (k == 40)}" for k in range(N)]
    recording = read_recording(write("ms,voltage_V,current_A,speed_rad_s", stamps, V, I, W))
    assert recording.step == pytest.approx(0.01) and recording.time[40] == pytest.approx(0.4)
    stamps[40] = "403"
    with pytest.raises(RecordingError, match="off its uniform grid by 0.3 of a step"):
        read_recording(write("ms,voltage_V,current_A,speed_rad_s", stamps, V, I, W))

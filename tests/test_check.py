"""The command check, and what an estimate tells of what was read."""

import json
import re
import shlex
import subprocess
import sys
from pathlib import Path

import forked
import numpy as np
import pytest
from motors import CML050, step_recording, write_recording
from pseudo_terminal import Terminal

from estimator.cli import main
from estimator.commands.checking import preview_text
from estimator.commands.terminal import broken
from estimator.recordings.motor_columns import motor_columns
from estimator.recordings.preview import preview
from estimator.recordings.read_as import ReadAs
from estimator.recordings.reading import read_recording
from estimator.recordings.understood import understood

pytestmark = pytest.mark.usefixtures("shared_workers")


@pytest.fixture(scope="module")
def bench():
    made = step_recording(CML050, noise=(0.02, 1.0), seed=3, lead=0.2, duration=1.0)
    return {"t": made.time, **{n: made.signals[c] for n, c in zip("viw", ("voltage", "current", "speed"), strict=True)}}


@pytest.fixture
def file(tmp_path, bench):
    def write(header, *, name="run.csv", **changed):
        columns = [np.asarray(c) for c in {**bench, **changed}.values()]
        rows = "\n".join(",".join(f"{x:.6g}" for x in row) for row in zip(*columns, strict=True))
        path = tmp_path / name
        path.write_text(f"{header}\n{rows}\n")
        return path

    return write


def run(capsys, *words):
    status = main([str(word) for word in words])
    out, err = capsys.readouterr()
    return status, out, err


@pytest.mark.smoke
def test_check_tells_columns_and_units_first_then_clock_step_levels_and_noise(file, bench, capsys):
    status, out, err = run(capsys, "check", file("time [s],voltage [V],current [mA],n", i=1e3 * bench["i"]))
    assert status == 0 and err == ""
    lines = out.splitlines()
    assert lines[0] == "run.csv: v ← voltage [V] · i ← current [mA] · w ← n (no unit: taken as rpm) · time ← time [s]"
    assert lines[1] == "  another unit is said with --unit w=rad/s"
    assert any("1001 samples from 0 to 1 s, every 0.001 s (1000 Hz), even" in line for line in lines)
    assert any("a step from 0 to 10.5 V at t = 0.2 s" in line for line in lines)


@pytest.mark.parametrize("levels", [(0.0, 12.0, 0.0), (0.0, 6.0, 12.0), (0.0, 12.0) * 4])
def test_levels_of_a_voltage_that_was_set_are_no_noise_and_no_steps_of_a_converter(file, capsys, levels):
    t, v = np.arange(200 * len(levels)) * 1e-3, np.repeat(levels, 200)
    columns = {"v": v, "i": np.zeros(len(t)), "w": np.random.default_rng(1).standard_normal(len(t)) + 20 * v}
    path = file("time [s],voltage [V],current [A],speed [rad/s]", t=t, **columns)
    (found,) = json.loads(run(capsys, "check", path, "--json")[1])["recordings"]
    assert [level["means"]["v"] for level in found["levels"]] == list(levels)
    assert found["signals"]["v"]["noise"] == 0 and found["signals"]["v"]["quantum"] is None
    assert found["signals"]["w"]["noise"] == pytest.approx(1, rel=0.2)


def test_check_adds_an_offset_behind_the_factor_as_estimate_does(file, bench, capsys):
    path = file("time [s],voltage [V],current [A],speed [rad/s]")
    status, out, _ = run(capsys, "check", path, "--scale", "i=2", "--offset", "i=0.5", "--json")
    (found,) = json.loads(out)["recordings"]
    assert status == 0 and found["signals"]["i"]["largest"] == pytest.approx(2 * np.max(bench["i"]) + 0.5, rel=1e-5)
    status, _, err = run(capsys, "check", path, "--offset", "q=0.5")
    assert status == 2 and "offset is given for 'q', which is no signal of run.csv that is used" in err


def test_check_writes_a_copy_that_needs_no_option_and_says_what_it_changed(file, bench, capsys, tmp_path):
    path = file("t_ms,u_mV,i,n,note", t=1e3 * bench["t"], v=1e3 * bench["v"], i=-bench["i"], z=0 * bench["v"])
    out = tmp_path / "mended.csv"
    assert main(["check", str(path), "--scale", "i=-1", "--mend", str(out)]) == 0
    told = capsys.readouterr().out.split("mended.csv holds ")[1]
    for words in ("u_mV, mV made V", "← i, taken as A, which nobody said", "← n, rpm made rad/s, which nobody said",
                  "t_ms, ms made s", "i: × -1", "does not use them: note"):  # fmt: skip
        assert words in told, told
    assert main(["check", str(out), "--json"]) == 0
    again = json.loads(capsys.readouterr().out)["recordings"][0]
    assert again["read"]["text"] == "v ← voltage [V] · i ← current [A] · w ← speed [rad/s] · time ← time [s]"
    mended, read = read_recording(out), read_recording(path)
    assert mended.signals["current"].tolist() == (-1 * read.signals["i"]).tolist()
    assert mended.signals["speed"].tolist() == read.signals["n"].tolist()
    assert mended.step == read.step and mended.time.tolist() == read.time.tolist()


def test_a_copy_is_of_one_recording_and_not_in_its_place(file, capsys, tmp_path):
    one, other = file("t,u,i,w"), file("t,u,i,w", name="other.csv")
    before = one.read_bytes()
    assert main(["check", str(one), "--mend", str(one)]) == 2
    assert "is what is read; give --mend another name" in capsys.readouterr().err and one.read_bytes() == before
    assert main(["check", str(one), str(other), "--mend", str(tmp_path / "new.csv")]) == 2
    assert "writes one recording" in capsys.readouterr().err and not (tmp_path / "new.csv").exists()
    assert main(["check", str(one), "--mend", str(tmp_path / "no" / "new.csv")]) == 2
    assert "new.csv: cannot be written (No such file or directory); give another place" in capsys.readouterr().err


def test_check_tells_rows_that_a_logger_wrote_again(file, bench, capsys):
    rows = np.sort(np.r_[np.arange(len(bench["t"])), [250, 300]])
    again = {name: bench[name][rows] for name in "viw"} | {"t": np.arange(len(rows)) * 1e-3}
    path = file("time [s],voltage [V],current [A],speed [rad/s]", **again)
    assert ", 2 rows are the row before once more: an estimate leaves them out" in " ".join(
        run(capsys, "check", path)[1].split()
    )
    (found,) = json.loads(run(capsys, "check", path, "--json")[1])["recordings"]
    assert found["clock"]["repeated_rows"] == 2
    plain = file("time [s],voltage [V],current [A],speed [rad/s]", name="plain.csv")
    assert "once more" not in run(capsys, "check", plain)[1]


def test_check_json_is_one_object_with_every_part(file, capsys):
    status, out, _ = run(capsys, "check", "--json", file("t,u,i,w"))
    (found,) = json.loads(out)["recordings"]
    assert status == 0
    assert found["read"]["signals"]["w"] == {"column": "w", "unit": "rad/s", "unit_from": "name"}
    assert found["clock"] | {"rate": 1000.0, "even": True, "samples": 1001} == found["clock"]
    assert found["excitation"]["kind"] == "step" and found["excitation"]["at"] == 0.2 and found["settled"] is True
    assert found["levels"][1]["means"]["w"] == pytest.approx(176, rel=0.01)
    assert found["signals"]["i"]["noise"] == pytest.approx(0.02, rel=0.2)
    assert found["implausible"] == []


def test_check_names_what_is_implausible_and_still_ends_with_0(file, bench, capsys):
    status, out, _ = run(capsys, "check", file("t,u,i,w", t=1e3 * bench["t"], i=1e3 * bench["i"]))
    assert status == 0
    assert "--unit i=mA" in out.split("Implausible:")[1] and "--unit time=ms" in out.split("Implausible:")[1]
    _, out, _ = run(capsys, "check", file("t,u,i,w", t=1e3 * bench["t"]), "--unit", "time=ms")
    assert "Implausible" not in out and "time ← t [ms] (unit as you said)" in out


def test_check_breaks_its_sentences_to_the_terminals_width(file, bench):
    made = preview(read_recording(file("t,u,i,w", i=-bench["i"])))
    whole = preview_text(made)
    assert max(map(len, whole.splitlines())) > 80
    parts = [part for line in whole.splitlines() for part in broken(line, 80)]
    assert max(map(len, parts)) <= 80 and " ".join(parts).split() == whole.split()
    assert broken("GUID        " + "x " * 50, 60)[1].startswith(" " * 12 + "x"), "under what it belongs to"


def test_the_tables_of_check_fit_a_narrow_terminal_and_go_on_below_with_their_first_column(file, tmp_path):
    screen = Terminal("check", str(file("t,u,i,w")), cwd=tmp_path, columns=40).run()
    lines = screen.text.replace("\r", "").split("\n")
    assert screen.status == 0 and max(map(len, lines)) <= 40
    tables = [part.strip("\n").split("\n") for part in "\n".join(lines).split("\n\n") if part.lstrip().startswith("le")]
    assert len(tables) > 2, "what was measured, and the levels, which are wider"
    assert "\n           " in screen.text.replace("\r", ""), "what follows a fact is under it"
    for first, *rows in tables:
        ends = [m.end() for m in re.finditer(r"\S+( \[\S+\])?", first)]
        assert rows and all(len(row) <= max(ends) for row in rows), "each number under its heading"
        assert all(row[: ends[0]].strip() for row in rows), "the row's name again"


def test_a_clock_that_counts_from_a_date_is_told_from_its_first_row_on(file, bench, capsys):
    plain = file("t,u,i,w")
    rows = [line.split(",", 1) for line in plain.read_text().splitlines()[1:]]
    dated = plain.with_name("dated.csv")
    dated.write_text("t,u,i,w\n" + "\n".join(f"{1.7e9 + float(t):.3f},{rest}" for t, rest in rows) + "\n")
    status, out, _ = run(capsys, "check", dated)
    assert status == 0 and "1.7e+09" not in out
    assert "from the first row on, at 2023-11-14 22:13:20 UTC" in out
    read = read_recording(dated)
    assert read.time[0] == 0 and read.origin == 1.7e9
    np.testing.assert_allclose(read.time, bench["t"] - bench["t"][0], atol=1e-9)
    half = float(read.time[-1]) / 2
    for begin in (0.0, 1.7e9):  # a window may be said in either
        status, out, _ = run(capsys, "estimate", dated, "--window", f"{begin:.1f}:{begin + half:.4f}", "--json")
        samples = json.loads(out)["recordings"][0]["samples"]
        assert status == 0 and samples == pytest.approx(len(read.time) / 2, abs=2)


@pytest.mark.parametrize(("clock", "per_second"), [("millis", 1e3), ("micros", 1e6)])
def test_a_microcontrollers_clock_is_read_in_its_own_unit(file, bench, capsys, clock, per_second):
    status, out, _ = run(capsys, "check", file(f"{clock},u,i,w", t=per_second * bench["t"]))
    assert status == 0 and f"time ← {clock} (no unit: taken as {'ms' if per_second == 1e3 else 'us'})" in out
    assert "1001 samples from 0 to 1 s, every 0.001 s" in out and "Implausible" not in out
    _, out, _ = run(capsys, "check", file("x,u,i,w"), "--column", "time=x")
    assert "time ← x (no unit: taken as s)" in out and "every 0.001 s" in out


def test_a_scopes_channels_are_named_in_one_sentence_with_all_options(file, capsys):
    path = file("Time (s),CH1 (V),CH2 (A),Speed (RPM)")
    status, out, err = run(capsys, "check", path)
    options = shlex.split(err[err.index("--column") :])
    assert (status, out) == (2, "") and options == ["--column", "v=CH1 (V)", "--column", "i=CH2 (A)"]
    assert run(capsys, "check", path, *options)[0] == 0


def test_check_does_not_call_unused_what_the_voltage_was_made_of(file, bench, capsys):
    duty = bench["v"] / 12
    for number, (supply, words) in enumerate(
        {"battery [V]": (), "battery": ("--supply", "battery/1"), "spare": ("--supply", "12")}.items()
    ):
        path = file(f"t,duty,i,w,{supply}", name=f"{number}.csv", v=duty, supply=np.full(len(duty), 12.0))
        status, out, _ = run(capsys, "check", path, *words)
        assert status == 0 and "v ← duty × " in out
        assert ("not used: spare\n" in out) == (supply == "spare") and "duty," not in out


def test_check_writes_a_figure_of_each_file_and_json(file, tmp_path, capsys):
    files = [file("t,u,i,w"), file("t,u,i,w", name="other.csv")]
    status, _, _ = run(capsys, "check", *files, "-o", tmp_path / "out")
    assert status == 0
    assert {p.name for p in (tmp_path / "out").iterdir()} == {"check.json", "run.png", "other.png"}
    assert (tmp_path / "out" / "run.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("header", "words", "sentence"),
    [
        ("t,Vin [V],Vout [V],w", (), "run.csv has two columns for the voltage, 'Vin [V]' and 'Vout [V]'; say which"),
        ("t,u,i_ref [A],i_mtr [A]", (), "has no current column; is it 'i_mtr [A]'?"),
        ("t,u,current A,current B", (), "run.csv has two columns for the current, 'current A' and 'current B'; say"),
        ("t,x,i,w", (), "run.csv has no voltage column"),
        (
            "t,u,i,speed",
            ("--unit", "speed=rmp"),
            "'rmp', given for 'speed', is not a known unit; use one of rad/s, rpm",
        ),
        ("t,u,i,w", ("--unit", "w=furlong"), "'furlong', given for 'w', is not a known unit; use one of rad/s, rpm"),
        ("t,u,i,w", ("--unit", "speed2=rpm"), "there is no column 'speed2' to give a unit"),
        ("t,u,i,w", ("--unit", "w=A"), "'A' is no unit of angular speed"),
        ("t,u,i,w", ("--column", "x=w"), "'x', given for a column, is no signal"),
        ("t,u,i,w", ("--column", "w=omega2"), "run.csv has no column 'omega2'"),
        ("t,u,i,w", ("--column", "v=t"), "run.csv: column 't' cannot be v, as it is time; name another one"),
        (
            "t,u,i,w",
            ("--column", "v=2", "--column", "i=2"),
            "run.csv: column 'u' cannot be i, as it is v;",
        ),
        ("t,u,i,w", ("--unit", "w=rpm", "--unit", "w=deg/s"), "--unit is given twice for 'w'"),
        ("t,u,i,w", ("--scale", "q=2"), "scale is given for 'q', which is no signal of run.csv that is used (v, i, w)"),
        (
            "t,u,i,w",
            ("--scale", "i=0"),
            "the scale 0 leaves nothing of i of run.csv; give its factor (-1 turns its sign)",
        ),
        ("t,u,i,w", ("--offset", "i=1e140"), "the scale 1 and the offset 1e+140 make i of run.csv as large as 1e+140"),
    ],
)
def test_what_cannot_be_read_is_one_sentence_and_status_2(header, words, sentence, file, bench, capsys):
    changed = {"w": bench["i"] * 0.3 + 1} if "current B" in header else {}
    status, out, err = run(capsys, "check", file(header, **changed), *words)
    assert (status, out) == (2, "") and sentence in err and err.count("\n") == 1


def test_of_several_files_those_that_cannot_be_read_do_not_hide_the_others(file, tmp_path, capsys):
    good, bad, odd = file("t,u,i,w"), tmp_path / "empty.csv", file("t,u,i,w [A]", name="odd.csv")
    bad.write_text("")
    status, out, err = run(capsys, "check", bad, good, odd)
    assert status == 2 and out.startswith("run.csv: v ← u ") and err.count("\n") == 2
    assert "empty.csv is empty" in err and "odd.csv: column 'w [A]'" in err
    status, out, err = run(capsys, "check", bad, good, odd, "--json")
    assert (status, out) == (2, "") and err.count("\n") == 1  # one object of all, or none


def test_check_of_an_fmu_says_that_it_is_no_recording(capsys):
    status, _, err = run(capsys, "check", "motor.fmu")
    assert status == 2 and "motor.fmu is no recording; check looks at recordings alone" in err


def test_of_two_columns_for_one_signal_the_user_chooses(file, bench):
    path = file("t,u,current A,current B,w".replace(",w", ""), w=bench["i"] * 0.3 + 1)
    chosen = read_recording(path, ReadAs(columns={"i": "current B"}))
    assert motor_columns(chosen, required=("v",), either=("i",))["i"] == "current B"


def test_a_signal_in_two_units_a_command_and_a_filtered_signal_are_no_second_column(file, bench, tmp_path):
    header = "t,u,i,speed [rad/s],omega [rpm],speed_filtered,voltage_command"
    more = {"rpm": bench["w"] * 30 / np.pi, "f": 0.5 * bench["w"], "c": 2 * bench["v"]}
    recording = read_recording(file(header, **more))
    assert motor_columns(recording) == {"v": "u", "i": "i", "w": "speed"}


def test_n_without_a_unit_is_rpm_and_any_other_unit_wins(file, bench):
    path = file("t,u,i,n")
    recording = read_recording(path)
    np.testing.assert_allclose(recording.signals["n"], bench["w"] * np.pi / 30, rtol=1e-5, atol=1e-5)
    assert understood(recording, {"w": "n"})[0].text() == "w ← n (no unit: taken as rpm)"
    said = read_recording(path, ReadAs(units={"w": "rad/s"}))
    np.testing.assert_allclose(said.signals["n"], bench["w"], rtol=1e-5, atol=1e-5)
    assert understood(said, {"w": "n"})[0].text() == "w ← n [rad/s] (unit as you said)"
    np.testing.assert_allclose(recording.in_unit("n [rad/s]").signals["n"], said.signals["n"], rtol=1e-12)


def test_a_guessed_unit_is_written_so_that_it_reads_back(file, tmp_path):
    recording = read_recording(file("t,u,i,n"))
    write_recording(recording, tmp_path / "again.csv")
    np.testing.assert_array_equal(read_recording(tmp_path / "again.csv").signals["n"], recording.signals["n"])


def test_check_imports_no_fmu_no_optimiser_and_no_plots(file):
    script = (
        "import sys; from estimator.cli import main; main(['check', sys.argv[1]]);"
        " print(sorted({'fmpy', 'matplotlib', 'scipy'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", script, file("t,u,i,w")], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"


def estimate(capsys, *words):
    status, out, _ = run(capsys, "estimate", *words, "--json", "--workers", 1)
    return status, json.loads(out)


def test_thousands_of_volts_may_be_millivolts(file, bench, capsys):
    main(["check", str(file("t,u,i,w", v=1e3 * bench["v"])), "--json"])
    (found,) = json.loads(capsys.readouterr().out)["recordings"][0]["implausible"]
    assert "in counts of 65535, or like mV" in found["sentence"] and "v=mV if millivolts" in found["sentence"]


def test_an_estimate_tells_what_was_read_first(file, capsys):
    status, out, _ = run(capsys, "estimate", file("t,u,i,n [1/min]"), "--unit", "w=rad/s", "--workers", 1)
    assert status == 0
    assert out.startswith(
        "read run: v ← u (no unit: taken as V) · i ← i (no unit: taken as A) · w ← n [rad/s] (unit as"
    )
    assert out.splitlines()[1] == "" and out.splitlines()[2].startswith("OK")


def test_where_the_speed_is_missing_an_estimate_names_what_it_did_not_use(file, bench, capsys):
    path = file("t,u,i,tacho [V]", w=0.01 * bench["w"])
    main(["estimate", str(path), "--fix", "K=0.0488"])
    assert "time ← t (no unit: taken as s) · not used: tacho [V]" in capsys.readouterr().out


def test_an_estimate_of_implausible_data_is_doubtful_with_the_sentence(file, bench, capsys):
    status, found = estimate(capsys, file("t,u,i,w", i=1e3 * bench["i"]))
    assert (status, found["verdict"]) == (0, "doubtful")
    assert "it looks like mA; say so with --unit i=mA" in found["reasons"][0]
    assert found["read"][0]["implausible"] == found["reasons"][:1]
    assert found["read"][0]["signals"]["i"] == {"column": "i", "unit": "A", "unit_from": "name"}
    status, found = estimate(capsys, file("t,u,i,w", i=1e3 * bench["i"]), "--unit", "i=mA")
    assert found["verdict"] == "ok" and abs(found["parameters"]["R"]["value"] - CML050.R) < 0.1


def test_exchanged_columns_are_refused_before_the_search_and_the_data_are_shown(file, bench, capsys, tmp_path):
    path = file("time [s],voltage [V],current [A],speed [rad/s]", i=bench["w"], w=bench["i"])
    status, found = estimate(capsys, path, "-o", tmp_path / "out")
    assert (status, found["verdict"], found["simulations"]) == (1, "refused", 0)
    assert "exchanged" in found["reasons"][0] and (tmp_path / "out" / "figure.png").exists()
    options = found["reasons"][0].split(" or say ")[1]
    import shlex

    status, found = estimate(capsys, path, *shlex.split(options))
    assert found["verdict"] == "ok" and abs(found["parameters"]["R"]["value"] - CML050.R) < 0.1


def test_a_sign_is_refused_with_an_option_that_cures_it(file, bench, capsys):
    path = file("t,u,i,w", i=-bench["i"])
    status, found = estimate(capsys, path)
    assert (status, found["simulations"]) == (1, 0) and "--scale i=-1" in found["reasons"][0]
    status, found = estimate(capsys, path, "--scale", "i=-1")
    assert (status, found["verdict"]) == (0, "ok")


def test_a_factor_says_what_the_volts_of_a_probe_are(file, bench, capsys):
    """An oscilloscope's channels are volts, whatever is connected."""
    path = file("time [s],CH1 [V],CH2 [mV],CH3 [V]", i=100 * bench["i"], w=0.01 * bench["w"])
    columns = [x for pair in ("v=CH1", "i=CH2", "w=CH3") for x in ("--column", pair)]
    for command in ("check", "estimate"):
        status, _, err = run(capsys, command, path, *columns, "--scale", "w=100")
        assert status == 2 and "'mV' is no unit of current; use one of A, mA, or say with --scale how many A a" in err
    status, found = estimate(capsys, path, *columns, "--scale", "i=10", "--scale", "w=100")
    assert found["verdict"] == "ok" and abs(found["parameters"]["R"]["value"] - CML050.R) < 0.1
    shown = json.loads(run(capsys, "check", path, *columns, "--scale", "i=10", "--scale", "w=100", "--json")[1])
    assert shown["recordings"][0]["signals"]["i"]["largest"] == pytest.approx(np.max(bench["i"]), rel=1e-5)


def test_a_transient_that_was_cut_out_is_refused_before_the_search(file, bench, capsys):
    keep = np.r_[0:201, 260:1001]
    cut = {name: y[keep] for name, y in bench.items()} | {"t": bench["t"][: len(keep)]}
    status, found = estimate(capsys, file("t,u,i,w", **cut))
    assert (status, found["simulations"]) == (1, 0) and "the transient is lost" in found["reasons"][0]


def test_a_case_file_keeps_columns_and_units(file, capsys, tmp_path):
    path = file("t,u,current A,current B", w=np.zeros(1001))
    case = tmp_path / "saved.case.toml"
    words = ("--column", "i=current A", "--unit", "w=rpm", "--save-case", case, "--workers", 1)
    run(capsys, "estimate", file("t,u,current A,n", name="two.csv"), *words)
    text = case.read_text()
    assert 'i = "current A"' in text and 'w = "rpm"' in text
    assert path.exists()


def test_check_takes_patterns_and_tells_recordings_of_one_name_apart(file, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for folder in ("up", "down"):
        (tmp_path / folder).mkdir()
        file("t,u,i,w", name=f"{folder}/run.csv")
    status, out, _ = run(capsys, "check", "*/run.csv", "-o", "out")
    assert status == 0 and "down/run.csv: v ← u" in out and "up/run.csv: v ← u" in out
    assert {p.name for p in (tmp_path / "out").iterdir()} == {"check.json", "down_run.csv.png", "up_run.csv.png"}
    status, _, err = run(capsys, "check", "up")
    assert status == 2 and "up is a folder; give its recordings with fmu-estimator check 'up/*.csv'" in err


def test_check_reads_stdin(file):
    done = forked.run("check", "-", cwd=Path.cwd(), given=file("t,u,i,n").read_bytes())
    assert done.returncode == 0 and done.stdout.startswith("stdin: v ← u")


def test_what_was_read_of_a_held_out_recording_is_told_too(file, bench, capsys):
    words = (file("t,u,i,w"), "--validate", file("t,u,i,w", name="other.csv", i=1e3 * bench["i"]))
    _, found = estimate(capsys, *words)
    assert [r["recording"] for r in found["read"]] == ["run", "other"]
    assert found["read"][1]["implausible"] and found["read"][1]["implausible"][0] in found["notes"]
    assert found["verdict"] == "doubtful" and "other.csv would have other parameters" in found["reasons"][0]


def test_a_speed_printed_to_a_tenth_rpm_is_no_encoder(file, bench, capsys):
    _, found = estimate(capsys, file("t,u,i,n", w=np.round(bench["w"] * 30 / np.pi, 1)))
    assert found["verdict"] == "ok" and found["sensors"]["w"]["sensor"] == "identity"
    assert abs(found["parameters"]["J"]["value"] / CML050.J - 1) < 0.02


EXAMPLE = Path(__file__).parent.parent / "examples" / "cml050_step.csv"
TRUTH = {"R": 3.1363, "K": 0.048774, "L": 0.01307, "J": 9.0e-6, "B": 1.69e-4}  # in the example's own comment


def german(t, v, i, w):
    """Return a file with decimal commas, semicolons and rpm."""
    rows = zip(t, v, i, 30 / np.pi * w, strict=True)
    return "Zeit;Spannung;Strom;n\n" + "\n".join(";".join(f"{x:.6g}".replace(".", ",") for x in r) for r in rows)


def microcontroller(t, v, i, w):
    """Return a file of a duty cycle, its battery, mA and an encoder's counts."""
    turned = np.concatenate([[0.0], np.cumsum((w[1:] + w[:-1]) / 2 * np.diff(t))])
    counts = np.floor(np.where(t > 0.5, turned, 0.0) * 2048 / (2 * np.pi))
    rows = zip(1e3 * t, v / 12, np.full(len(t), 12.0), 1e3 * i, counts, strict=True)
    header = "time_ms,duty,Battery (V),I_mA,enc_counts\n"
    return header + "\n".join(",".join(f"{x:.8g}" for x in row) for row in rows)


@pytest.mark.parametrize(("written", "hint"), [(german, ""), (microcontroller, "--counts 4000")])
def test_a_bare_file_with_a_benchs_own_headers_goes_from_check_to_report(written, hint, tmp_path, capsys):
    path = tmp_path / "run.csv"
    path.write_text(written(*np.loadtxt(EXAMPLE, delimiter=",", skiprows=4).T) + "\n", encoding="utf-8")
    status, _, err = run(capsys, "check", path)
    assert (status, hint in err) == ((2, True) if hint else (0, True))
    said = ("--counts", 2048) if hint else ()
    status, out, _ = run(capsys, "check", path, *said)
    assert status == 0 and "a step from 0 to 10.5 V at t = 0.5 s" in out and "Implausible" not in out
    status, out, _ = run(capsys, "estimate", path, *said, "-o", tmp_path / "out", "--workers", 1)
    found = json.loads((tmp_path / "out" / "result.json").read_text())
    assert (status, found["verdict"]) == (0, "ok") and out.startswith("read run: v ← ")
    assert out.splitlines()[0] in (tmp_path / "out" / "report.html").read_text()
    for name, true in TRUTH.items():
        estimate = found["parameters"][name]
        assert abs(estimate["value"] - true) < 4 * estimate["standard_error"], name

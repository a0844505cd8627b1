"""Every command on a terminal, as a user runs it: windows of any width, resized windows, Ctrl-C at any moment."""

from __future__ import annotations

import contextlib
import csv
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from pseudo_terminal import Screen, Terminal

from estimator.cli import main

EXAMPLES = Path(__file__).parent.parent / "examples"
REAL = EXAMPLES / "esp32_step.csv"  # of which an estimate takes long
OFFSET = 0.05  # A, of the current of `offset`
MOTOR = ("--set", "R=3.1363", "--set", "K=0.048774", "--set", "L=0.01307", "--set", "J=9e-6", "--set", "B=1.69e-4")
LATE = 3  # samples by which the voltage of `delayed` leads


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    """Return a folder of recordings: step.csv, the same with a delay, with an offset, and one without a step."""
    folder = tmp_path_factory.mktemp("bench")
    step = folder / "step.csv"
    assert main(["simulate", "dc_motor", *MOTOR, "--voltage-step", "10.5@0.1", "--stop", "0.6", "-o", str(step)]) == 0
    with open(step, newline="") as file:
        header, *rows = csv.reader(file)
    column, current = (next(j for j, text in enumerate(header) if text.startswith(name)) for name in ("v ", "i "))
    shifted = [[*row[:current], str(float(row[current]) + OFFSET), *row[current + 1 :]] for row in rows]
    (folder / "offset.csv").write_text("\n".join(",".join(row) for row in [header, *shifted]) + "\n")
    voltage = [row[column] for row in rows]
    for row, early in zip(rows, [*voltage[LATE:], *voltage[-LATE:]], strict=True):
        row[column] = early
    (folder / "delayed.csv").write_text("\n".join(",".join(row) for row in [header, *rows]) + "\n")
    for row in rows:
        row[column] = "0"
    (folder / "still.csv").write_text("\n".join(",".join(row) for row in [header, *rows]) + "\n")
    (folder / "cases").mkdir()
    for name in ("step.csv", "offset.csv"):
        shutil.copy(folder / name, folder / "cases" / name)
    return folder


def check(screen: Screen, *, status: int = 0, columns: int = 80, whole: bool = True) -> Screen:
    """Check what holds of every screen; `whole`: its lines are long enough to say how long it takes."""
    assert screen.status == status, screen.text
    assert "Traceback" not in screen.text and "internal error" not in screen.text, screen.text
    for drawing in screen.drawings:
        assert len(drawing) < columns, drawing
        assert not whole or re.search(r"search ends in [\d.]+ (s|min|h)\b|time left not known", drawing), drawing
    return screen


@pytest.mark.parametrize("columns", [80, pytest.param(200, marks=pytest.mark.full)])
def test_an_estimate_that_frees_an_offset_runs_on_a_terminal(bench, columns):
    screen = check(Terminal("estimate", "offset.csv", cwd=bench, columns=columns).run(), columns=columns)
    assert "offset i" in screen.text and screen.drawings
    assert any("K " in drawing for drawing in screen.drawings) or columns == 80
    assert screen.text[screen.text.index("read offset") :].count("\n") < 40, "below it the prompt has room"


def test_an_estimate_that_frees_a_delay_runs_on_a_terminal_and_writes_its_files(bench):
    screen = check(Terminal("estimate", "delayed.csv", "-o", "out", cwd=bench).run())
    assert "delay" in screen.text and screen.drawings
    assert {"result.json", "report.html"} <= set(os.listdir(bench / "out"))
    assert not any(f" {word} " in screen.text for word in ("outliers,", "wanders", "noise of")), "rounding is no noise"


def test_a_refused_recording_is_told_on_a_terminal(bench):
    assert "REFUSED" in check(Terminal("estimate", "still.csv", cwd=bench).run(), status=1).text


def test_a_dumb_terminal_gets_no_live_line(bench):
    screen = check(Terminal("estimate", "offset.csv", cwd=bench, term="dumb").run())
    assert screen.drawings == [] and "measurement" in screen.text
    assert "\r" not in screen.text.replace("\r\n", "")


def test_the_live_line_fits_a_window_that_is_made_narrower_while_it_is_drawn(bench):
    (bench / "long.case.toml").write_text(
        '[[recording]]\nfile = "step.csv"\n[search]\nmethod = "original"\niterations = 250\n'
    )
    terminal = Terminal("estimate", "long.case.toml", cwd=bench, columns=200)
    seen: list[int] = []

    def narrow(text: str) -> None:
        if not seen and text.count("simulations") >= 2:
            terminal.resize(60)
            seen.append(len(text))

    screen = check(terminal.run(on_text=narrow), columns=200, whole=False)
    whole = [part for part in screen.text[seen[0] :].split("\r")[2:] if not part.startswith("\n")]
    assert any("simulations" in part for part in whole), "the line was drawn again in the narrow window"
    assert all(len(part) < 60 for part in whole if "simulations" in part or not part.strip(" "))


def test_a_batch_runs_on_a_terminal(bench):
    text = check(Terminal("batch", "cases/step.csv", "cases/offset.csv", "-o", "batch", cwd=bench).run()).text
    assert re.search(r"\rof 2 cases|\r\d of 2 cases", text) and "results.csv" in text


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["simulate", "dc_motor", "--voltage-step", "10.5@0.01", "--stop", "0.02"], "time [s],v [V]"),
        (["inspect", "dc_motor"], "Nothing keeps it from use here."),
        (["check", "step.csv"], "a step from 0 to 10.5 V at t = 0.1 s"),
        (["init", "dc_motor", "step.csv"], "[parameters]"),
        (["build", "dc_motor", "-o", "mine.fmu"], "mine.fmu"),
        (["new-model", "mine"], "mine.c"),
        (["schema"], '"recording"'),
        (["completion", "bash"], "complete"),
        (["estimate", "--help"], "--bounds"),
        (["demo", "-o", "demo"], "Written to demo"),
    ],
    ids=lambda value: value[0] if isinstance(value, list) else "",
)
def test_every_other_command_runs_on_a_terminal(bench, arguments, said):
    screen = check(Terminal(*arguments, cwd=bench).run())
    assert said in screen.text
    if arguments[0] in ("inspect", "demo"):
        lines = [line.rpartition("\r")[2] for line in screen.text.replace("\r\n", "\n").split("\n")]
        assert max(map(len, lines)) <= 80, max(lines, key=len)


@pytest.fixture(scope="module")
def two_results(bench):
    for name, words in (("one", ()), ("two", ("--window", "0.05:0.3"))):
        check(Terminal("estimate", "step.csv", *words, "-o", name, cwd=bench).run())


@pytest.mark.usefixtures("two_results")
@pytest.mark.parametrize("columns", [60, 200])
def test_what_is_done_with_results_runs_on_a_terminal_and_fits_it(bench, columns):
    compared = check(Terminal("compare", "one", "two", cwd=bench, columns=columns).run())
    exported = check(Terminal("export", "two", "-o", f"tools{columns}", cwd=bench, columns=columns).run())
    assert "R " in compared.text and f"Written to tools{columns}" in exported.text
    for screen in (compared, exported):
        assert max(map(len, screen.text.replace("\r", "").split("\n"))) <= columns, screen.text


@pytest.mark.parametrize(
    ("file", "moments"), [("step.csv", 3), pytest.param(str(REAL), 10, marks=pytest.mark.full)], ids=["3", "10"]
)
def test_ctrl_c_at_any_moment_ends_in_one_sentence_and_leaves_nothing_behind(bench, file, moments):
    command = ["estimate", file, "-o", "interrupted"]
    whole = check(Terminal(*command, cwd=bench, loads=True).run()).seconds
    shutil.rmtree(bench / "interrupted")
    before, interrupted = set(os.listdir(bench)), 0
    for moment in range(moments):
        screen = Terminal(*command, cwd=bench, loads=True).run(after=whole * moment / moments)
        check(screen, status=130 if screen.status == 130 else 0)
        if screen.status == 130:
            interrupted += 1
            assert len(re.findall(r"fmu-estimator: interrupted", screen.text)) == 1
        if screen.status == 0 or (bench / "interrupted").exists():  # it ended, or was told and kept all of it
            assert set(os.listdir(bench / "interrupted")) >= {"result.json", "report.html"}
            shutil.rmtree(bench / "interrupted")
        assert set(os.listdir(bench)) == before
        if screen.status == 0:
            whole = min(whole, screen.seconds)  # the machine was busier before
    assert interrupted >= moments / 2


@pytest.mark.skipif(getattr(os, "geteuid", lambda: 1)() != 0, reason="mounting a tmpfs needs root")
def test_on_a_full_disk_the_numbers_are_kept_and_the_whole_answer_is_on_the_terminal(bench, tmp_path):
    disk = tmp_path / "disk"
    disk.mkdir()
    if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", disk], capture_output=True).returncode:
        pytest.skip("a tmpfs cannot be mounted here")
    try:
        told = said(Terminal("estimate", "step.csv", "-o", str(disk / "out"), cwd=bench))
        assert [p.name for p in (disk / "out").iterdir()] == ["result.json"]
        assert json.loads((disk / "out" / "result.json").read_text())["verdict"] == "ok"
        assert "No space left on device" in told and told.endswith(
            "result.json alone is there, so make room for the rest"
        )
        with contextlib.suppress(OSError), open(disk / "full", "wb", buffering=0) as stream:
            while stream.write(bytes(512)):
                pass
        told = said(Terminal("estimate", "offset.csv", "-o", str(disk / "two"), cwd=bench))
        assert not (disk / "two").exists() and "alone is there" not in told
        whole = told.split("here is the whole answer:")[1]
        assert "± std. error" in whole and "simulations (" in whole and "No space left on device" in whole
    finally:
        subprocess.run(["umount", disk], check=True)


def said(terminal: Terminal) -> str:
    """Return what a command that could not write its files said, in one line."""
    return " ".join(check(terminal.run(), status=2).text.split())


def test_what_lies_beside_a_recording_is_not_run(bench, tmp_path):
    """Worker processes took modules such as ``queue`` from the folder in which the program was started."""
    for name in ("queue", "struct", "signal", "types", "select", "platform"):
        (tmp_path / f"{name}.py").write_text("from pathlib import Path\nPath('RUN').touch()\nraise SystemExit(7)\n")
    shutil.copy(bench / "step.csv", tmp_path / "step.csv")
    for command in (["estimate", "step.csv", "-o", "out"], ["batch", "step.csv", "-o", "cases"]):
        program = [sys.executable, "-P", "-m", "estimator", *command]
        done = subprocess.run(program, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert done.returncode == 0 and not (tmp_path / "RUN").exists(), (command, done.stderr)

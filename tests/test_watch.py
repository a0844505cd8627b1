"""A watched folder: half-written files, restarts, the page, and the command that is told (watch.py, incoming.py)."""

import contextlib
import json
import os
import shutil
import signal
import sys
import time
from pathlib import Path

import pytest
from forked import Kept

from estimator.batches import watch as watching
from estimator.batches.batch_folder import folder_name
from estimator.batches.case_worker import Outcome, failed
from estimator.batches.incoming import Incoming
from estimator.batches.watch import TOLD, Teller, watch
from estimator.cli import main
from estimator.errors import CaseError, InputError

ROOT = Path(__file__).parent.parent
EXAMPLE = ROOT / "examples" / "cml050_step.csv"
LISTENER = """\
import json, os, sys
case = json.load(sys.stdin)
with open(sys.argv[1], "a") as stream:
    about = [case["case"], case["outcome"], case["exit_status"], os.environ["FMU_ESTIMATOR_STATUS"]]
    stream.write(json.dumps(about) + "\\n")
sys.exit(int(sys.argv[2]))
"""


class Clock:
    now = 100.0

    def __call__(self):
        return self.now


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def logger(tmp_path):
    folder = tmp_path / "logger"
    folder.mkdir()
    return folder


@pytest.fixture
def incoming(logger, tmp_path, clock):
    return Incoming(logger, [], tmp_path / "line", clock=clock)


@pytest.fixture
def quick(monkeypatch):
    monkeypatch.setattr(watching, "EVERY", 0.0)


def names(incoming):
    return [a.task.name for a in incoming.arrivals() if not isinstance(a, CaseError)]


def made_up(tasks, verdict="ok"):
    for task in tasks:
        row = failed(task, "made up").row | {"verdict": verdict, "reasons": []}
        yield task, Outcome(row, {"result.json": b"{}"}, {"seconds": 0.1})


def rounds(count, clock):
    """Return an `until` that lets the folder be looked at so many times, 10 s apart."""
    looks = iter(range(count))

    def until():
        clock.now += 10.0
        return next(looks, None) is None

    return until


def told(path):
    return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []


@pytest.fixture
def listener(tmp_path):
    """Return a command that writes down what it is told, and where."""
    script, heard = tmp_path / "listen.py", tmp_path / "heard.jsonl"
    script.write_text(LISTENER)
    return f'"{sys.executable}" "{script}" "{heard}" 0', heard


def test_a_file_that_is_still_written_is_left_alone_until_it_is_at_rest(incoming, logger, clock):
    (logger / "m1.csv").write_text("")
    assert names(incoming) == []
    clock.now += 60
    assert names(incoming) == []  # it is empty: only begun
    with (logger / "m1.csv").open("a") as stream:
        for _ in range(4):
            stream.write("row\n")
            stream.flush()
            clock.now += 1.5
            assert names(incoming) == []
    clock.now += 1.5
    assert names(incoming) == []
    clock.now += 1.0
    assert names(incoming) == ["m1.csv"]


def test_what_is_no_recording_by_its_name_and_the_batchs_own_folder_do_not_count(logger, clock):
    for name in (
        "m1.csv",
        ".m2.csv",
        "~m3.csv",
        "m4.csv.part",
        "notes.pdf",
        "day/m5.csv",
        "line/results.csv",
        "\udcff.csv",
    ):
        (logger / name).parent.mkdir(exist_ok=True)
        (logger / name).write_text("x")
    (logger / "settings.json").write_text("{}")
    (logger / "sysid.json").write_text('{"sysid": true, "slow-forward": []}')
    incoming = Incoming(logger, [], logger / "line", clock=clock)
    assert names(incoming) == []
    clock.now += 3
    assert names(incoming) == ["m1.csv", "sysid.json", "day/m5.csv"]


def test_a_case_file_says_what_is_done_with_each_recording_and_those_that_are_missing_are_waited_for(
    logger, tmp_path, clock
):
    (tmp_path / "motors.csv").write_text("serial,R\nA1,3.1\nA2,3.2\n")
    (tmp_path / "line.case.toml").write_text(
        '[motors]\nfile = "motors.csv"\n[[recording]]\nfile = "{serial}_*.csv"\n'
        '[parameters.R]\nmin = 0.1\n[expect]\nR = { value = "{R}", within = "3 %" }\n'
    )
    incoming = Incoming(logger, [tmp_path / "line.case.toml"], tmp_path / "out", clock=clock)
    (logger / "A2_1.csv").write_text("x")
    names(incoming)
    clock.now += 3
    (arrival,) = incoming.arrivals()
    assert arrival.task.name == "line[A2,A2_1]" and arrival.task.case.expect["R"].value == 3.2


def test_a_case_file_that_appears_in_the_folder_takes_the_recordings_that_it_names(incoming, logger, clock):
    (logger / "m1.csv").write_text("x")
    (logger / "m2.csv").write_text("x")
    (logger / "both.case.toml").write_text('[[recording]]\nfile = "m1.csv"\n')
    names(incoming)
    clock.now += 3
    assert names(incoming) == ["both", "m2.csv"]


def test_a_mistake_in_a_case_file_is_told_once_and_does_not_end_the_watch(incoming, logger, clock, quick):
    (logger / "bad.case.toml").write_text("[fmu\n")
    (logger / "m1.csv").write_text("x")
    complaints = []
    result = watch(incoming, made_up, complain=complaints.append, until=rounds(4, clock))
    assert len(complaints) == 1 and "bad.case.toml line 1" in complaints[0]
    assert [row["case"] for row in result.rows] == ["m1.csv"]


def test_what_changes_while_it_is_estimated_is_estimated_again_when_it_is_at_rest(incoming, logger, clock, quick):
    (logger / "m1.csv").write_text("half")
    seen = []

    def run(tasks):
        for task, outcome in made_up(tasks):
            seen.append((logger / "m1.csv").read_text())
            if len(seen) == 1:
                (logger / "m1.csv").write_text("half, and the rest")
            yield task, outcome

    lines = []
    watch(incoming, run, say=lines.append, until=rounds(5, clock))
    assert seen == ["half", "half, and the rest"]
    assert lines == ["m1.csv: pass"]


def test_a_recording_that_is_replaced_is_estimated_anew_and_its_verdict_told_anew(
    incoming, logger, clock, quick, listener
):
    command, heard = listener
    (logger / "m1.csv").write_text("one")
    watch(incoming, made_up, teller=Teller(command), until=rounds(3, clock))
    (logger / "m1.csv").write_text("another")
    result = watch(incoming, lambda tasks: made_up(tasks, "refused"), teller=Teller(command), until=rounds(3, clock))
    assert [row["verdict"] for row in result.rows] == ["refused"]
    assert told(heard) == [["m1.csv", "pass", 0, "0"], ["m1.csv", "refused", 1, "1"]]


def test_started_again_it_goes_on_and_tells_nothing_twice(logger, tmp_path, clock, quick, listener):
    command, heard = listener
    for k in range(3):
        (logger / f"m{k}.csv").write_text(str(k))
    ran = []

    def run(tasks):
        for task, outcome in made_up(tasks):
            ran.append(task.name)
            yield task, outcome

    def again(looks, **more):
        return watch(Incoming(logger, [], tmp_path / "line", clock=clock), run, until=rounds(looks, clock), **more)

    again(3, teller=Teller(command))
    (logger / "m0.csv").unlink()  # what was estimated stays on the page, wherever its recording goes
    (logger / "m3.csv").write_text("3")
    result = again(3, teller=Teller(command))
    assert ran == ["m0.csv", "m1.csv", "m2.csv", "m3.csv"]
    assert [name for name, *_ in told(heard)] == ran
    assert [row["case"] for row in result.rows] == ran
    assert sorted(file.name for file in logger.iterdir()) == ["m1.csv", "m2.csv", "m3.csv"]


def test_a_verdict_that_was_not_told_before_it_was_killed_is_told_after(incoming, logger, clock, quick, listener):
    command, heard = listener
    (logger / "m1.csv").write_text("x")
    watch(incoming, made_up, until=rounds(3, clock))
    (incoming.output / TOLD).write_text('{"case": "m1.csv", "dig')  # cut off in the middle of a line
    with (incoming.output / TOLD).open("a") as stream:
        stream.write("\n")
    watch(incoming, made_up, teller=Teller(command), until=rounds(1, clock))
    watch(incoming, made_up, teller=Teller(command), until=rounds(1, clock))
    assert told(heard) == [["m1.csv", "pass", 0, "0"]]


def test_the_page_is_there_after_each_case_reads_itself_again_and_stops_when_the_watch_ends(
    incoming, logger, clock, quick
):
    page = incoming.output / "index.html"
    pages = []

    def say(line):
        pages.append(page.read_text())

    (logger / "m1.csv").write_text("1")
    (logger / "m2.csv").write_text("2")
    watch(incoming, made_up, say=say, until=rounds(3, clock))
    assert 'data-renew="10"' in pages[0] and 'data-case="m2.csv"' not in pages[0]
    assert 'data-case="m2.csv"' in pages[1]
    assert "data-renew=" not in page.read_text()
    assert f"cases/{folder_name('m1.csv')}/result.json" in page.read_text()


@pytest.mark.parametrize(
    ("command", "patience", "sentence"),
    [
        (f'"{sys.executable}" -c "import sys; sys.exit(3)"', 60.0, "ended with status 3"),
        (f'"{sys.executable}" -c "import time; time.sleep(60)"', 1.0, "took more than 1 s and was ended"),
    ],
)
def test_a_command_that_fails_is_told_and_the_watch_goes_on(
    command, patience, sentence, incoming, logger, clock, quick, monkeypatch
):
    monkeypatch.setattr(watching, "PATIENCE", patience)
    (logger / "m1.csv").write_text("x")
    complaints = []
    result = watch(incoming, made_up, teller=Teller(command), complain=complaints.append, until=rounds(3, clock))
    assert len(complaints) == 1 and complaints[0].startswith("m1.csv: ") and sentence in complaints[0]
    assert len(result.rows) == 1


def test_a_command_that_does_not_read_what_it_is_told_does_no_harm(incoming, logger, clock, quick):
    (logger / "m1.csv").write_text("x")
    complaints = []
    teller = Teller(f'"{sys.executable}" -c "pass"')
    watch(incoming, made_up, teller=teller, complain=complaints.append, until=rounds(3, clock))
    assert not complaints


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--watch", "nowhere"], "there is no folder"),
        (["--watch", ".", "m1.csv"], "is no case file; with --watch give files *.case.toml, or none"),
        (["--watch", ".", "--then", "no-such-program-anywhere"], "there is no program 'no-such-program-anywhere'"),
        (["--watch", ".", "--then", "'half"], "close its quotes"),
        (["--watch", ".", "--monte-carlo", "3"], "leave them out, or --watch"),
        (["--then", "true", "m1.csv"], "--then and --settled are those of --watch"),
        ([], "no case is given"),
    ],
)
def test_what_cannot_be_watched_is_one_sentence_and_status_2(arguments, sentence, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("m1.csv").write_text("x")
    assert main(["batch", *arguments]) == 2
    said = capsys.readouterr().err
    assert sentence in said and len(said.splitlines()) == 1


def test_two_watches_of_one_folder_are_refused(incoming, logger, clock, quick):
    def run(tasks):
        with pytest.raises(InputError, match="another batch is at work"):
            watch(incoming, made_up, until=rounds(1, clock))
        yield from made_up(tasks)

    (logger / "m1.csv").write_text("x")
    assert len(watch(incoming, run, until=rounds(3, clock)).rows) == 1


def test_the_command_line_watches_a_logger_that_writes_slowly_until_ctrl_c(logger, tmp_path, listener):
    command, heard = listener
    whole = EXAMPLE.read_bytes()
    (tmp_path / "line.case.toml").write_text('[search]\nnests = 4\niterations = 2\n[[recording]]\nfile = "*.csv"\n')
    arguments = ["batch", "line.case.toml", "--watch", "logger", "-o", "out", "--then", command, "--settled", "1"]
    environment = {**os.environ, "FMU_ESTIMATOR_DEBUG": "1"}

    @contextlib.contextmanager
    def started():
        process = Kept(*arguments, cwd=tmp_path, env=environment)
        try:
            yield process
        finally:
            process.kill()
            process.wait()

    def heard_of(count, process):
        end = time.monotonic() + 180
        while len(told(heard)) < count:
            assert process.poll() is None and time.monotonic() < end, "it has ended, or hears of nothing"
            time.sleep(0.1)

    with started() as process:
        with (logger / "m1.csv").open("wb") as stream:
            for k in range(4):  # in four parts, each less than the time of rest apart
                time.sleep(0.25 if k else 0.0)
                stream.write(whole[k * len(whole) // 4 : (k + 1) * len(whole) // 4])
                stream.flush()
        heard_of(1, process)
        while not told(tmp_path / "out" / TOLD):  # killed before that, it would tell it once more
            time.sleep(0.05)
    with started() as process:
        shutil.copy(EXAMPLE, logger / "m2.csv")
        heard_of(2, process)
        process.send_signal(signal.SIGINT)
        said, complained = process.communicate(timeout=60)
        assert process.returncode == 0, complained
    assert [name for name, *_ in told(heard)] == ["line[m1]", "line[m2]"]
    assert said.decode().startswith("line[m2]: ")
    assert 'data-case="line[m1]"' in (tmp_path / "out" / "index.html").read_text()
    assert sorted(file.name for file in logger.iterdir()) == ["m1.csv", "m2.csv"]

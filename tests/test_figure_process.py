"""Figures from a process of their own: the same as here, and here where that process is gone."""

import os

import numpy as np
import pytest
from drawing import FigureProcess
from made_estimates import comparison, estimate
from motors import CML050, step_recording, write_recording

from estimator.cli import main
from estimator.results import figure_process
from estimator.results.export import result_files
from estimator.results.figure_process import draw

SHORT = estimate(comparisons=(comparison(np.full(30, 10.5)),))


def test_a_process_draws_what_is_drawn_here():
    with FigureProcess() as process:
        files = result_files(SHORT, begin=process.begin)
    assert files == result_files(SHORT) and files["figure.png"].startswith(b"\x89PNG")
    assert process._process.poll() is not None, "it ends with the statement"


def test_an_estimate_draws_in_a_process_what_it_draws_here(tmp_path, monkeypatch, capsys):
    write_recording(step_recording(CML050, duration=0.8), tmp_path / "step.csv")
    started = []

    class Noted(FigureProcess):
        def begin(self, *of):
            started.append(self._process)
            return super().begin(*of)

    drawn = {}
    for name, how in (("here", figure_process.FigureProcess), ("there", Noted)):
        monkeypatch.setattr(figure_process, "FigureProcess", how)
        words = ["estimate", str(tmp_path / "step.csv"), "-o", str(tmp_path / name), "--quiet"]
        assert main([*words, "--figures", "svg"]) == 0
        drawn[name] = [(tmp_path / name / f"figure.{kind}").read_bytes() for kind in ("png", "svg")]
        assert main(words) == 0, "a PNG alone asks for no process"
    assert len(started) == 1 and started[0].returncode == 0 and drawn["here"] == drawn["there"]


def test_where_the_process_is_gone_the_figure_is_drawn_here(monkeypatch):
    monkeypatch.setattr(figure_process, "draw", lambda *_: {"figure.png": b"drawn here"})
    with FigureProcess() as process:
        process._process.kill()
        assert process.begin(SHORT, ("png",))() == {"figure.png": b"drawn here"}


def test_a_process_that_cannot_be_started_is_none(monkeypatch):
    monkeypatch.setattr(figure_process.sys, "executable", os.devnull + "/nothing")
    monkeypatch.setattr(figure_process, "draw", lambda *_: {"figure.png": b"drawn here"})
    with FigureProcess() as process:
        assert process.begin(SHORT, ("png",))() == {"figure.png": b"drawn here"}


def test_an_error_in_between_ends_the_process():
    with pytest.raises(KeyboardInterrupt), FigureProcess() as process:
        raise KeyboardInterrupt
    assert process._process.poll() is not None


def test_without_a_recording_there_is_nothing_to_draw():
    assert draw(estimate(comparisons=()), ("png",)) == {}
    with FigureProcess() as process:
        assert process.begin(estimate(comparisons=()), ("png",))() == {}

"""A new model file builds as it is, and never takes the place of another."""

from __future__ import annotations

from pathlib import Path

import pytest
from fmpy.validation import validate_fmu

import fmu_build
from estimator.cli import main

pytestmark = pytest.mark.usefixtures("compiled_quickly")


def test_new_model_builds_as_it_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["new-model", "my_motor"]) == 0
    assert capsys.readouterr().out == "my_motor.c\n"
    assert "fmu-estimator build my_motor.c" in Path("my_motor.c").read_text()
    assert validate_fmu(str(fmu_build.build("my_motor.c"))) == []


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("my_motor.c", "my_motor.c is there already; give another name, or remove it"),
        ("dc_motor", "dc_motor is a bundled model; give yours another name"),
        ("my-motor", "my-motor.c: the name becomes a C identifier; use letters"),
        ("nowhere/motor", "nowhere/motor.c cannot be written (No such file"),
    ],
)
def test_new_model_that_cannot_be_is_one_sentence(tmp_path: Path, monkeypatch, capsys, name: str, said: str) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "my_motor.c").write_text("mine")
    assert main(["new-model", name]) == 2
    assert said in capsys.readouterr().err
    assert (tmp_path / "my_motor.c").read_text() == "mine"

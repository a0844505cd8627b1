"""The page on how to add an effect: its code is run, and does what the page says."""

import dataclasses
import re
from pathlib import Path

import pytest
from effect_bench import lagged, recording, worst

from estimator.cases.case import Case, OutputSpec
from estimator.estimating.estimate import estimate_recordings
from estimator.explaining.effects import EFFECTS
from estimator.fitting.fit import Linear
from estimator.fitting.simulator import Nuisance

pytestmark = pytest.mark.usefixtures("shared_workers")

PAGE = Path(__file__).parent.parent / "docs" / "add-an-effect.md"
CASE = Case(inputs={"v": "voltage"}, outputs={"i": OutputSpec("current"), "w": OutputSpec("speed")})
OTHERS = tuple(e for e in EFFECTS if "lag" not in e.name.split())


@pytest.fixture
def of_the_page():
    (code,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.S)
    names = {"__name__": "page"}
    exec(compile(code, str(PAGE), "exec"), names)
    return names["FirstOrderLag"]()


def found(monkeypatch, effects, **sensors):
    monkeypatch.setattr("estimator.estimating.search_and_polish.known_effects", lambda: effects)
    return estimate_recordings([CASE], [[recording("two levels", **sensors)]], workers=1)[0]


def test_an_effect_of_ones_own_is_found_named_and_estimated(monkeypatch, of_the_page):
    result = found(monkeypatch, (*OTHERS, of_the_page), i=lambda y: lagged(y, 2e-3))
    tau = result.chain["amplifier of i"]
    assert abs(tau.value - 2e-3) < 4 * tau.standard_error < 1e-3 and worst(result) < 4.5
    assert any(note.startswith("i is shown behind an amplifier of 2") for note in result.notes)


def test_it_is_not_named_where_it_is_not(monkeypatch, of_the_page):
    result = found(monkeypatch, (*OTHERS, of_the_page))
    assert not result.chain and result.verdict == "ok" and worst(result) < 4.5


def test_every_part_of_the_interface_that_the_page_names_is_there(of_the_page):
    page = PAGE.read_text(encoding="utf-8")
    named = set(re.findall(r"^\| `(\w+)", page, re.M))
    others = {f.name for part in (Nuisance, Linear) for f in dataclasses.fields(part)}  # of what an effect gives
    assert named and all(hasattr(of_the_page, n) or n in others for n in named)

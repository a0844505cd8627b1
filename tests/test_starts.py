"""Starts of the user: values, several of them, and tables of earlier results, each polished beside the search."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

import fmu_build
from estimator.cases.case import read_case
from estimator.cases.starts import read_starts, values_of
from estimator.cases.written_case import write_case
from estimator.cli import main
from estimator.errors import InputError
from estimator.estimating.estimate import estimate

pytestmark = pytest.mark.usefixtures("compiled_quickly")

MODEL = Path(__file__).parent / "models" / "wave.c"
RATE, SIZE = 217.3, 1.7
CASE = """
[fmu]
path = "wave.fmu"
[outputs]
y = "y"
[parameters]
rate = {{ {0}min = 2, max = 1500 }}
size = {{ min = 0.1, max = 100 }}
[[recording]]
file = "wave.csv"
[search]
seed = 2
{1}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    where = tmp_path_factory.mktemp("wave")
    fmu_build.build(MODEL, output=where / "wave.fmu")
    t = np.arange(2001) * 2e-3
    y = SIZE * np.sin(RATE * t) + 0.01 * np.random.default_rng(1).standard_normal(len(t))
    np.savetxt(where / "wave.csv", np.column_stack([t, y]), delimiter=",", header="time [s],y [m]", comments="")
    return where


def case(folder, start="", search=""):
    path = folder / "wave.case.toml"
    path.write_text(CASE.format(start, search))
    return path


def found(result):
    return abs(result.parameters["rate"].value - RATE) < 4 * result.parameters["rate"].standard_error < 1e-3


def test_a_start_is_polished_from_whatever_the_search_finds_in_wide_bounds(folder):
    assert not found(estimate(read_case(case(folder))))  # the search alone misses it
    result = estimate(read_case(case(folder, start=f"start = {RATE + 0.2}, ")))
    assert found(result)
    assert result.verdict == "ok"


def test_of_several_starts_the_best_wins(folder):
    starts = "starts = [{ rate = 50 }, { rate = 217.1, size = 1 }, { rate = 900 }]"
    assert found(estimate(read_case(case(folder, search=starts))))


def test_a_table_of_earlier_results_gives_starts(folder):
    rates = [*np.linspace(30, 1500, 40), 217.45]
    lines = "".join(f"m{k},{'refused' if k == 3 else 'ok'},{x / (2 * math.pi)},\n" for k, x in enumerate(rates))
    (folder / "earlier.csv").write_text("case,verdict,rate [rev/s],size [m]\n" + lines)
    assert found(estimate(read_case(case(folder, search='starts = "earlier.csv"'))))
    assert len(read_starts(folder / "earlier.csv")) == 40  # the refused one is passed over


def test_the_result_of_an_earlier_estimate_gives_a_start_on_the_command_line(folder, capsys):
    good = case(folder, start=f"start = {RATE}, ")
    assert main(["estimate", str(good), "--json"]) == 0
    (folder / "result.json").write_text(capsys.readouterr().out)
    bad = case(folder)
    assert main(["estimate", str(bad), "--start", str(folder / "result.json"), "--json"]) == 0
    assert abs(json.loads(capsys.readouterr().out)["parameters"]["rate"]["value"] - RATE) < 1e-3
    assert main(["estimate", str(bad), "--start", "rate=100", "--start", "rate=217.2,size=2", "--json"]) == 0
    assert abs(json.loads(capsys.readouterr().out)["parameters"]["rate"]["value"] - RATE) < 1e-3


def test_starts_survive_writing_the_case(folder):
    (folder / "few.csv").write_text("rate\n5\n")
    read = read_case(case(folder, search='starts = ["few.csv", { rate = 50, size = 2 }]'))
    write_case(read, folder / "again.case.toml")
    assert read_case(folder / "again.case.toml").search == read.search
    assert '"few.csv"' in (folder / "again.case.toml").read_text()


@pytest.mark.parametrize(
    ("search", "sentence"),
    [
        ('starts = "none.csv"', "there is no table of starts 'none.csv'"),
        ("starts = [{ rate = true }]", "search.starts must be files, or values such as { R = 3, K = 0.05 }"),
        ("starts = [3]", "search.starts must be files, or values such as { R = 3, K = 0.05 }"),
    ],
)
def test_what_is_no_start_is_said_with_its_line(folder, search, sentence):
    with pytest.raises(InputError, match="line 13") as raised:
        read_case(case(folder, search=search))
    assert sentence in str(raised.value)


def test_a_start_of_what_is_no_parameter_is_said(folder):
    with pytest.raises(InputError, match="a start is given for 'rat', which is no parameter; did you mean 'rate'"):
        estimate(read_case(case(folder, search="starts = [{ rat = 50 }]")))


def test_a_start_outside_its_bounds_is_said(folder):
    with pytest.raises(InputError, match=r"the start rate = -1 lies outside its bounds "):
        estimate(read_case(case(folder, search="starts = [{ rate = -1 }]")))


def test_a_table_of_starts_may_have_decimal_commas_where_no_comma_parts_its_cells(tmp_path):
    """It "holds no start: no column is called as a free parameter"."""
    (tmp_path / "earlier.csv").write_text("R;K;note\n3,1;0,05;a, b\n3.2;;\n")
    assert read_starts(tmp_path / "earlier.csv") == [{"R": 3.1, "K": 0.05}, {"R": 3.2}]
    (tmp_path / "earlier.csv").write_text('R,K\n"3,1",0.05\n')
    assert read_starts(tmp_path / "earlier.csv") == [{"K": 0.05}]


def test_a_file_without_a_start_is_said(tmp_path):
    (tmp_path / "other.csv").write_text("R,K\n3,0.05\n")
    with pytest.raises(InputError, match=r"other.csv holds no start: no column is called as a free parameter \(rate\)"):
        values_of([str(tmp_path / "other.csv")], {"rate": (0.0, 9.0)}, ())
    (tmp_path / "other.json").write_text('{"parameters": 3}')
    with pytest.raises(InputError, match="other.json is no result of an estimate"):
        read_starts(tmp_path / "other.json")
    with pytest.raises(InputError, match="there is no such file"):
        read_starts(tmp_path / "none.csv")


def test_an_option_that_is_no_start_is_said(capsys):
    assert main(["estimate", "x.csv", "--start", "nowhere.csv"]) == 2
    assert "there is no file 'nowhere.csv'; give one, or NAME=VALUE,NAME=VALUE" in " ".join(
        capsys.readouterr().err.split()
    )

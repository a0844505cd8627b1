"""The page on how to add a method: its package is laid out from the page, found by its entry point, and estimates."""

import json
import os
import re
import tomllib
from pathlib import Path

import forked
import pytest

from estimator.errors import InputError
from estimator.estimating.optimiser import Optimiser
from estimator.method_names import GROUP, loaded

ROOT = Path(__file__).resolve().parent.parent
PAGE = (ROOT / "docs" / "add-a-method.md").read_text(encoding="utf-8")
EXAMPLE = ROOT / "examples" / "cma_search"
RECORDING = str(ROOT / "examples" / "cml050_step.csv")


def installed(folder, *, code, project):
    """Lay out a package as pip would install it; return the environment in which it is found."""
    points = tomllib.loads(project)["project"]["entry-points"][GROUP]
    module = next(iter(points.values())).partition(":")[0]
    (folder / f"{module}.py").write_text(code)
    info = folder / "a_search-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: a-search\nVersion: 1.0\n")
    lines = [f"[{GROUP}]", *(f"{name} = {target}" for name, target in points.items())]
    (info / "entry_points.txt").write_text("\n".join(lines) + "\n")
    return {**os.environ, "PYTHONPATH": str(folder)}


def run(*arguments, env):
    return forked.run(*arguments, env=env, cwd=ROOT)


@pytest.fixture
def of_the_page(tmp_path):
    (code,) = re.findall(r"```python\n(.*?)```", PAGE, re.S)
    (project,) = re.findall(r"```toml\n(.*?)```", PAGE, re.S)
    return installed(tmp_path, code=code, project=project)


def test_a_search_of_ones_own_is_a_method_with_a_polish_and_standard_errors(of_the_page):
    done = run("estimate", RECORDING, "--method", "swarm", "--json", env=of_the_page)
    found = json.loads(done.stdout)
    assert (found["method"], found["verdict"]) == ("swarm", "ok")
    assert found["simulations_by_phase"]["search"] == 10 * (1 + 8)
    R = found["parameters"]["R"]
    assert abs(R["value"] - 3.1363) < 3 * R["standard_error"] < 0.05


def test_it_is_a_word_of_case_files_and_of_their_schema_too(of_the_page, tmp_path):
    schema = json.loads(run("schema", env=of_the_page).stdout)
    assert "swarm" in schema["properties"]["search"]["properties"]["method"]["enum"]
    case = tmp_path / "m.case.toml"
    case.write_text(f'[[recording]]\nfile = "{RECORDING}"\n[search]\nmethod = "swarm"\nnests = 6\niterations = 3\n')
    found = json.loads(run("estimate", str(case), "--json", env=of_the_page).stdout)
    assert found["simulations_by_phase"]["search"] == 6 * (1 + 3)


@pytest.mark.parametrize("again", [False, pytest.param(True, marks=pytest.mark.full)])
def test_cma_es_comes_from_a_package_outside(tmp_path, again):
    pytest.importorskip("cma")
    code, project = ((EXAMPLE / name).read_text() for name in ("cma_search.py", "pyproject.toml"))
    env = installed(tmp_path, code=code, project=project)
    command = ("estimate", RECORDING, "--method", "cma-es", "--json")
    found = json.loads(run(*command, env=env).stdout)
    assert found["verdict"] == "ok" and found["simulations_by_phase"]["search"] == 90
    assert not again or json.loads(run(*command, env=env).stdout)["parameters"] == found["parameters"]


def test_a_package_that_cannot_be_imported_is_one_sentence(tmp_path):
    project = (EXAMPLE / "pyproject.toml").read_text()
    env = installed(tmp_path, code="import there_is_no_such_module\n", project=project)
    done = run("estimate", RECORDING, "--method", "cma-es", env=env)
    assert done.returncode == 2 and "the method 'cma-es' cannot be loaded from cma_search:CmaEs" in done.stderr
    assert "there_is_no_such_module" in done.stderr and "Traceback" not in done.stderr


def test_an_unknown_method_is_an_error_that_names_those_there_are():
    with pytest.raises(InputError, match=r"there is no method 'cukoo'; did you mean 'cuckoo'\? \(cuckoo, paper, "):
        loaded("cukoo")


def test_every_part_of_the_interface_that_the_page_names_is_there():
    named = set(re.findall(r"`(\w+)(?:\([\w, ]*\))?`", PAGE.split("| | |")[1].split("\n\n")[0]))
    assert named == {"ask", "tell", "points", "costs", "best", "best_cost", "asks", "done"}
    assert all(hasattr(Optimiser, name) or f"{name} : " in Optimiser.__doc__ for name in named)

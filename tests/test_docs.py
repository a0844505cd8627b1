"""The documentation: its examples run, its generated pages hold what there is, its links lead somewhere."""

import html
import importlib.util
import json
import posixpath
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
from test_browser import BROWSER

from estimator.commands.arguments import parse

ROOT = Path(__file__).resolve().parent.parent
EXAMPLE = ROOT / "examples" / "cml050_step.csv"


def loaded(path: Path):
    """Return a module that is in no package."""
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = module
    spec.loader.exec_module(module)
    return module


def test_the_examples_of_the_python_page_run(tmp_path, monkeypatch, capsys):
    (tmp_path / "examples").mkdir()
    shutil.copy(EXAMPLE, tmp_path / "examples")
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / "docs" / "api.md").read_text(), re.S)
    names: dict[str, object] = {}
    for block in blocks:
        exec(compile(block, "docs/api.md", "exec"), names)
    assert len(blocks) == 6 and "nowhere.csv" in capsys.readouterr().out
    assert {p.name for p in (tmp_path / "out").iterdir()} >= {"report.html", "motor_parameters.m"}


def test_every_line_that_is_shown_is_one_of_the_command_line(tmp_path, monkeypatch, capsys):
    """Read by the command line's parser, each with all its options; none is run."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "run3").mkdir()
    (tmp_path / "run3" / "result.json").touch()  # that a line starts from
    pages = "\n".join(page.read_text() for page in (ROOT / "README.md", *(ROOT / "docs").rglob("*.md")))
    lines = re.findall(r"^ *(?:\$ |\.venv/bin/)?fmu-estimator (.*?)(?:$| &&|  )", pages, re.M)
    assert len(lines) > 40
    for line in lines:
        parse(shlex.split(line))  # else it leaves with status 2
    assert capsys.readouterr().err == ""


def test_every_page_is_in_the_navigation_and_every_link_leads_to_one():
    listed = set(re.findall(r"(\S+\.md)", (ROOT / "mkdocs.yml").read_text()))
    pages = {path.relative_to(ROOT / "docs").as_posix() for path in (ROOT / "docs").rglob("*.md")}
    assert pages | {"case-file.md"} == listed
    for page in pages:
        for target in re.findall(r"\]\(([^)#:]+\.md)", (ROOT / "docs" / page).read_text()):
            assert posixpath.normpath(f"{posixpath.dirname(page)}/{target}").lstrip("/") in listed, (page, target)


def test_the_case_file_reference_has_every_key_of_the_schema():
    page = loaded(ROOT / "docs" / "hooks.py").case_file_page()
    for key in ("fmu.path", "fmu.step", "inputs.NAME", "outputs.NAME.sensor", "parameters.NAME.nominal", "search.seed"):
        assert f"| `{key}` |" in page, key
    assert "cuckoo" in page and all(line.count(" | ") == 2 for line in page.splitlines() if line.startswith("| `"))


def test_the_reference_has_all_public_names_with_their_errors():
    text = loaded(ROOT / "docs" / "hooks.py").api_reference()
    import estimator

    assert re.findall(r"^### (\w+)$", text, re.M) == estimator.__all__
    assert text.count("Raises\n------") >= 5 and "- `state_space`: Return the motor" in text


@pytest.mark.full
def test_the_site_builds_without_a_warning(tmp_path):
    if importlib.util.find_spec("mkdocs") is None:
        pytest.skip("mkdocs is not installed")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "-q", "-d", str(tmp_path / "site")]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "site" / "case-file.html").is_file()


def test_the_bar_of_the_site_has_at_most_seven_entries():
    bar = re.findall(r"^  - (\w[^:]*):", (ROOT / "mkdocs.yml").read_text().split("nav:")[1], re.M)
    assert bar[0] == "Home" and len(bar) <= 7


PROBE = """<script>addEventListener("load", () => {
  const input = document.getElementById("mkdocs-search-query");
  input.value = "encoder eccentricity";
  input.dispatchEvent(new Event("input"));
  setInterval(() => {
    const found = [...document.querySelectorAll("#mkdocs-search-results a")].map(a => a.getAttribute("href"));
    const wide = document.documentElement.scrollWidth - document.documentElement.clientWidth;
    if (found.length) document.title = JSON.stringify({ found, wide }) }, 100) })</script>"""


@pytest.mark.full
@pytest.mark.skipif(BROWSER is None, reason="no chromium here: apt-get install chromium")
def test_every_page_searches_fits_a_phone_and_leaves_the_console_empty(tmp_path):
    if importlib.util.find_spec("mkdocs") is None:
        pytest.skip("mkdocs is not installed")
    site = tmp_path / "site"
    subprocess.run([sys.executable, "-m", "mkdocs", "build", "-q", "-d", str(site)], cwd=ROOT, check=True)
    pages = [page for page in site.rglob("*.html") if page.name != "404.html"]
    frames = []
    for page in pages:
        page.write_text(page.read_text().replace("</body>", PROBE + "</body>"))
        frames.append(f'<iframe src="{page.relative_to(site)}" width="400" height="900"></iframe>')
    gather = (
        "<script>setInterval(() => { const all = [...document.querySelectorAll('iframe')].map(f =>"
        " [f.getAttribute('src'), f.contentDocument.title]);"
        " if (all.every(([_, t]) => t.startsWith('{'))) document.title = JSON.stringify(all) }, 200)</script>"
    )
    (site / "all.html").write_text(f"<!DOCTYPE html><meta charset=utf-8><title></title>{''.join(frames)}{gather}")
    command = [BROWSER, "--headless", "--no-sandbox", "--disable-gpu", "--enable-logging=stderr"]
    command += ["--allow-file-access-from-files", "--virtual-time-budget=60000", "--dump-dom"]
    command += [f"--user-data-dir={tmp_path / 'profile'}", "--host-resolver-rules=MAP * ~NOTFOUND"]
    done = subprocess.run([*command, (site / "all.html").as_uri()], capture_output=True, text=True, timeout=120)
    assert "CONSOLE" not in done.stderr, done.stderr
    told = json.loads(html.unescape(re.search("<title>(.*?)</title>", done.stdout, re.S)[1]))
    assert len(told) == len(pages) >= 15
    for page, said in told:
        said = json.loads(said)
        assert said["wide"] <= 0, page
        assert (site / page).parent.joinpath(said["found"][0]).resolve() == site / "recordings.html", page


# --- the PI gains of the example -----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def example():
    return loaded(ROOT / "examples" / "pi_gains.py")


def test_a_loop_that_is_an_integrator_with_dead_time_has_the_margins_of_the_textbook(example):
    w = np.geomspace(1.0, 1e5, 20_000)
    phase, gain = example.margins(1000.0 / (1j * w) * np.exp(-1j * w * 2e-4), w)
    assert phase == pytest.approx(90 - np.degrees(1000 * 2e-4), abs=0.1)
    assert gain == pytest.approx(20 * np.log10(np.pi / 2 / (1000 * 2e-4)), abs=0.02)
    assert example.margins(1 / (1 + 1j * w), w)[1] == np.inf


def test_the_current_loop_crosses_where_it_was_designed_to_and_the_speed_loop_too(example):
    motor = np.array([2.0, 0.05, 0.004, 2e-4, 1e-5])
    gains = example.gains(motor)
    w = np.geomspace(1.0, 1e4, 20_000)
    current, speed = example.loops(motor, gains, w)
    crossing = [w[np.flatnonzero(np.abs(loop) >= 1)[-1]] for loop in (current, speed)]
    assert crossing == pytest.approx([example.CURRENT_BANDWIDTH, example.SPEED_BANDWIDTH], rel=0.05)


def test_the_possible_motors_lie_on_the_ellipsoid_of_the_estimate(example):
    from made_estimates import MOTOR, estimate

    from estimator.results.shown_result import Result

    result = Result.of(estimate())
    motors = example.possible_motors(result, np.random.default_rng(2))
    offsets = np.log(motors / np.array(list(MOTOR.values()))) / 1e-3
    distance = np.einsum("ij,ij->i", offsets @ np.linalg.inv(result.correlation), offsets)
    np.testing.assert_allclose(distance, 11.07, rtol=1e-6)


def test_the_example_runs(example, capsys):
    example.main(str(EXAMPLE))
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("verdict ok; R 3.1") and len(lines) == 6
    tutorial = (ROOT / "docs" / "tutorial.md").read_text()
    assert lines[1] in tutorial and lines[4] in tutorial


def test_the_glossary_has_twenty_words_each_where_it_is_said_to_be():
    page = (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| ([a-z][^|]*) \|[^|]*\| [^|]+ \| ([^|]+) \|$", page, re.M)[1:]
    assert len(rows) == 20
    for word, where in rows:
        files = re.findall(r"`([\w/.]+)`", where)
        assert files or "](" in where, word
        assert all((ROOT / "estimator" / name).exists() for name in files), word


def test_the_version_has_its_release_notes():
    version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    notes = (ROOT / "docs" / "releases.md").read_text(encoding="utf-8")
    assert re.findall(r"^## Release (\S+)$", notes, re.M)[0] == version


def test_contributing_sets_up_by_one_command_that_runs_what_there_is():
    page = (ROOT / "docs" / "contributing.md").read_text(encoding="utf-8")
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    (command,) = [line for line in page.splitlines() if line.startswith("python3 -m venv")]
    extras = re.search(r"\.\[([\w,]+)\]", command)[1].split(",")
    assert set(extras) <= set(project["project"]["optional-dependencies"])
    hooks = (ROOT / ".pre-commit-config.yaml").read_text()
    assert all(f"- id: {name}" in hooks for name in ("ruff", "ruff-format", "mypy"))


def test_no_heading_begins_with_a_digit_whose_anchor_the_sites_script_could_not_find():
    for path in (ROOT / "docs").rglob("*.md"):
        text = re.sub(r"```.*?```", "", path.read_text(), flags=re.S)
        assert not re.findall(r"^#+ [^A-Za-z`<]+.*$", text, re.M), path

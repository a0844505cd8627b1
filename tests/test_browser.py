"""The report in a browser: nothing on the console, nothing fetched, the first screen, a phone, print, read-out."""

import dataclasses
import html
import json
import re
import shutil
import subprocess

import numpy as np
import pytest
from made_estimates import comparison, estimate, profiles, with_parameter

from estimator.results.export import result_files
from estimator.results.result import Rival, RivalParameter, Validation

BROWSER = next(
    (path for name in ("chromium", "chromium-browser", "google-chrome") if (path := shutil.which(name))), None
)
PROBE = """<script>addEventListener("load", () => {
  const chart = document.querySelector("svg.chart"), box = chart.getBoundingClientRect();
  chart.dispatchEvent(new PointerEvent("pointermove",
    { clientX: box.left + box.width * 0.6, clientY: box.top + 50, bubbles: true }));
  document.title = JSON.stringify({
    charts: [...document.querySelectorAll("main svg")].filter(s => s.checkVisibility())
      .map(s => s.getBoundingClientRect().width),
    fetched: performance.getEntriesByType("resource").map(e => e.name).filter(n => !n.startsWith("data:")),
    wide: document.documentElement.scrollWidth > document.documentElement.clientWidth,
    cut: [...document.querySelectorAll(".wide")]
      .filter(e => e.checkVisibility() && e.scrollWidth > e.clientWidth + 1).map(e => e.innerText),
    clipped: [...document.querySelectorAll("table")]
      .filter(t => t.checkVisibility() && t.scrollWidth > t.parentElement.clientWidth).length,
    parameters: document.querySelector(".parameters").getBoundingClientRect().bottom,
    transient: document.querySelector(".transient svg.chart").getBoundingClientRect().bottom,
    read: document.querySelector(".transient .readout").textContent,
    first: document.querySelector("main > :first-child").innerText }) })</script>"""


def opened(page, folder, *, width, height=900):
    """Return what the probe says of a page in a window, and the browser's log."""
    path = folder / f"report{width}.html"
    path.write_text(page.replace("</body>", PROBE + "</body>"))
    if width < 500:  # a window of chromium is no narrower; a frame is
        outer = folder / "outer.html"
        outer.write_text(
            f"<!DOCTYPE html><iframe src='{path.name}' width={width} height={height}></iframe><script>setInterval(() =>"
            " { document.title = document.querySelector('iframe').contentDocument.title }, 50)</script>"
        )
        path = outer
    command = [BROWSER, "--headless", "--no-sandbox", "--disable-gpu", "--enable-logging=stderr"]
    command += ["--allow-file-access-from-files", "--virtual-time-budget=5000", "--dump-dom"]
    command += [f"--window-size={max(width, 500)},{height}", f"--user-data-dir={folder / 'profile'}"]
    command += ["--host-resolver-rules=MAP * ~NOTFOUND"]
    done = subprocess.run([*command, path.as_uri()], capture_output=True, text=True, timeout=120)
    title = re.search("<title>(.*?)</title>", done.stdout, re.S)
    assert title is not None and title[1].startswith("{"), done.stderr[-2000:]
    return json.loads(html.unescape(title[1])), done.stderr


@pytest.fixture(scope="module")
def page():
    made = with_parameter(estimate(verdict="doubtful", reasons=("L: it is <weak>",)), "R", nominal=3.2)
    seen = Validation((comparison(np.full(300, 6.0), name="another"),), {"i": 0.02, "w": 1.0}, {"i": 95.0, "w": 99.0})
    other = {name: RivalParameter(1.06 * p.value, 0.01 * p.value, p.unit) for name, p in made.parameters.items()}
    rival = Rival("sag instead of a voltage dip", other, "R", 3.1363, 4.2, 3.5, 0.15, "record two voltage levels")
    made = dataclasses.replace(made, profiles=profiles(), validation=seen, rivals=(rival,))
    return result_files(made, command="fmu-estimator estimate step.csv -o out")["report.html"].decode()


@pytest.fixture(scope="module")
def wide(page, tmp_path_factory):
    """Return what the probe says of the page in a wide window, and the browser's log."""
    return opened(page, tmp_path_factory.mktemp("wide"), width=1400)


@pytest.mark.skipif(BROWSER is None, reason="no chromium here: apt-get install chromium")
def test_the_report_opens_without_an_error_with_all_charts_and_nothing_from_the_network(page, wide):
    assert not re.search("https?:", page)
    told, log = wide
    assert "CONSOLE" not in log
    charts = [width for width in told["charts"] if width > 300]
    assert len(charts) == 3 + 4, "transient, whole recording, validation; two of the residuals of each output"
    assert told["fetched"] == [] and not told["wide"] and told["clipped"] == 0
    assert (
        told["first"].startswith("Doubtful. An estimate with known weaknesses") and "L: it is <weak>" in told["first"]
    )
    assert max(told["parameters"], told["transient"]) < 900, "all of it on the first screen"


@pytest.mark.skipif(BROWSER is None, reason="no chromium here: apt-get install chromium")
def test_the_report_fits_a_phone(page, tmp_path):
    told, log = opened(page, tmp_path, width=400)
    assert "CONSOLE" not in log and not told["wide"] and told["fetched"] == []
    assert told["cut"] == [], "nothing that is open is to be scrolled sideways, neither tables nor charts"
    assert len([width for width in told["charts"] if width > 300]) == 3 + 4


@pytest.mark.skipif(BROWSER is None, reason="no chromium here: apt-get install chromium")
def test_pointing_at_a_chart_reads_the_values_there(wide):
    told, _ = wide
    made = comparison()
    time = float(re.search(r"t = ([\d.]+) s", told["read"])[1])
    k = round(time * 1000)
    for name, what in (("i", "current i"), ("w", "speed w")):
        measured = float(re.search(rf"{what}, measured: ([-\d.]+)", told["read"])[1])
        simulated = float(re.search(rf"{what}, simulated: ([-\d.]+)", told["read"])[1])
        near = slice(k - 1, k + 2)
        room = 0.002 * np.ptp(made.measured[name])  # the lines are drawn to a tenth of a pixel
        assert made.measured[name][near].min() - room <= measured <= made.measured[name][near].max() + room
        assert made.simulated[name][near].min() - room <= simulated <= made.simulated[name][near].max() + room


@pytest.mark.skipif(BROWSER is None, reason="no chromium here: apt-get install chromium")
def test_the_report_prints_on_two_pages(tmp_path):
    made = estimate(verdict="doubtful", reasons=("a reason " * 20,) * 4, notes=("a note " * 25,) * 8)
    (tmp_path / "report.html").write_bytes(result_files(made)["report.html"])
    command = [BROWSER, "--headless", "--no-sandbox", "--disable-gpu", "--no-pdf-header-footer"]
    command += [f"--user-data-dir={tmp_path / 'profile'}", f"--print-to-pdf={tmp_path / 'report.pdf'}"]
    subprocess.run([*command, (tmp_path / "report.html").as_uri()], capture_output=True, timeout=120, check=True)
    assert len(re.findall(rb"/Type\s*/Page\b", (tmp_path / "report.pdf").read_bytes())) == 2

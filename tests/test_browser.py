"""The report in a browser: nothing on the console, every picture loaded, nothing fetched."""

import dataclasses
import html
import json
import re
import shutil
import subprocess

import numpy as np
import pytest
from made_estimates import comparison, estimate, with_parameter
from test_summary_plots import profiles

from estimator.results.export import result_files
from estimator.results.result import Validation

BROWSER = next(
    (path for name in ("chromium", "chromium-browser", "google-chrome") if (path := shutil.which(name))), None
)
PROBE = """<script>addEventListener("load", () => { document.title = JSON.stringify({
  pictures: [...document.images].map(i => [i.complete, i.naturalWidth, i.naturalHeight]),
  fetched: performance.getEntriesByType("resource").map(e => e.name).filter(n => !n.startsWith("data:")),
  wide: document.documentElement.scrollWidth > document.documentElement.clientWidth,
  clipped: [...document.querySelectorAll("table")].filter(t => t.scrollWidth > t.parentElement.clientWidth).length,
  first: document.querySelector("body > :nth-child(2)").innerText }) })</script>"""


@pytest.mark.skipif(BROWSER is None, reason="no chromium here: apt-get install chromium")
def test_the_report_opens_without_an_error_with_all_pictures_and_nothing_from_the_network(tmp_path):
    made = with_parameter(estimate(verdict="doubtful", reasons=("L: it is <weak>",)), "R", nominal=3.2)
    seen = Validation((comparison(np.full(300, 6.0), name="another"),), {"i": 0.02, "w": 1.0}, {"i": 95.0, "w": 99.0})
    made = dataclasses.replace(made, profiles=profiles(), validation=seen)
    page = result_files(made, command="fmu-estimator estimate step.csv -o out")["report.html"].decode()
    assert not re.search("https?:", page)
    (tmp_path / "report.html").write_text(page.replace("</body>", PROBE + "</body>"))
    command = [
        BROWSER,
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        "--enable-logging=stderr",
        "--window-size=1200,900",
    ]
    command += [f"--user-data-dir={tmp_path / 'profile'}", "--host-resolver-rules=MAP * ~NOTFOUND", "--dump-dom"]
    done = subprocess.run([*command, (tmp_path / "report.html").as_uri()], capture_output=True, text=True, timeout=120)
    assert "CONSOLE" not in done.stderr
    title = re.search("<title>(.*?)</title>", done.stdout, re.S)
    assert title is not None, done.stderr[-2000:]
    told = json.loads(html.unescape(title[1]))
    assert len(told["pictures"]) == 5 and all(complete and w > 300 and h > 100 for complete, w, h in told["pictures"])
    assert told["fetched"] == [] and not told["wide"] and told["clipped"] == 0
    assert (
        told["first"].startswith("Doubtful. An estimate with known weaknesses") and "L: it is <weak>" in told["first"]
    )

"""The app in a real browser: what a person does with it, with the mouse and without, and what goes wrong."""

import base64
import itertools
import json
import os
import re
import shutil
import time

import numpy as np
import psutil
import pytest
from app_server import EXAMPLE, serving
from faulty import faulty_fmu

from estimator.cases.case import read_case
from estimator.estimating.estimate import estimate

pytest.importorskip("starlette", reason="the extra app is not installed")
webdriver = pytest.importorskip("selenium.webdriver", reason="selenium is not installed")
from selenium.common.exceptions import WebDriverException  # noqa: E402
from selenium.webdriver.chrome.service import Service  # noqa: E402
from selenium.webdriver.common.action_chains import ActionChains  # noqa: E402
from selenium.webdriver.common.by import By  # noqa: E402
from selenium.webdriver.common.keys import Keys  # noqa: E402

BROWSER = next((p for name in ("chromium", "chromium-browser", "google-chrome") if (p := shutil.which(name))), None)
DRIVER = shutil.which("chromedriver")
pytestmark = pytest.mark.skipif(
    not BROWSER or not DRIVER, reason="no browser here: apt-get install chromium chromium-driver"
)
SWITCHES = (
    "--headless=new --no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking"
    " --disable-component-update --disable-sync"
)
LONG = 120  # s: the machine may be busy
EXPECTED = ("status of 400", "status of 409")  # the browser writes refusals to its console too
PAGES = ("data", "model", "run", "results")
COUNTED = """const asked = window.fetch; window.pending = 0;
    window.fetch = (...of) => {
      if (String(of[0]).includes("/api/revision")) return asked(...of);
      window.pending++;
      return asked(...of).finally(() => setTimeout(() => window.pending--, 0));
    };"""


class Page:
    """A tab of the browser that shows the app."""

    def __init__(self, driver, address):
        self.driver, self.address = driver, address
        self.size(1280, 900)
        self.go("data")

    def go(self, step):
        self.driver.get(f"{self.address}#{step}")
        self.until(lambda: self.js("return document.querySelector('nav a[aria-current]')?.id") == f"step-{step}")
        self.quiet()

    def quiet(self):
        """Wait until the page has asked for all that it needs, got it and drawn it."""
        drawn = """const done = arguments[0], seen = [];
            const look = () => requestAnimationFrame(() => setTimeout(() => {
              seen.push(window.pending ?? 0);
              if (seen.length < 3) look(); else done(seen);
            }, 0));
            look();"""
        self.until(lambda: self.driver.execute_async_script(drawn) == [0, 0, 0])

    def take_off(self):
        """Take the only recording off the list."""
        self.press("remove-0")
        self.until(lambda: not self.driver.find_elements(By.ID, "choose-0"))

    def shown(self, title):
        """Wait until a recording is the one that is shown."""
        self.until(lambda: self.js("return document.querySelector('section.wide h2')?.innerText") == title)
        self.quiet()

    def size(self, width, height, *, dark=False):
        metrics = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        self.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": [scheme]})

    def js(self, script, *arguments):
        return self.driver.execute_script(script, *arguments)

    def until(self, condition, *, limit=LONG):
        """Wait until something is so, and return it; what is not there yet, or drawn anew, is tried again."""
        end, last, pause = time.monotonic() + limit, "", 0.01
        while time.monotonic() < end:
            try:
                if found := condition():
                    return found
            except WebDriverException as error:
                last = f", the driver {error.msg}"
            time.sleep(pause)
            pause = min(1.5 * pause, 0.2)  # what takes long, as an estimate does, is not slowed by being asked for
        raise AssertionError(f"not within {limit} s{last}; the page says: {self.text[:1500]}")

    @property
    def text(self):
        return self.js("return document.body.innerText")

    def says(self, text):
        return self.until(lambda: text in self.text)

    def find(self, name):
        return self.until(lambda: self.driver.find_element(By.ID, name))

    def press(self, name):
        self.until(lambda: self.driver.find_element(By.ID, name).is_enabled())
        self.until(lambda: self._pressed(name))

    def _pressed(self, name):
        """Scroll to a button and press it: what is drawn above it meanwhile moves it, even below the bar."""
        self.js("document.getElementById(arguments[0])?.scrollIntoView({ block: 'center' })", name)
        self.driver.find_element(By.ID, name).click()
        return True

    def type(self, name, text):
        """Type into a field as a person does, and leave it."""

        def typed():
            self.find(name).send_keys(Keys.CONTROL, "a")
            self.find(name).send_keys(text, Keys.TAB)
            return True

        self.until(typed)

    def value(self, name, attribute="value"):
        """Return an attribute of a field, or None where it has none."""
        return self.js("return document.getElementById(arguments[0])[arguments[1]]", name, attribute)

    def choose(self, name, value):
        """Choose from a list, which may be drawn anew meanwhile, once the change before is known everywhere."""
        self.quiet()
        self.until(lambda: [self.find(name).find_element(By.CSS_SELECTOR, f"option[value='{value}']").click()])

    def drop(self, name, content):
        """Drop a file on the page."""
        self.js(
            """const bytes = Uint8Array.from(atob(arguments[1]), (c) => c.charCodeAt(0));
            const data = new DataTransfer();
            data.items.add(new File([bytes], arguments[0]));
            const how = { dataTransfer: data, bubbles: true, cancelable: true };
            document.body.dispatchEvent(new DragEvent("drop", how));""",
            name,
            base64.b64encode(content).decode(),
        )

    def console(self):
        """Return what is on the console, but for refusals."""
        return [e["message"] for e in self.driver.get_log("browser") if not any(x in e["message"] for x in EXPECTED)]


@pytest.fixture(scope="module")
def driver(tmp_path_factory):
    options = webdriver.ChromeOptions()
    options.binary_location = BROWSER
    profile = tmp_path_factory.mktemp("profile")
    downloads = tmp_path_factory.mktemp("downloads")
    for switch in [*SWITCHES.split(), f"--user-data-dir={profile}"]:
        options.add_argument(switch)
    options.add_experimental_option("prefs", {"download.default_directory": str(downloads)})
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    driver = webdriver.Chrome(options=options, service=Service(DRIVER))
    driver.set_script_timeout(LONG)
    driver.execute_cdp_cmd("Page.addScriptToEvaluateOnNewDocument", {"source": COUNTED})
    driver.downloads = downloads
    yield driver
    driver.quit()


@pytest.fixture
def folder(tmp_path):
    folder = tmp_path / "bench"
    folder.mkdir()
    shutil.copy(EXAMPLE, folder / "step.csv")
    return folder


@pytest.fixture
def started_runs():
    """Let the app start its runs anew, where their processes are looked for."""


@pytest.fixture
def server(folder, request):
    with serving(folder, anew="started_runs" in request.fixturenames) as server:
        yield server


@pytest.fixture(scope="module")
def estimated(tmp_path_factory):
    """Return the folder of an estimate of the example, with its signals."""
    from estimator.cli import main

    made = tmp_path_factory.mktemp("made") / "monday"
    assert main(["estimate", str(EXAMPLE), "-o", str(made), "--quiet", "--json", "--signals"]) == 0
    return made


@pytest.fixture
def page(driver, server):
    page = Page(driver, server.address)
    yield page
    said = page.console()
    for handle in driver.window_handles[1:]:
        driver.switch_to.window(handle)
        driver.close()
    driver.switch_to.window(driver.window_handles[0])
    driver.get("about:blank")
    driver.get_log("browser")
    assert said == []


def renamed(columns, *, comma=False, unit=1.0):
    """Return the example's recording with other names, and decimal commas if asked for."""
    lines = EXAMPLE.read_text().splitlines()
    rows = [line.split(",") for line in lines if line and line[0].isdigit()]
    for row in rows:
        row[3] = repr(float(row[3]) * unit)
    separator = ";" if comma else ","
    cells = [[cell.replace(".", ",") if comma else cell for cell in row] for row in rows]
    return "\n".join([separator.join(columns), *(separator.join(row) for row in cells)]).encode() + b"\n"


def test_a_dropped_file_is_assigned_estimated_and_reported(page, folder, driver):
    content = renamed(["t [s]", "channel 1 [V]", "channel 2 [A]", "channel 3 [rpm]"], comma=True, unit=30 / np.pi)
    page.take_off()
    page.drop("bench 7.csv", content)
    page.shown("bench 7.csv")
    page.says("2\u202f801 samples")
    assert (folder / "bench 7.csv").read_bytes() == content
    page.choose("target-0", "inputs v")
    page.choose("target-1", "outputs i")
    page.choose("target-2", "outputs w")
    page.until(lambda: '"channel 3 [rpm]"' in (folder / "app.case.toml").read_text())
    page.until(lambda: not driver.find_elements(By.ID, "problem"))
    page.go("run")
    page.press("start")
    page.until(lambda: driver.find_elements(By.ID, "to-result"))
    page.press("to-result")
    page.says("run-1: ok")
    value = page.js(
        """return [...document.querySelectorAll("tbody tr")].map((r) => r.innerText.split("\\t").slice(0, 2))"""
    )
    estimates = {row[0]: float(row[1]) for row in value[:5]}
    assert estimates == pytest.approx({"R": 3.14, "K": 0.0488, "L": 0.0132, "J": 9.0e-6, "B": 1.69e-4}, rel=0.02)
    report = driver.find_element(By.LINK_TEXT, "Open the report").get_attribute("href")
    driver.get(report)
    folded = page.js("return document.body.textContent")  # what is folded away is there too
    assert "estimate run-1.case.toml -o run-1 --signals" in folded


@pytest.mark.full
def test_a_result_can_be_exported_and_the_command_is_shown(page, driver, folder, estimated):
    shutil.copytree(estimated, folder / "monday")
    page.go("results")
    page.says("monday: ok")
    page.press("export-4")
    page.until(lambda: list(driver.downloads.glob("motor_parameters*.m")))
    assert "fmu-estimator export monday --format matlab" in page.text
    page.js("document.getElementById('ripple').open = true")
    page.until(lambda: len(page.js("return document.querySelectorAll('canvas')[1].plot.panels")) == 2)


def test_a_wrong_file_is_told_in_a_sentence_and_changes_nothing(page, folder):
    before = (folder / "app.case.toml").read_bytes()
    for name, content, sentence in (
        ("notes.csv", b"dear diary\nnothing\n", "notes.csv"),
        ("short.csv", b"time [s],voltage [V]\n0,1\n1,2\n", "short.csv has 2 samples"),
        ("motor.fmu", b"PK no archive", "motor.fmu"),
        ("virus.exe", b"MZ", "virus.exe is no recording"),
        ("bad.case.toml", b"[fmu\n", "bad.case.toml line 1"),
    ):
        page.drop(name, content)
        page.says(sentence)
        assert (folder / "app.case.toml").read_bytes() == before and "step.csv" in page.text


@pytest.mark.full
def test_two_tabs_show_one_case_and_an_outdated_change_is_refused(page, driver, server, folder):
    first = driver.current_window_handle
    driver.switch_to.new_window("tab")
    second = Page(driver, server.address)
    second.says("step.csv")
    driver.switch_to.window(first)
    page.press("sign-1")
    page.until(lambda: "scale" in (folder / "app.case.toml").read_text())
    driver.switch_to.window(driver.window_handles[1])
    second.until(lambda: second.value("sign-1", "ariaPressed") == "true")
    assert server.post("change", {"revision": 0, "changes": {"mapping": None}})["status"] == 409
    assert second.console() == []
    driver.close()
    driver.switch_to.window(first)


def choose_fmu(page, folder, name):
    """Choose an FMU by its name."""
    page.go("model")
    radio = """return [...document.querySelectorAll("input[name=fmu]")]
        .find((radio) => radio.parentElement.innerText.includes(arguments[0]))?.id"""
    page.press(page.until(lambda: page.js(radio, name)))
    page.until(lambda: f'path = "{name}"' in (folder / "app.case.toml").read_text())


SLOW = '[fmu]\npath = "slow.fmu"\n[search]\nmethod = "paper"\n[[recording]]\nfile = "step.csv"\n'


@pytest.fixture(scope="module")
def slow_fmu(tmp_path_factory):
    """Return an FMU by which the search of the paper, of 80 000 simulations, takes a minute: it sleeps."""
    return faulty_fmu(tmp_path_factory.mktemp("slow"), EnterInitializationMode="usleep(1000);")


def slow(page, server, folder, fmu):
    """Open a case whose FMU and method take their time, and start it."""
    shutil.copy(fmu, folder / "slow.fmu")
    (folder / "slow.case.toml").write_text(SLOW)
    assert "error" not in server.post("open", {"name": "slow.case.toml"})
    page.go("run")
    page.until(lambda: page.js("return document.querySelector('#casefile pre').textContent").count('method = "paper"'))
    page.press("start")
    page.until(lambda: page.driver.find_elements(By.ID, "best"))


def test_a_reload_in_the_middle_of_a_run_goes_on_with_it_and_it_can_be_stopped_and_kept(
    page, driver, server, folder, slow_fmu
):
    slow(page, server, folder, slow_fmu)
    driver.refresh()
    page.until(lambda: driver.find_elements(By.ID, "best"))
    assert "run-1 is running" in page.text
    page.press("stop")
    page.press("keep")
    page.until(lambda: "start = " in (folder / "app.case.toml").read_text())
    page.find("start-R")
    start = page.until(lambda: page.value("start-R"))
    assert 0.5 < float(start) < 50


def children(server):
    """Return the processes of the estimate that is running: the program, then its workers."""
    below = psutil.Process(server.process.pid).children(recursive=True)
    (program,) = [p for p in below if any("--progress-json" in word for word in p.cmdline())]
    return program, program.children(recursive=True)


@pytest.mark.full
@pytest.mark.usefixtures("started_runs")
def test_a_killed_worker_costs_a_candidate_and_a_killed_program_costs_its_run(page, driver, server, folder, slow_fmu):
    slow(page, server, folder, slow_fmu)
    program, workers = children(server)
    simulations = page.js("return document.body.innerText").count("simulations")
    workers[0].kill()
    before = server.get("runs/run-1")["progress"]["simulations"]
    page.until(lambda: server.get("runs/run-1")["progress"]["simulations"] > before + 300)
    assert simulations and server.get("runs/run-1")["state"] == "running"
    program.kill()
    page.says("the process was killed (SIGKILL)")
    page.choose("method", "cuckoo")
    page.press("start")
    page.until(lambda: driver.find_elements(By.ID, "to-result"))
    page.says("run-2 is done: ok")


def long_recording(path, n):
    """Write a recording of 100 s with one sample that stands alone, and a gap of a part in 200."""
    pyarrow = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    rng = np.random.default_rng(1)
    t = np.arange(n) * (100 / n)
    v = np.where(t % 10 < 5, 10.0, -6.0)
    i = 0.5 * np.sign(v) + 0.01 * rng.standard_normal(n)
    i[612_345 * n // 1_000_000] = 42.0
    w = 20 * v + 0.3 * rng.standard_normal(n)
    w[n // 5 : n // 5 + n // 200] = np.nan
    columns = {"time [s]": t, "voltage [V]": v, "current [A]": i, "speed [rad/s]": w}
    parquet.write_table(pyarrow.table(columns), path)


@pytest.mark.full
@pytest.mark.parametrize("samples", [200_000, 1_000_000])
def test_many_samples_are_dragged_at_the_speed_of_the_screen_and_no_extreme_is_lost(page, driver, folder, samples):
    long_recording(folder / "long.parquet", samples)
    driver.refresh()
    page.press("add-0")
    page.says(f"{samples:,} samples".replace(",", "\u202f"))
    page.says("1 outlier")
    page.says(f"{samples // 200:,} missing in 1 gap".replace(",", "\u202f"))
    canvas = page.until(lambda: driver.find_element(By.CSS_SELECTOR, "canvas"))
    highest = """const p = arguments[0].plot, source = p.panels[1].lines[0].source;
        return Math.max(...source.data(...p.view).signals.current.high)"""
    page.until(lambda: page.js("return arguments[0].plot.panels.length === 3 && arguments[0].plot.end > 99", canvas))
    assert page.js(highest, canvas) == 42.0

    def dragged():
        page.js("arguments[0].plot.show(30, 70)", canvas)
        page.quiet()
        page.js("arguments[0].plot.frames.length = 0", canvas)
        drag = ActionChains(driver, duration=15).move_to_element_with_offset(canvas, 100, 0).click_and_hold()
        for _ in range(40):
            drag.move_by_offset(-8, 0)
        drag.release().perform()
        page.until(lambda: page.js("return arguments[0].plot.view[0]", canvas) > 40)
        return sorted(ms for _, ms in page.js("return arguments[0].plot.frames", canvas))

    def is_quick():  # the quickest: what others do on the machine only adds to it
        took = dragged()
        return len(took) >= 10 and took[0] < 1000 / 60

    page.until(is_quick)  # a machine that is busy draws fewer of the moves
    page.press("out-1")  # a jump to the outlier shows its samples one by one
    shown = "return arguments[0].plot.view[1] - arguments[0].plot.view[0]"
    page.until(lambda: page.js(shown, canvas) < 100 * 100 / samples)  # s of a hundred samples
    page.until(lambda: page.js("const p = arguments[0].plot; return !p.sources()[0].data(...p.view).envelope", canvas))
    assert page.js(highest, canvas) == 42.0


def test_everything_can_be_done_by_the_keyboard(page, driver, folder):
    shutil.copy(EXAMPLE, folder / "again.csv")
    driver.refresh()
    page.says("again.csv")
    keys = ActionChains(driver)

    def tab_to(name):
        page.until(lambda: page.find(name).is_enabled())
        page.quiet()
        page.js("document.getElementById('main').focus()")
        for _ in range(120):
            ActionChains(driver).send_keys(Keys.TAB).perform()
            if page.js("return document.activeElement.id") == name:
                return
        raise AssertionError(f"{name} is not reached by the keyboard")

    tab_to("add-0")
    keys.send_keys(Keys.ENTER).perform()
    page.until(lambda: '"again.csv"' in (folder / "app.case.toml").read_text())
    tab_to("role-1-fit")
    ActionChains(driver).send_keys(Keys.ARROW_RIGHT).perform()
    page.until(lambda: "validate = true" in (folder / "app.case.toml").read_text())
    page.until(lambda: page.js("return document.activeElement.id") == "role-1-validate")
    tab_to("choose-0")
    ActionChains(driver).send_keys(Keys.ENTER).perform()
    page.shown("step.csv")
    edge = page.until(lambda: driver.find_elements(By.CSS_SELECTOR, ".edge:not([hidden])"))[0]
    page.js("arguments[0].focus()", edge)
    again = "arguments[0].dispatchEvent(new KeyboardEvent('keydown', { key: 'ArrowRight', bubbles: true }));"
    page.js(f"{again} dispatchEvent(new Event('hashchange')); {again}", edge)  # the page is drawn anew in between
    page.until(lambda: "window = [0.056, 2.8]" in (folder / "app.case.toml").read_text())
    canvas = driver.find_element(By.CSS_SELECTOR, "canvas")
    page.js("arguments[0].focus()", canvas)
    page.js("dispatchEvent(new Event('hashchange'))")  # what is drawn anew leaves the focus where it is
    page.quiet()
    assert page.js("return document.activeElement === arguments[0]", canvas)
    ActionChains(driver).send_keys("+").key_down(Keys.SHIFT).send_keys(Keys.ARROW_RIGHT).key_up(Keys.SHIFT).perform()
    page.until(lambda: "current" in driver.find_element(By.CSS_SELECTOR, "output.readout").text)
    ActionChains(driver).key_down(Keys.ALT).send_keys("3").key_up(Keys.ALT).perform()
    tab_to("start")
    ActionChains(driver).send_keys(Keys.ENTER).perform()
    page.until(lambda: driver.find_elements(By.ID, "to-result"))
    tab_to("to-result")
    ActionChains(driver).send_keys(Keys.ENTER).perform()
    page.says("run-1: ok")
    page.says("RMSE on the validation")


@pytest.mark.full
def test_the_window_is_dragged_and_becomes_part_of_the_case(page, driver, folder):
    page.shown("step.csv")
    edge = page.until(lambda: driver.find_elements(By.CSS_SELECTOR, ".edge:not([hidden])"))[1]
    ActionChains(driver).drag_and_drop_by_offset(edge, -300, 0).perform()
    page.until(lambda: "window = [0.0, 1.7" in (folder / "app.case.toml").read_text())
    page.until(lambda: page.value("to") not in ("", "2.8"))
    assert float(page.value("to")) == pytest.approx(1.79, abs=0.1)
    page.press("window-all")
    page.until(lambda: "window" not in (folder / "app.case.toml").read_text())


@pytest.mark.full  # that an edge is dragged: above
def test_a_drag_of_an_edge_goes_on_while_the_page_is_drawn_anew(page, driver, folder):
    page.shown("step.csv")
    edge = page.until(lambda: driver.find_elements(By.CSS_SELECTOR, ".edge:not([hidden])"))[1]
    again = "addEventListener('pointermove', () => dispatchEvent(new Event('hashchange')), { capture: true })"
    page.js(again)  # anew at every move
    drag = ActionChains(driver).move_to_element(edge).click_and_hold()
    drag.move_by_offset(-100, 0).pause(0.3).move_by_offset(-200, 0).release().perform()
    page.until(lambda: "window = [0.0, 1.7" in (folder / "app.case.toml").read_text())


def test_numbers_are_read_in_german_and_in_english(page):
    meant = {
        "3.14": 3.14, "3,14": 3.14, "1.234,5": 1234.5, "1,234.5": 1234.5, "1 234,5": 1234.5, "-0,5e-3": -5e-4,
        "1.234.567": 1234567.0, "−2": -2.0, "": None,
    } | dict.fromkeys(("1,2,3", "x", "0x10", "1e999", "Infinity", "1.2,3.4", "12.34,5"), "NaN")  # fmt: skip
    script = """const done = arguments[1]; import(new URL("page/numbers.js", document.baseURI).href)
      .then(({ parse }) => { const v = parse(arguments[0]); done(Number.isNaN(v) ? "NaN" : v); });"""
    assert {typed: page.driver.execute_async_script(script, typed) for typed in meant} == meant


@pytest.mark.full
def test_a_german_bound_is_kept_and_nonsense_is_marked_where_it_stands(page, driver, folder):
    page.go("model")
    page.type("min-R", "0,5")
    page.until(lambda: "R = { min = 0.5" in (folder / "app.case.toml").read_text())
    page.until(lambda: page.value("min-R") == "0.5")
    page.type("max-R", "viel")
    page.until(lambda: page.value("max-R", "ariaInvalid") == "true" and page.value("max-R") == "viel")
    page.type("max-R", "0,1")
    page.says("min must be the smaller one")
    page.choose("is-L", "fixed")
    page.until(lambda: "[fixed]" in (folder / "app.case.toml").read_text())
    page.type("value-L", "13,1e-3")
    page.until(lambda: "L = 0.0131" in (folder / "app.case.toml").read_text())
    page.press("automatic")
    page.until(lambda: "[parameters]" not in (folder / "app.case.toml").read_text())


@pytest.mark.full
def test_a_slider_shows_what_another_start_looks_like(page, driver, folder):
    page.go("model")
    page.says("The start explains")
    before = page.js("return document.querySelector('[role=status].muted').textContent")
    page.find("try-R").send_keys(Keys.ARROW_RIGHT * 30)
    page.until(lambda: "start = " in (folder / "app.case.toml").read_text())
    page.until(lambda: "The start explains" in page.text and before not in page.text)


@pytest.mark.full
def test_a_bundled_model_is_inspected_its_parameters_are_offered_and_that_of_a_file_is_chosen(
    page, driver, folder, slow_fmu
):
    shutil.copy(slow_fmu, folder / "slow.fmu")
    driver.refresh()
    page.go("model")
    page.says("repeats itself")
    choose_fmu(page, folder, "dc_motor_friction")
    page.find("start-friction")
    choose_fmu(page, folder, "slow.fmu")


HOSTILE = "<img src=x onerror=window.hacked=1>"


def test_a_script_in_a_name_stays_a_text(page, driver, folder, server):
    header = ["time [s]", "voltage [V]", "current [A]", "speed [rad/s]"]
    header[3] = f"{HOSTILE} [rad/s]"
    (folder / f"{HOSTILE}.csv").write_bytes(renamed(header))
    (folder / f"{HOSTILE}.case.toml").write_text('[[recording]]\nfile = "step.csv"\n')
    result = folder / HOSTILE
    result.mkdir()
    told = {"verdict": "doubtful", "reasons": [HOSTILE], "notes": [HOSTILE]}
    told["parameters"] = {HOSTILE: {"value": 1.0, "standard_error": 0.1, "unit": HOSTILE, "status": HOSTILE}}
    told |= {"fmu": {"name": HOSTILE}, "rmse": {HOSTILE: 1.0}, "correlation": {HOSTILE: {HOSTILE: 1.0}, "b": {}}}
    (result / "result.json").write_text(json.dumps(told))
    driver.refresh()
    page.press("add-0")
    page.says(HOSTILE)
    page.until(lambda: driver.find_elements(By.ID, "target-2"))
    for step in PAGES:
        page.go(step)
        page.says(HOSTILE)
    assert page.js("return window.hacked") is None and not driver.find_elements(By.CSS_SELECTOR, "img[src=x]")


@pytest.mark.full
def test_a_result_folder_made_elsewhere_is_opened_and_runs_are_seen_side_by_side(page, driver, folder, estimated):
    from estimator.cli import main

    shutil.copytree(estimated, folder / "monday")
    other = ["-o", str(folder / "tuesday"), "--fix", "L=0.0131", "--signals", "--quiet", "--json"]
    assert main(["estimate", str(folder / "step.csv"), *other]) == 0
    (folder / "old").mkdir()
    for file in ("result.json", "figure.png"):
        shutil.copy(folder / "monday" / file, folder / "old")
    (folder / "broken").mkdir()
    (folder / "broken" / "result.json").write_text("{")
    page.go("results")
    page.says("monday")
    page.driver.get(f"{page.address}#results/old")
    page.says("estimate again with --signals")
    page.until(lambda: page.js("return document.querySelector('main img').naturalWidth") > 300)
    page.driver.get(f"{page.address}#results/broken")
    page.says("broken/result.json cannot be read")
    names = [e.text for e in driver.find_elements(By.CSS_SELECTOR, "[id^=result-]")]
    for name in ("monday", "tuesday"):
        page.press(f"beside-{names.index(name)}")
    page.says("Side by side")
    page.says("over the estimate of monday")
    page.until(lambda: len(page.js("return document.querySelector('canvas').plot.panels")) == 4)
    assert "fmu-estimator compare monday tuesday" in page.text
    page.says("std. errors")  # the table of the command compare


def test_a_click_on_a_files_name_adds_it(page, folder):
    shutil.copyfile(EXAMPLE, folder / "bench 1.csv")
    page.go("data")
    page.until(lambda: [page.driver.find_element(By.XPATH, "//button[text()='bench 1.csv']").click()])
    page.shown("bench 1.csv")


@pytest.mark.full
def test_the_button_of_a_file_with_a_long_name_stands_beside_it(page, folder):
    (folder / "TimeConstant_Test_2023-12-13_130935.csv").write_bytes(EXAMPLE.read_bytes())
    page.go("data")
    page.until(lambda: page.driver.find_elements(By.ID, "add-0"))
    where = (
        "return [...document.querySelectorAll('.list.plain .row > *')].map((e) => e.getBoundingClientRect().toJSON())"
    )
    boxes = [b for b in page.js(where) if b["height"]]
    tops, bottoms = [b["top"] for b in boxes[-2:]], [b["bottom"] for b in boxes[-2:]]
    assert max(tops) < min(bottoms), boxes


SIDEWAYS = """return [...document.querySelectorAll(".scroll")].filter((e) => e.scrollWidth > e.clientWidth + 1)
    .map((e) => e.getAttribute("aria-label"))"""


def test_on_a_phone_values_bars_and_rivals_are_seen_without_scrolling_sideways(page, driver, folder):
    told = {"verdict": "doubtful", "reasons": ["it may sag"], "rmse": {"i": 0.1, "w": 1.0}, "noise": {"i": 0.1}}
    told |= {"meaning": "An estimate with known weaknesses.", "sample_noise": {"i": 0.0234, "w": 0.5}}
    values = {"R": 3.0, "K": 0.05, "J": 9.1e-6}
    told["parameters"] = {n: {"value": x, "standard_error": 0.01 * x, "unit": "Ohm", "status": "ok", "free": True,
                              "reason": "it may sag"} for n, x in values.items()}  # fmt: skip
    other = {n: {"value": 1.06 * x, "standard_error": 0.002 * x, "unit": "Ohm"} for n, x in values.items()}
    told["rivals"] = [{"what": "sag instead of voltage dip", "parameters": other, "differs_in": "K", "weight": 0.15,
                       "delta_criterion": 3.0, "decided_by": "record two voltage levels"}]  # fmt: skip
    for name in ("one", "two"):
        (folder / name).mkdir()
        (folder / name / "result.json").write_text(json.dumps(told))
    page.size(400, 900)
    page.go("results")
    page.says("Rivals, and what they differ in")
    assert (
        "To decide: record two voltage levels." in page.text and "K" in page.text and "0.05300 ± 0.00010" in page.text
    )
    assert "An estimate with known weaknesses." in page.text, "the sentence of the result itself"
    assert re.search(r"residual 0\.1\b.*noise 0\.0234", " ".join(page.text.split())), "as the report calls them"
    assert page.text.count("it may sag") == 1, "what the verdict says is not said again of each parameter"
    assert page.js(SIDEWAYS) == []
    bars = page.js("return [...document.querySelectorAll('#rivals tbody .bar')].map((b) => b.getBoundingClientRect())")
    assert len(bars) == 6 and all(b["left"] >= 0 and b["right"] <= 400 for b in bars)
    for k in (0, 1):
        page.press(f"beside-{k}")
    page.says("Side by side")
    assert page.js(SIDEWAYS) == []
    page.go("model")
    page.until(lambda: driver.find_elements(By.ID, "max-B"))
    assert page.js(SIDEWAYS) == []
    page.type("max-R", "50")
    page.until(lambda: "max = 50" in (folder / "app.case.toml").read_text())


@pytest.mark.full
def test_a_log_of_two_tests_with_a_duty_cycle_and_counts_is_read_as_the_page_says(page, driver, folder):
    rows = [line.split(",") for line in EXAMPLE.read_text().splitlines() if line[:1].isdigit()]
    t, v, i, w = np.array(rows, dtype=float).T
    counts = np.round(np.cumsum(w) * (t[1] - t[0]) / (2 * np.pi) * 4096).astype(int)
    lines = [f"{k},{a},{b / 0.12},{c},{d}" for k in (1, 2) for a, b, c, d in zip(t, v, i, counts, strict=True)]
    content = "\n".join(["test,t [s],duty [%],current [A],encoder [counts]", *lines]).encode()
    page.take_off()
    page.drop("log.csv", content)
    page.until(lambda: driver.find_elements(By.ID, "problem"))
    page.js("document.getElementById('reading').open = true")
    page.type("reading-supply", "12")
    page.until(lambda: 'supply = "12"' in (folder / "app.case.toml").read_text())
    page.type("reading-counts", "4096")
    page.until(lambda: "counts = 4096" in (folder / "app.case.toml").read_text())
    page.until(lambda: not driver.find_elements(By.ID, "problem"))
    page.choose("part", "1")
    page.says("log.csv 2")
    page.choose("test", "2")
    page.until(lambda: 'test = "2"' in (folder / "app.case.toml").read_text())
    page.says("fmu-estimator check log.csv --test=2 --supply=12 --counts=4096")
    page.go("model")
    page.until(lambda: page.js("return document.querySelector('canvas').plot.panels.length") >= 3)


def bare(*columns, header=""):
    """Return columns of the example's recording, 0 being the time, without a header."""
    rows = [line.split(",") for line in EXAMPLE.read_text().splitlines() if line[:1].isdigit()]
    return "\n".join([*([header] if header else []), *(",".join(row[k] for k in columns) for row in rows)]).encode()


@pytest.mark.full
def test_a_file_without_header_and_time_is_read_as_the_page_is_told(page, driver, folder):
    page.take_off()
    page.drop("bare.csv", bare(3, 1, 2))
    page.says("This file has no header: say what its columns are.")
    page.press("bare-read")
    page.says("Say of at least one column what it measures.")
    for k, signal in enumerate(("w", "v", "i")):
        page.choose(f"bare-{k}", signal)
    page.press("bare-read")
    page.says("Give the sampling interval in ms")
    page.type("bare-interval", "1,0")
    page.press("bare-read")
    page.says("2\u202f801 samples")
    page.says("fmu-estimator check bare.csv --column=w=1 --column=v=2 --column=i=3 --rate=1000")
    text = (folder / "app.case.toml").read_text()
    assert "rate = 1000" in text and 'columns = { w = "1", v = "2", i = "3" }' in text
    page.until(lambda: not driver.find_elements(By.ID, "problem"))
    page.type("unit-0", "rpm")  # a column without a header has a unit all the same
    page.says("--unit=w=rpm")
    page.type("unit-0", "rad/s")
    page.until(lambda: 'units = { w = "rad/s" }' in (folder / "app.case.toml").read_text())
    found = estimate(read_case(folder / "app.case.toml"))
    assert found.parameters["R"].value == pytest.approx(3.14, rel=0.02)
    page.js("document.getElementById('reading').open = true")
    page.press("bare-again")
    page.says("This file has no header")


@pytest.mark.full
def test_a_file_with_a_header_and_no_time_asks_for_its_interval_alone(page, driver, folder):
    page.take_off()
    page.drop("notime.csv", bare(1, 2, 3, header="voltage [V],current [A],speed [rad/s]"))
    page.says("This file has no time: say how far apart its samples are.")
    assert not driver.find_elements(By.ID, "bare-0")
    page.type("bare-interval", "1")
    page.press("bare-read")
    page.says("2\u202f801 samples")
    page.until(lambda: "rate = 1000" in (folder / "app.case.toml").read_text())
    page.until(lambda: not driver.find_elements(By.ID, "problem"))


@pytest.mark.full
def test_a_unit_of_a_header_is_overruled_with_a_warning_and_taken_back(page, driver, folder):
    page.type("unit-2", "rpm")
    page.says("speed [rad/s] is now read as rpm, against its header")
    page.says("its header says rad/s; it is read as rpm, as you said")
    page.says("fmu-estimator check step.csv --unit=speed=rpm")
    page.until(lambda: 'units = { speed = "rpm" }' in (folder / "app.case.toml").read_text())
    assert not driver.find_elements(By.ID, "problem")
    page.type("unit-2", "furlong")
    page.says("'furlong', given for 'speed', is not a known unit")
    page.until(lambda: page.value("unit-2") == "rpm")
    page.type("unit-2", Keys.BACKSPACE)
    page.until(lambda: "units" not in (folder / "app.case.toml").read_text())
    page.until(lambda: "its header says" not in page.text)
    page.js("document.getElementById('reading').open = true")
    page.type("reading-time", "ms")
    page.says("fmu-estimator check step.csv --unit=time=ms")
    page.says("0.0028 s")


def test_a_refused_result_shows_where_in_the_data_its_reason_lies(page, driver, folder):
    from estimator.cli import main

    (folder / "swapped.csv").write_bytes(renamed(["time [s]", "voltage [V]", "speed [rad/s]", "current [A]"]))
    out = ["-o", str(folder / "swapped"), "--quiet", "--json", "--signals"]
    assert main(["estimate", str(folder / "swapped.csv"), *out]) == 1
    page.go("results")
    page.says("swapped: refused")
    page.says("Where the reason lies")
    plot = "document.querySelector('canvas').plot"
    shades = page.until(lambda: page.js(f"return {plot}.shades"))
    assert [(s["panel"], s["color"]) for s in shades] == [("i", "--place"), ("w", "--place")]
    assert all(0.49 < s["from"] < 0.5 < s["to"] < 0.6 for s in shades)
    begin, end = page.js(f"return {plot}.view")
    assert begin < shades[0]["from"] and shades[0]["to"] < end < 1, "it is enlarged"
    page.js(f"{plot}.all()")
    page.press("where-0")
    page.until(lambda: page.js(f"return {plot}.view") == [begin, end])
    assert "simulated" not in page.text and "residual" not in page.text
    page.go("data")
    page.take_off()
    page.press(f"add-{[e.text for e in driver.find_elements(By.CSS_SELECTOR, '.plain .name')].index('swapped.csv')}")
    page.says("current and speed look exchanged")
    page.until(lambda: len([s for s in page.js(f"return {plot}.shades") if s["color"] == "--place"]) == 2)


def axe_script():
    axe = pytest.importorskip("axe_core_python", reason="axe-core-python is not installed")
    return (os.path.dirname(axe.__file__) or "") + "/axe.min.js"


@pytest.mark.parametrize(
    ("looks", "by_axe"),
    [
        pytest.param([(1280, False), (400, True)], 4, id="wide and light, narrow and dark"),
        pytest.param(
            [(1280, False), (400, True), (400, False), (1280, True)], 16, id="all four", marks=pytest.mark.full
        ),
    ],
)
def test_no_page_has_a_serious_finding_of_axe_or_is_wider_than_the_screen(page, driver, looks, by_axe):
    """By default axe sees each page in one of two looks, with `full` in all four pairs of width and colour."""
    with open(axe_script(), encoding="utf-8") as file:
        axe = file.read()
    page.go("run")
    page.press("start")
    page.until(lambda: driver.find_elements(By.ID, "to-result"))
    for k, ((width, dark), step) in enumerate(itertools.product(looks, PAGES)):
        page.size(width, 900, dark=dark)
        page.go(step)
        page.until(lambda: page.js("return document.querySelectorAll('main section').length > 1"))
        page.until(lambda: page.js("return [...document.querySelectorAll('canvas')].some((c) => c.plot.frames.length)"))
        page.quiet()
        assert page.js("return document.documentElement.scrollWidth <= document.documentElement.clientWidth"), (
            width,
            dark,
            step,
        )
        if by_axe == len(PAGES) and k % 2 != k // len(PAGES):
            continue  # the other look of this page
        driver.execute_cdp_cmd("Runtime.evaluate", {"expression": axe})
        found = driver.execute_async_script(
            """const runOnly = ["wcag2a", "wcag2aa", "wcag21aa", "best-practice"];
            axe.run(document, { runOnly }).then(arguments[0]);"""
        )
        serious = [
            (v["id"], [n["html"][:200] for n in v["nodes"]][:3])
            for v in found["violations"]
            if v["impact"] in ("serious", "critical")
        ]
        assert not serious, (width, dark, step, serious)


@pytest.mark.full
def test_the_colours_can_be_chosen_and_stay(page, driver):
    def back():
        return page.js("return getComputedStyle(document.body.parentElement).backgroundColor")

    light = back()
    page.press("theme")
    page.press("theme")
    dark = back()
    assert dark != light
    driver.refresh()
    page.says("step.csv")
    assert back() == dark
    page.press("theme")


@pytest.mark.full
def test_ctrl_c_ends_a_run_with_the_app(driver, folder, slow_fmu):
    with serving(folder, anew=True) as server:
        page = Page(driver, server.address)
        slow(page, server, folder, slow_fmu)
        program, workers = children(server)
    assert not any(p.is_running() and p.status() != psutil.STATUS_ZOMBIE for p in (program, *workers))
    driver.get("about:blank")
    driver.get_log("browser")

// The page's frame: which step is shown, the state that the server holds, and the same on the command line.

import { el, replace, say } from "./dom.js";
import { get, post, Refused } from "./api.js";
import { DataPage } from "./data.js";
import { ModelPage } from "./model.js";
import { RunPage } from "./run.js";
import { ResultsPage } from "./results.js";

const STEPS = [["data", "Data", DataPage], ["model", "Model", ModelPage], ["run", "Run", RunPage], ["results", "Results", ResultsPage]];
const WATCH = 1500; // ms, between two looks for what another tab or a run has changed

class App {
  constructor() {
    this.state = null;
    this.pages = {};
    this.queue = Promise.resolve();
    this.command = null; // the page's own, instead of the case's
  }

  async begin() {
    this.theme(localStorage.getItem("fmu-estimator theme") ?? "auto");
    addEventListener("hashchange", () => this.route());
    addEventListener("keydown", (e) => {
      if (!e.altKey || e.ctrlKey || e.metaKey) return;
      const step = STEPS[Number(e.key) - 1];
      if (step) { e.preventDefault(); location.hash = step[0]; }
    });
    for (const type of ["dragover", "drop"]) addEventListener(type, (e) => e.preventDefault());
    addEventListener("drop", (e) => { if (e.dataTransfer?.files.length) this.receive([...e.dataTransfer.files]); });
    await this.refresh();
    this.route();
    this.watch();
  }

  // Change parts of the case; changes go to the server one after the other. One that is a function is told the state
  // that the changes before it have made: what was drawn when it was asked for may be older.
  change(changes) {
    this.queue = this.queue.then(async () => {
      try {
        const made = typeof changes === "function" ? changes(this.state) : changes;
        this.take(await post("change", { revision: this.state.revision, changes: made }));
      } catch (error) {
        await this.refresh().catch(() => {});
        this.fail(error);
      }
    });
    return this.queue;
  }

  async refresh() { this.take(await get("state")); }

  take(state) {
    this.state = state;
    this.render();
  }

  fail(error) { say(error.message, "error"); if (!(error instanceof Refused)) throw error; }

  async receive(files) {
    let taken = 0;
    for (const file of files) {
      try {
        const { name } = await post("upload", file, { name: file.name });
        taken++;
        if (name.toLowerCase().endsWith(".fmu")) await this.change({ fmu: name });
        else if (name.toLowerCase().endsWith(".case.toml")) this.take(await post("open", { name }));
        else await this.add(name);
      } catch (error) { this.fail(error); }
    }
    await this.refresh().catch((error) => this.fail(error));
    if (taken && location.hash.slice(1) === "results") location.hash = "data";
  }

  // Take a recording into the list, after a look at it: one that cannot be read is told, and left out.
  async add(name) {
    if (this.state.recordings.some((r) => r.file === name)) { this.select(name); return; }
    let role = "fit";
    try {
      await get("recording", { name });
    } catch (error) {
      const { lacks } = await get("bare", { name }).catch(() => ({ lacks: [] }));
      if (!lacks.length) { this.fail(error); return; }
      role = "off"; // until the user has said what the file does not
    }
    await this.change((state) => ({ recordings: [...state.recordings, { file: name, role }] }));
    this.select(name);
  }

  select(name) { this.pages.data?.select(name); }

  async watch() {
    try {
      const { revision, runs, files } = await get("revision");
      const busy = this.state.runs.map((r) => `${r.name} ${r.state}`).join();
      const other = revision !== this.state.revision || files !== this.state.stamp;
      if (other || runs.map((r) => `${r.name} ${r.state}`).join() !== busy) await this.refresh();
      if (this.lost) { this.lost = false; say("The app answers again."); }
    } catch (error) {
      if (!this.lost) say(error.message, "error");
      this.lost = true;
    }
    setTimeout(() => this.watch(), WATCH);
  }

  route() {
    const [step, ...rest] = decodeURIComponent(location.hash.slice(1) || "data").split("/");
    const known = STEPS.find(([name]) => name === step) ?? STEPS[0];
    this.pages[known[0]] ??= new known[2](this);
    if (this.page && this.page !== this.pages[known[0]]) this.page.leave?.();
    this.page = this.pages[known[0]];
    this.step = known[0];
    this.command = null;
    document.title = `${known[1]} – fmu-estimator`;
    const main = document.getElementById("main");
    if (main.firstChild !== this.page.node) main.replaceChildren(this.page.node);
    this.page.enter?.(rest.join("/"));
    this.render();
  }

  render() {
    if (!this.state || !this.page) return;
    document.getElementById("folder").textContent = `\u200e${this.state.folder}`;
    const running = this.state.runs.some((r) => r.state === "running");
    replace(document.getElementById("steps"), STEPS.map(([name, title]) => el("a", {
      href: `#${name}`, id: `step-${name}`, "aria-current": name === this.step ? "page" : null,
    }, title, name === "run" && running ? el("span", { class: "dot", title: "running" }) : null)));
    this.page.render();
    this.same();
  }

  // The same on the command line.
  same(command = this.command) {
    this.command = command;
    const text = command ?? this.state.command;
    const details = document.getElementById("casefile");
    replace(document.getElementById("same"),
      el("div", { class: "row" },
        el("span", { class: "muted" }, "The same on the command line"),
        text ? el("code", { id: "command", tabindex: "0" }, text) : el("span", { class: "muted" }, "choose a recording first"),
        text && el("button", { type: "button", id: "copy", onclick: () => this.copy(text) }, "Copy"),
        el("span", { class: "grow" }),
        this.state.text && el("details", { id: "casefile", open: details?.open },
          el("summary", {}, "Case file"),
          el("pre", { tabindex: "0", "aria-label": "The case file" }, this.state.text),
          el("form", { class: "row", onsubmit: (e) => this.save(e) },
            el("label", { for: "saveas" }, "Save a copy as"),
            el("input", { id: "saveas", name: "name", required: true, placeholder: "motor.case.toml", autocomplete: "off" }),
            el("button", {}, "Save")))));
  }

  async copy(text) {
    try { await navigator.clipboard.writeText(text); say("Copied."); } catch { say("The browser does not let the page copy; select the line.", "error"); }
  }

  async save(event) {
    event.preventDefault();
    try {
      const { name } = await post("save", { name: new FormData(event.target).get("name") });
      say(`Saved as ${name}.`);
      await this.refresh();
    } catch (error) { this.fail(error); }
  }

  theme(wanted) {
    const next = { auto: "light", light: "dark", dark: "auto" };
    document.documentElement.dataset.theme = wanted;
    localStorage.setItem("fmu-estimator theme", wanted);
    const button = document.getElementById("theme");
    button.textContent = { auto: "◐", light: "☀", dark: "☾" }[wanted];
    button.setAttribute("aria-label", `Colours: ${wanted}; change to ${next[wanted]}`);
    button.title = button.getAttribute("aria-label");
    button.onclick = () => this.theme(next[wanted]);
    dispatchEvent(new Event("themechange"));
  }
}

const app = new App();
app.begin().catch((error) => say(error.message, "error"));

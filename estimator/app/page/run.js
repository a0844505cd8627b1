// Run: the estimate live, as a process of its own tells it: the best candidate over the data, cost, parameters, time left.

import { el, replace, select } from "./dom.js";
import { get, post } from "./api.js";
import { number } from "./fields.js";
import { count, duration, show } from "./numbers.js";
import { Local, Plot, Remote } from "./plot.js";
import { panelsOf } from "./signals.js";

const LOOK = 250; // ms, between two looks at a run
const PICTURE = 450; // ms, between two pictures of the best candidate
const COLORS = ["--c2", "--c3", "--c4", "--c5", "--c6", "--c1"];
const METHODS = [["cuckoo", "cuckoo: search, polish, error bars"], ["paper", "paper, to the letter"], ["original", "original"], ["integral", "integral"],
  ["steiglitz-mcbride", "Steiglitz–McBride"], ["differential-evolution", "differential evolution"]];

export class RunPage {
  constructor(app) {
    this.app = app;
    this.settings = el("section", { class: "side", "aria-label": "How to estimate" });
    this.status = el("section", { "aria-label": "The run" });
    this.live = new Plot({ label: "The best candidate over the data" });
    this.convergence = new Plot({ label: "Parameters and cost while the search goes on", height: 150, axis: "simulations", unit: "simulations" });
    this.pictured = el("section", { hidden: true, "aria-label": "The best candidate over the data" }, el("h2", {}, "The best candidate over the data"), this.live.node);
    this.converging = el("section", { hidden: true, "aria-label": "Convergence" }, el("h2", {}, "Parameters converging, each over its best value"), this.convergence.node);
    this.node = el("div", { class: "columns" }, this.settings, el("div", { class: "stack" }, this.status, this.pictured, this.converging));
    this.name = null;
    this.run = null;
  }

  enter(name) {
    this.here = true;
    this.name = name || this.app.state.runs.find((r) => r.state === "running")?.name || this.name || this.app.state.runs[0]?.name || null;
    if (this.name) this.follow(this.name);
  }

  leave() { this.here = false; }

  render() {
    const s = this.app.state, running = s.runs.find((r) => r.state === "running");
    if (!this.name && s.runs.length) { this.name = s.runs[0].name; this.follow(this.name); }
    const search = (part) => this.app.change((state) => ({ search: { ...state.search, ...part } }));
    const fitted = s.recordings.filter((r) => r.role === "fit").length, held = s.recordings.filter((r) => r.role === "validate").length;
    replace(this.settings, el("h2", {}, "Estimate"),
      el("p", { class: "muted small" }, `${fitted} recording${fitted === 1 ? "" : "s"} to fit to${held ? `, ${held} to validate on` : ""}; ${s.parameters.filter((p) => p.free).map((p) => p.name).join(", ") || "no parameter"} free.`),
      s.problem ? el("p", { class: "say error", id: "problem" }, s.problem) : null,
      el("p", {}, el("label", { for: "method" }, "Method"), el("br"), select({ id: "method", onchange: (e) => search({ method: e.target.value }) }, METHODS, s.search.method)),
      el("p", {}, el("label", { for: "loss" }, "Loss"), el("br"), select({ id: "loss", onchange: (e) => search({ loss: e.target.value }) }, [["linear", "linear: least squares"], ["huber", "huber: outliers pull less"]], s.search.loss)),
      el("p", {}, el("label", { for: "seed" }, "Seed"), el("br"), number({ id: "seed", label: "Seed of the random numbers", value: s.search.seed, required: true, least: 0, whole: true, onchange: (v) => search({ seed: v }) })),
      el("div", { class: "row" },
        el("button", { type: "button", class: "main", id: "start", disabled: Boolean(s.problem) || Boolean(running), onclick: () => this.start() }, "Estimate"),
        el("button", { type: "button", id: "stop", disabled: !running, onclick: () => this.stop(running.name) }, "Stop and keep")),
      s.runs.length ? [el("h3", {}, "Runs"), el("ul", { class: "list plain" }, s.runs.map((r, k) => el("li", { class: "row" },
        el("button", { type: "button", class: "link", id: `run-${k}`, "aria-pressed": String(r.name === this.name), onclick: () => { this.name = r.name; this.follow(r.name); } }, r.name),
        el("span", { class: "muted" }, r.verdict ?? r.state, r.state === "running" ? "" : `, ${duration(r.seconds)}`))))] : null);
    if (!this.run) replace(this.status, el("div", { class: "empty" }, el("p", {}, "An estimate runs in processes of its own. An FMU that crashes costs a candidate, and this page may be closed meanwhile.")));
  }

  async start() {
    try {
      const run = await post("runs");
      this.name = run.name;
      this.run = null;
      await this.app.refresh();
      this.follow(run.name);
    } catch (error) { this.app.fail(error); }
  }

  async stop(name) {
    try { this.take(await post(`runs/${encodeURIComponent(name)}/stop`)); } catch (error) { this.app.fail(error); }
  }

  async follow(name) {
    if (this.following === name) return;
    this.following = name;
    this.best = "";
    while (this.here && this.following === name && this.name === name) {
      try {
        const run = await get(`runs/${encodeURIComponent(name)}`);
        if (this.name !== name) break;
        this.take(run);
        this.picture(run);
        if (run.state !== "running") {
          await this.app.refresh();
          break;
        }
      } catch (error) {
        this.run = null;
        break;
      }
      await new Promise((resolve) => setTimeout(resolve, LOOK));
    }
    if (this.following === name) this.following = null;
  }

  take(run) {
    this.run = run;
    if (this.app.page !== this) return;
    this.app.same(run.command);
    const p = run.progress, best = p.parameters ?? {};
    const share = p.expected && p.simulations ? Math.min(p.simulations / p.expected, 1) : null;
    const over = run.state !== "running";
    const title = { running: run.stopping ? "is stopping" : `is running: ${phase(p.phase)}`, done: `is done: ${run.verdict}`, stopped: "was stopped", failed: "has failed" }[run.state];
    replace(this.status,
      el("div", { class: "row" }, el("h2", { id: "run-title" }, `${run.name} ${title}`), el("span", { class: "grow" }),
        run.state === "done" ? el("a", { class: "button main", href: `#results/${encodeURIComponent(run.name)}`, id: "to-result" }, "Look at the result") : null,
        run.state === "stopped" && Object.keys(best).length ? el("button", { type: "button", class: "main", id: "keep", onclick: () => this.keep(best) }, "Begin the next run there") : null),
      run.message ? el("p", { class: run.state === "failed" ? "say error" : "muted", role: "status" }, run.message) : null,
      over ? null : el("progress", { "aria-label": p.expected ? `How far the ${p.phase} is` : "How far the run is", max: "1", value: share ?? undefined }),
      el("div", { class: "facts" },
        fact("time", duration(run.seconds)), over ? null : fact(p.expected ? `left of the ${p.phase}` : "left", p.phase === "profile" ? "the report" : p.seconds_left === null || p.seconds_left === undefined ? "not known yet" : duration(p.seconds_left)),
        fact("simulations", p.simulations ? count(p.simulations) + (share !== null && !over ? ` of ${count(p.expected)}` : "") : "–"), fact("cost", show(p.best_cost, 4))),
      Object.keys(best).length ? el("div", { class: "facts", id: "best" }, Object.entries(best).map(([name, v]) => fact(name, `${show(v, 5)} ${this.unit(name)}`))) : null);
    this.converge(run.history);
  }

  unit(name) { return this.app.state.parameters.find((p) => p.name === name || name.startsWith(`${p.name} `))?.unit ?? ""; }

  keep(best) {
    const rows = this.app.state.parameters;
    this.app.change({ parameters: rows.map((r) => ({ name: r.name, free: r.free, min: r.min, max: r.max, value: r.value, per_recording: r.per_recording, start: r.free && r.name in best ? Number(best[r.name].toPrecision(6)) : r.start })) });
    location.hash = "model";
  }

  converge(history) {
    this.converging.hidden = history.length < 2;
    if (history.length < 2) return;
    const names = Object.keys(history.at(-1).parameters), last = history.at(-1).parameters;
    const rows = history.filter((h) => names.every((n) => n in h.parameters));
    const time = rows.map((h) => h.simulations);
    const signals = Object.fromEntries(names.map((n) => [n, rows.map((h) => h.parameters[n] / (last[n] || 1))]));
    signals.cost = rows.map((h) => (h.best_cost > 0 ? Math.log10(h.best_cost) : NaN));
    const key = names.join();
    if (this.local && this.localKey === key) {
      this.local.set(time, signals);
      this.convergence.all();
      return;
    }
    this.local = new Local(time, signals);
    this.localKey = key;
    this.convergence.set({ panels: [
      { key: "parameters", title: "parameter over its best value", unit: "", lines: names.map((n, k) => ({ source: this.local, name: n, label: n, color: COLORS[k % COLORS.length], width: 1.6 })) },
      { key: "cost", title: "log10 of the cost", unit: "", lines: [{ source: this.local, name: "cost", color: "--residual", short: "log10 cost" }] },
    ] });
  }

  async picture(run) {
    const best = JSON.stringify(run.progress.parameters ?? null);
    if (best === "null" || best === this.best || this.drawing || performance.now() - (this.drawn ?? 0) < PICTURE && run.state === "running") return;
    this.drawing = true;
    try {
      const query = { of: "run", name: run.name };
      const told = await get("picture", query), r = told.recordings[0];
      const source = await new Remote({ ...query, at: best }).load();
      this.pictured.hidden = false;
      this.live.set({ panels: panelsOf(source, r.signals, told.units, { simulated: "best candidate" }), keep: this.pictureOf === run.name, transient: r.transient });
      this.pictureOf = run.name;
      this.best = best;
    } catch { this.pictured.hidden = true; } finally {
      this.drawing = false;
      this.drawn = performance.now();
    }
  }
}

const fact = (name, text) => el("div", {}, el("span", {}, name), el("b", {}, text));
const phase = (name) => ({ probe: "the FMU is probed", nuisances: "effects of the bench are looked for", profile: "profiles, then the report" }[name] ?? name ?? "it begins");

// Model: which FMU, which of its parameters are free and within what, and what the start looks like beside the data.

import { el, replace, select } from "./dom.js";
import { get } from "./api.js";
import { number } from "./fields.js";
import { show } from "./numbers.js";
import { Plot, Remote } from "./plot.js";
import { panelsOf } from "./signals.js";

const DECADE = 1; // of a slider, either way

const narrow = (text) => el("span", { class: "narrow muted", "aria-hidden": "true" }, text); // of a stacked table's cell

export class ModelPage {
  constructor(app) {
    this.app = app;
    this.side = el("section", { class: "side", "aria-label": "Model" });
    this.table = el("section", { "aria-label": "Parameters" });
    this.fit = el("p", { class: "muted", role: "status" });
    this.head = el("div", { class: "row" });
    this.plot = new Plot({ label: "The start beside the data, over time" });
    this.seen = el("section", { "aria-label": "The start beside the data" }, this.head, this.fit, this.plot.node);
    this.node = el("div", { class: "columns" }, this.side, el("div", { class: "stack" }, this.table, this.seen));
    this.inspections = {};
    this.recording = 0;
    this.tried = {}; // values under a slider
    this.drawn = "";
  }

  render() {
    const s = this.app.state;
    if (this.revision !== s.revision) { this.tried = {}; this.revision = s.revision; }
    const fmus = [...new Set([...s.models, ...s.files.fmus, s.fmu])];
    replace(this.side, el("h2", {}, "Model"),
      el("fieldset", { class: "models" }, el("legend", { class: "visually-hidden" }, "FMU"),
        fmus.map((name, k) => el("label", { class: "row" },
          el("input", { type: "radio", name: "fmu", id: `fmu-${k}`, checked: name === s.fmu, onchange: () => this.app.change({ fmu: name }) }),
          el("span", { class: "name" }, name), s.models.includes(name) ? el("span", { class: "muted small" }, "bundled") : null))),
      el("label", { class: "drop", for: "fmufile" },
        el("input", { type: "file", id: "fmufile", accept: ".fmu", class: "visually-hidden", onchange: (e) => { const files = [...e.target.files]; e.target.value = ""; this.app.receive(files); } }),
        "Drop an FMU here, or ", el("u", {}, "choose one")),
      this.inspection(s.fmu));
    this.parameters(s);
    this.show();
  }

  inspection(fmu) {
    if (!(fmu in this.inspections)) {
      this.inspections[fmu] = null;
      get("inspect", { fmu }).catch((error) => ({ error: error.message })).then((told) => {
        this.inspections[fmu] = told;
        if (this.app.page === this && this.app.state.fmu === fmu) this.render();
      });
    }
    const told = this.inspections[fmu];
    if (told === null) return el("p", { class: "muted", role: "status" }, "It is being inspected …");
    if (told.error) return el("p", { class: "say error" }, told.error);
    const { inspection: i } = told, probe = i.probe;
    const able = probe && [["repeats", "repeats itself"], ["reset", "honours reset"], ["apart", "keeps instances apart"], ["honours_step", "honours the step"]].filter(([key]) => probe[key]).map(([, text]) => text);
    return el("div", { class: "small" }, el("h3", {}, "What it is"),
      el("p", {}, i.description || i.model_name), el("p", { class: "muted" }, `FMI ${i.fmi_version}, ${i.kinds.join(" and ")}, by ${i.generation_tool}`),
      i.kinds.length > 1 ? el("label", { class: "row" }, "used for ", select({ id: "kind", onchange: (e) => this.app.change({ fmu, kind: e.target.value }) }, i.kinds.map((k) => [k, k]), this.app.state.kind ?? i.kind)) : null,
      able?.length ? el("p", {}, `It ${able.join(", ")}.`) : null,
      i.problems.map((text) => el("p", { class: "say error" }, text)),
      (probe?.findings ?? []).map((text) => el("p", {}, text)),
      el("p", {}, el("code", {}, told.command)));
  }

  parameters(s) {
    const rows = s.parameters;
    const edit = (name, part) => this.app.change((state) => ({ parameters: state.parameters.map((r) => ({ name: r.name, free: r.free, min: r.min, max: r.max, start: r.start, value: r.value, per_recording: r.per_recording, ...(r.name === name ? part : {}) })) }));
    const many = s.recordings.filter((r) => r.role === "fit").length > 1;
    replace(this.table,
      el("div", { class: "row" }, el("h2", {}, "Parameters"), el("span", { class: "grow" }),
        s.explicit ? el("button", { type: "button", id: "automatic", onclick: () => this.app.change({ parameters: null }) }, "Back to what the data say") : el("span", { class: "muted small" }, "bounds and starts by the data")),
      s.problem ? el("p", { class: "say error", id: "problem" }, s.problem) : null,
      el("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "Table of the parameters" }, el("table", { class: "stacked" },
        el("thead", {}, el("tr", {}, ["", "unit", "is", "start", "try", "min", "max", many ? "per recording" : null].filter((t) => t !== null).map((t) => el("th", { scope: "col" }, t || el("span", { class: "visually-hidden" }, "parameter"))))),
        el("tbody", {}, rows.map((r) => el("tr", {},
          el("th", { scope: "row", title: r.description }, r.name),
          el("td", { class: "muted" }, r.unit),
          el("td", {}, select({ id: `is-${r.name}`, "aria-label": `${r.name} is free or fixed`, onchange: (e) => edit(r.name, e.target.value === "free" ? { free: true, value: null } : { free: false, value: this.tried[r.name] ?? r.start ?? r.begin }) }, [["free", "free"], ["fixed", "fixed"]], r.free ? "free" : "fixed")),
          el("td", {}, r.free
            ? [narrow("start "), number({ id: `start-${r.name}`, label: `Start of ${r.name}, in ${r.unit}`, value: r.start, hint: show(r.begin), onchange: (v) => edit(r.name, { start: v }) })]
            : number({ id: `value-${r.name}`, label: `Value of ${r.name}, in ${r.unit}`, value: r.value, hint: show(r.begin), onchange: (v) => edit(r.name, { value: v }) })),
          el("td", {}, r.free && r.begin > 0 ? this.slider(r, edit) : null),
          el("td", {}, r.free ? [narrow("min "), number({ id: `min-${r.name}`, label: `Least ${r.name}, in ${r.unit}`, value: r.min, hint: show(r.lower, 3), onchange: (v) => edit(r.name, { min: v }) })] : null),
          el("td", {}, r.free ? [narrow("max "), number({ id: `max-${r.name}`, label: `Greatest ${r.name}, in ${r.unit}`, value: r.max, hint: show(r.upper, 3), onchange: (v) => edit(r.name, { max: v }) })] : null),
          many ? el("td", {}, r.free ? [narrow("per recording "), el("input", { type: "checkbox", id: `per-${r.name}`, "aria-label": `${r.name} has a value of its own for each recording`, checked: r.per_recording, onchange: (e) => edit(r.name, { per_recording: e.target.checked }) })] : null) : null))))),
      s.notes.length ? el("ul", { class: "small muted" }, s.notes.map((text) => el("li", {}, text))) : null);
  }

  slider(r, edit) {
    const now = this.tried[r.name] ?? r.begin, middle = r.begin;
    return el("input", {
      type: "range", id: `try-${r.name}`, min: -DECADE, max: DECADE, step: 0.01, "aria-label": `Try ${r.name}`, "aria-valuetext": `${show(now)} ${r.unit}`,
      value: String(Math.log10(now / middle)), title: "Try a value; it becomes the start when you let go",
      oninput: (e) => {
        this.tried[r.name] = Math.min(Math.max(middle * 10 ** Number(e.target.value), r.lower ?? 0), r.upper ?? Infinity);
        const field = document.getElementById(`start-${r.name}`);
        if (field) field.value = show(this.tried[r.name]);
        e.target.setAttribute("aria-valuetext", `${show(this.tried[r.name])} ${r.unit}`);
        this.show();
      },
      onchange: () => { const v = Number(this.tried[r.name].toPrecision(5)); edit(r.name, { start: v }); },
    });
  }

  async show() {
    const s = this.app.state;
    if (s.problem || !s.recordings.some((r) => r.role === "fit")) {
      this.fit.textContent = s.recordings.length ? "" : "Choose a recording first, and the start is drawn beside it.";
      this.plot.node.hidden = true;
      replace(this.head, el("h2", {}, "What the start looks like"));
      return;
    }
    const query = { of: "case", revision: s.revision, values: JSON.stringify(this.tried) };
    const key = JSON.stringify([query, this.recording]);
    if (key === this.drawn) return;
    if (this.busy) { this.again = true; return; }
    this.busy = true;
    try {
      const told = await get("picture", query);
      if (this.recording >= told.recordings.length) this.recording = 0;
      const r = told.recordings[this.recording];
      const source = await new Remote({ ...query, recording: this.recording }).load();
      this.plot.node.hidden = false;
      const same = this.begin === r.begin && this.end === r.end && this.seenName === r.name;
      this.plot.set({ panels: panelsOf(source, r.signals, told.units, { simulated: "simulated with the start" }), keep: same, transient: r.transient });
      [this.begin, this.end, this.seenName] = [r.begin, r.end, r.name];
      this.drawn = key;
      const fits = Object.entries(told.fit_percent).filter(([, v]) => v !== null).map(([name, v]) => `${name} ${show(v, 3)} %`);
      this.fit.textContent = `The start explains ${fits.join(", ")}. Free parameters are estimated from here on.`;
      replace(this.head, el("h2", {}, "What the start looks like"), el("span", { class: "grow" }),
        told.recordings.length > 1 ? select({ id: "which", "aria-label": "Recording", onchange: (e) => { this.recording = Number(e.target.value); this.show(); } }, told.recordings.map((x, k) => [String(k), x.name]), String(this.recording)) : null);
    } catch (error) {
      this.plot.node.hidden = true;
      this.fit.textContent = error.message;
      this.drawn = key;
    } finally { this.busy = false; }
    if (this.again) { this.again = false; this.show(); }
  }
}


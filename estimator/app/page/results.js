// Results: verdict and reasons first, parameters on one axis, the transient, residuals, ripple, validation; runs side by side.

import { el, replace, select } from "./dom.js";
import { address, get, Refused } from "./api.js";
import { count, duration, percent, show, withError } from "./numbers.js";
import { Local, Plot, Remote } from "./plot.js";
import { panelsOf } from "./signals.js";

const COLORS = ["--c2", "--c3", "--c4", "--c5", "--c6", "--c1"];

export class ResultsPage {
  constructor(app) {
    this.app = app;
    this.list = el("section", { class: "side", "aria-label": "Results" });
    this.detail = el("div", { class: "stack" });
    this.node = el("div", { class: "columns" }, this.list, this.detail);
    this.plot = new Plot({ label: "Measured, simulated and residual over time" });
    this.spectrum = new Plot({ label: "Amplitude of the residuals over frequency", height: 110, axis: "frequency [Hz]", unit: "Hz" });
    this.chosen = null;
    this.beside = new Set();
    this.known = {};
    this.recording = 0;
  }

  enter(name) { this.asked = name || null; }

  render() {
    const { results } = this.app.state, names = results.map((r) => r.name);
    if (names.includes(this.asked)) { this.chosen = this.asked; this.asked = null; } // a new folder may not be known yet
    if (!names.includes(this.chosen)) this.chosen = [...results].sort((a, b) => b.written - a.written)[0]?.name ?? null;
    this.beside = new Set([...this.beside].filter((n) => names.includes(n)));
    replace(this.list, el("h2", {}, "Results"),
      names.length ? el("p", { class: "muted small" }, "Choose one; tick two or more to see them side by side.") : el("p", { class: "muted" }, "No result folder here yet. Those of the command line, made anywhere, are shown too: put them into this folder."),
      el("ul", { class: "list" }, results.map((r, k) => el("li", { class: `card${r.name === this.chosen && this.beside.size < 2 ? " chosen" : ""}` },
        el("div", { class: "row" },
          el("input", { type: "checkbox", id: `beside-${k}`, "aria-label": `${r.name} side by side with others`, checked: this.beside.has(r.name), onchange: (e) => { this.beside[e.target.checked ? "add" : "delete"](r.name); this.render(); } }),
          el("button", { type: "button", class: "link name", id: `result-${k}`, "aria-pressed": String(r.name === this.chosen), onclick: () => { this.beside.clear(); location.hash = `results/${encodeURIComponent(r.name)}`; this.chosen = r.name; this.render(); } }, r.name),
          el("span", { class: "grow" }), r.verdict ? el("span", { class: `tag ${r.verdict}` }, r.verdict) : el("span", { class: "muted" }, "cannot be read"))))));
    this.show();
  }

  same(command) {
    this.said = command;
    if (this.app.page === this) this.app.same(command);
  }

  async load(name) {
    const written = this.app.state.results.find((r) => r.name === name)?.written, key = `${name} ${written}`;
    if (!this.known[key]) this.known[key] = await get("result", { name });
    return this.known[key];
  }

  async show() {
    const key = JSON.stringify([this.chosen, [...this.beside], this.recording, this.app.state.results]);
    if (key === this.shown) { this.app.command = this.said; return; }
    this.shown = key;
    const isLate = () => key !== this.shown;  // another one was chosen while this was loaded
    try {
      if (this.beside.size > 1) {
        const outcomes = await Promise.all([...this.beside].map((n) => this.load(n)));
        if (!isLate()) this.compare(outcomes);
        return;
      }
      if (this.chosen === null) { replace(this.detail, el("section", {}, el("div", { class: "empty" }, "Nothing has been estimated here yet."))); return; }
      const outcome = await this.load(this.chosen);
      if (!isLate()) this.one(outcome);
    } catch (error) { if (!isLate()) replace(this.detail, el("section", {}, el("p", { class: "say error" }, error.message))); }
  }

  one(outcome) {
    const r = outcome.result;
    this.same(`fmu-estimator export ${quoted(outcome.name)}`);
    const reasons = r.reasons ?? [];
    replace(this.detail,
      el("section", { class: `verdict ${r.verdict}`, "aria-label": "Verdict" }, el("h2", {}, `${outcome.name}: ${r.verdict}`), el("p", {}, r.meaning ?? ""),
        reasons.length ? el("ul", {}, reasons.map((t, k) => el("li", {}, String(t), this.shows(outcome, k)))) : null),
      Object.keys(r.parameters ?? {}).length ? this.parameters(r) : null,
      this.rivals(r),
      this.signals(outcome),
      this.quality(outcome),
      this.correlations(r),
      el("section", { "aria-label": "Found in the data" }, el("h2", {}, "Found in the data and used"),
        (r.notes ?? []).length ? el("ul", { class: "small" }, r.notes.map((t) => el("li", {}, String(t)))) : el("p", { class: "muted" }, "Nothing beside the parameters."),
        (r.failures ?? []).length ? [el("h3", {}, "Failed simulations"), el("ul", { class: "small" }, r.failures.map((t) => el("li", {}, String(t))))] : null,
        el("p", { class: "muted small" }, `${count(r.simulations ?? 0)} simulations, ${count(r.failed_simulations ?? 0)} failed, ${duration(r.seconds)}; method ${r.method}, seed ${r.seed}, FMU ${r.fmu?.name ?? "?"}`)),
      this.downloads(outcome));
    if (outcome.signals.length) this.draw(outcome);
  }

  // A button that shows where in the data a reason lies.
  shows(outcome, k) {
    const place = (outcome.result.places ?? []).find((p) => p.reason === k), at = place ? outcome.signals.findIndex((s) => s.name === place.recording) : -1;
    if (at < 0) return null;
    return [" ", el("button", { type: "button", class: "link", id: `where-${k}`, onclick: () => {
      if (this.recording === at) this.plot.show(...around(place, outcome.signals[at]));
      else { this.wanted = place; this.recording = at; this.render(); }
      this.plot.node.scrollIntoView({ block: "center" });
      this.plot.canvas.focus({ preventScroll: true });
    } }, "show where")];
  }

  parameters(r) {
    const rows = Object.entries(r.parameters), said = r.reasons ?? [];
    const relative = ([, p]) => (p.standard_error > 0 && p.value ? Math.abs(p.standard_error / p.value) : 0);
    const off = ([, p]) => (p.nominal ? Math.abs(p.nominal / p.value - 1) : 0);
    const reach = Math.min(Math.max(...rows.map((x) => Math.max(2 * relative(x), off(x) * 1.1)), 1e-9), 1);
    return el("section", { "aria-label": "Parameters" }, el("h2", {}, "Parameters"),
      el("p", { class: "muted small" }, `Bars: two standard errors either way, on one axis to ± ${show(100 * reach, 2)} %.`),
      el("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "Table of the estimates" }, el("table", { class: "stacked" },
        el("thead", {}, el("tr", {}, [["parameter"], ["estimate", "n"], ["± standard error", "n"], ["", "n"], ["unit"], [`to ± ${show(100 * reach, 2)} %`], ["note"]].map(([t, c]) => el("th", { class: c, scope: "col" }, t)))),
        el("tbody", {}, rows.map(([name, p]) => {
          const useless = p.standard_error > Math.abs(p.value), unknown = useless && p.status === "not identified";
          const untold = p.status === "not identified" && p.standard_error == null && p.at_bound == null;
          const [value, error] = untold ? ["-", ""] : unknown ? [show(p.value, 3), ""] : withError(p.value, p.standard_error);
          return el("tr", {}, el("th", { scope: "row" }, name), el("td", { class: "n" }, value), el("td", { class: "n" }, error ? `± ${error}` : p.free === false ? "fixed" : "not known"),
            el("td", { class: "n" }, useless ? "> 100 %" : percent(p.standard_error, p.value)), el("td", {}, p.unit), el("td", { class: "bars" }, bar(relative([name, p]), reach, p)),
            el("td", { class: "text" }, [p.at_bound ? `at its ${p.at_bound} bound` : null, p.status !== "ok" ? p.status : null, said.some((t) => String(t).includes(p.reason)) ? null : p.reason, p.nominal ? `nominal ${show(p.nominal)}` : null].filter(Boolean).join("; ")));
        })))),
      this.more("Measurement chain", r.measurement_chain), this.more("Derived quantities", r.derived));
  }

  // What else would explain the recordings: the estimate and each rival on one axis, over the estimate's values.
  rivals(r) {
    const rivals = r.rivals ?? [];
    if (!rivals.length) return null;
    const rows = Object.entries(r.parameters ?? {}).filter(([, p]) => p.free !== false && p.value);
    const change = (p, q) => (p ? p.value / q.value - 1 : 0), error = (p, q) => (p?.standard_error > 0 ? Math.abs(p.standard_error / q.value) : 0);
    const entries = rows.map(([name, p]) => [p, ...rivals.map((x) => x.parameters?.[name] ?? null)]);
    const reach = Math.min(Math.max(...entries.flatMap((ps) => ps.map((p) => Math.abs(change(p, ps[0])) + 2 * error(p, ps[0]))), 1e-9), 1);
    return el("section", { "aria-label": "Rivals", id: "rivals" }, el("h2", {}, "Rivals, and what they differ in"),
      el("p", { class: "muted small" }, "Explanations that are nearly as likely as the estimate's. Bars: two standard errors either way, over the estimate's values. The weight is a rival's part of what the standard errors allow for."),
      el("ul", { class: "findings" }, rivals.map((x, k) => el("li", {}, swatch(k + 1), ` ${x.what}: differs most in ${x.differs_in}; weight ${show(100 * x.weight, 2)} %. To decide: ${x.decided_by}.`))),
      el("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "Table of the rivals" }, el("table", { class: "stacked" },
        el("thead", {}, el("tr", {}, el("th", { scope: "col" }, "parameter"), el("th", { scope: "col" }, swatch(0), " estimate"),
          rivals.map((x, k) => el("th", { scope: "col" }, swatch(k + 1), ` ${x.what}`)), el("th", { scope: "col" }, `to ± ${show(100 * reach, 2)} %`))),
        el("tbody", {}, rows.map(([name], j) => el("tr", {}, el("th", { scope: "row" }, name),
          entries[j].map((p, k) => {
            if (!p) return el("td", { class: "muted" }, "–");
            const [value, e] = withError(p.value, p.standard_error), c = change(p, entries[j][0]);
            return el("td", {}, swatch(k), ` ${value}${e ? ` ± ${e}` : ""} ${p.unit ?? ""}`, k ? el("span", { class: "small muted" }, ` (${c >= 0 ? "+" : "−"}${show(100 * Math.abs(c), 2)} %)`) : null);
          }),
          el("td", { class: "bars" }, entries[j].map((p, k) => (p ? sideBar(change(p, entries[j][0]), error(p, entries[j][0]), reach, COLORS[k % COLORS.length]) : null)))))))));
  }

  more(title, values) {
    const rows = Object.entries(values ?? {});
    if (!rows.length) return null;
    return el("details", {}, el("summary", {}, title), el("table", {}, el("tbody", {}, rows.map(([name, p]) => {
      const [value, error] = withError(p.value, p.standard_error);
      return el("tr", {}, el("th", { scope: "row" }, name.replaceAll("_", " ")), el("td", { class: "n" }, value), el("td", { class: "n" }, error ? `± ${error}` : ""), el("td", {}, p.unit));
    }))));
  }

  signals(outcome) {
    if (!outcome.signals.length) {
      const figure = outcome.files.includes("figure.png");
      return el("section", { "aria-label": "Measured against simulated" }, el("h2", {}, "Measured against simulated"),
        figure ? el("img", { src: address("file", { name: outcome.name, file: "figure.png" }), alt: "Measured against simulated signals and residuals", style: { maxWidth: "100%", background: "#fff" } }) : null,
        el("p", { class: "muted" }, outcome.result.verdict === "refused" ? (figure ? "Shaded: where the reason lies." : "A refused estimate has nothing to compare.") : "To read values off, estimate again with --signals."));
    }
    const s = outcome.signals[this.recording] ?? outcome.signals[0], marked = (outcome.result.places ?? []).some((p) => p.recording === s.name);
    return el("section", { "aria-label": "Measured against simulated" },
      el("div", { class: "row" }, el("h2", {}, s.fitted ? "Measured against simulated" : marked ? "Where the reason lies" : "What was measured"), marked ? el("span", { class: "key small" }, el("i", { style: { background: "var(--place)" } }), "where the reason lies") : null, el("span", { class: "grow" }),
        outcome.signals.length > 1 ? select({ id: "which-recording", "aria-label": "Recording", onchange: (e) => { this.recording = Number(e.target.value); this.render(); } },
          outcome.signals.map((x, k) => [String(k), x.held_out ? `${x.name} (validation)` : x.name]), String(this.recording)) : el("span", { class: "muted" }, s.name)),
      this.plot.node, !s.fitted ? null : el("details", { id: "ripple", ontoggle: (e) => e.target.open && this.ripple(outcome) }, el("summary", {}, "Ripple: the residuals over frequency"), this.spectrum.node));
  }

  async draw(outcome) {
    if (this.recording >= outcome.signals.length) this.recording = 0;
    const s = outcome.signals[this.recording], query = { of: "result", name: outcome.name, recording: this.recording };
    try {
      const source = await new Remote(query).load();
      const names = [...s.inputs.map((n) => `input ${n}`), ...s.outputs.flatMap((n) => (s.fitted ? [`measured ${n}`, `simulated ${n}`, `residual ${n}`] : [`measured ${n}`]))];
      const places = (outcome.result.places ?? []).filter((p) => p.recording === s.name);
      const shades = places.map((p) => ({ panel: p.signal || undefined, from: p.start, to: p.end, color: "--place" }));
      this.plot.set({ panels: panelsOf(source, names, s.units, { simulated: "simulated with the estimate", residuals: true }), shades, transient: s.transient });
      const first = this.wanted?.recording === s.name ? this.wanted : s.fitted ? null : places[0];
      this.wanted = null;
      if (first) this.plot.show(...around(first, s));
    } catch (error) { this.app.fail(error); }
  }

  async ripple(outcome) {
    const told = await get("ripple", { name: outcome.name, recording: this.recording }), s = outcome.signals[this.recording];
    this.spectrum.set({ panels: Object.entries(told).map(([name, { frequency, amplitude }], k) => ({
      key: name, title: `amplitude of the residual of ${name}`, unit: s.units[name], zero: true,
      lines: [{ source: new Local(frequency, { [name]: amplitude }), name, color: COLORS[k], short: name }] })) });
  }

  quality(outcome) {
    const r = outcome.result, rows = Object.entries(r.rmse ?? {});
    if (!rows.length) return null;
    const v = r.validation, units = Object.assign({}, ...outcome.signals.map((s) => s.units));
    const per = outcome.signals.length > 1 ? outcome.signals : [];
    const heads = ["RMSE", "residual", "noise", "fit", ...(v ? ["RMSE on the validation", "its fit"] : []), ...per.map((s) => `RMSE of ${s.name}`)];
    return el("section", { "aria-label": "Fit" }, el("h2", {}, v ? "Fit and validation" : "Fit"), el("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "Table of the fit" }, el("table", { class: "stacked" },
      el("thead", {}, el("tr", {}, ["output", ...heads].map((t, k) => el("th", { class: k ? "n" : null, scope: "col" }, t)))),
      el("tbody", {}, rows.map(([name, rmse]) => {
        const unit = units[name] ?? "", with_ = (x) => (x === undefined || x === null ? "–" : `${show(x, 4)} ${unit}`);
        return el("tr", {}, el("th", { scope: "row" }, name), ...[with_(rmse), with_(r.noise?.[name]), with_(r.sample_noise?.[name]), `${show(r.fit_percent?.[name], 4)} %`,
          ...(v ? [with_(v.rmse?.[name]), `${show(v.fit_percent?.[name], 4)} %`] : []), ...per.map((s) => with_(s.rmse[name]))].map((t, k) => el("td", { class: "n" }, el("span", { class: "narrow muted" }, `${heads[k]} `), t)));
      })))));
  }

  correlations(r) {
    const names = Object.keys(r.correlation ?? {});
    if (names.length < 2) return null;
    return el("section", { "aria-label": "Correlation" }, el("details", {}, el("summary", {}, "Correlation of the parameters"), el("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "Table of the correlations" }, el("table", {},
      el("thead", {}, el("tr", {}, el("th", {}, el("span", { class: "visually-hidden" }, "parameter")), names.map((n) => el("th", { class: "n", scope: "col" }, n)))),
      el("tbody", {}, names.map((a) => el("tr", {}, el("th", { scope: "row" }, a), names.map((b) => el("td", { class: "n" }, show(r.correlation[a][b], 2))))))))));
  }

  downloads(outcome) {
    const name = outcome.name;
    return el("section", { "aria-label": "Files" }, el("h2", {}, "Files"),
      el("div", { class: "row" },
        outcome.files.includes("report.html") ? el("a", { class: "button", href: address("file", { name, file: "report.html" }), target: "_blank", rel: "noopener" }, "Open the report") : null,
        outcome.files.map((file) => el("a", { class: "button", href: address("file", { name, file, download: 1 }), download: file }, file))),
      outcome.result.verdict === "refused" ? null : [el("h3", {}, "For other tools"), el("div", { class: "row" }, outcome.formats.map((format, k) =>
        el("button", { type: "button", id: `export-${k}`, onclick: () => this.export(name, format) }, format)))]);
  }

  async export(name, format) {
    this.same(`fmu-estimator export ${quoted(name)} --format ${format}`);
    try {
      const response = await fetch(address("export", { name, format }), { credentials: "omit" });
      if (!response.ok) throw new Refused((await response.json()).error, response.status);
      const file = decodeURIComponent(/filename\*=UTF-8''(.*)$/.exec(response.headers.get("Content-Disposition"))?.[1] ?? format);
      const link = el("a", { href: URL.createObjectURL(await response.blob()), download: file });
      link.click();
      setTimeout(() => URL.revokeObjectURL(link.href), 10000);
    } catch (error) { this.app.fail(error); }
  }

  // Two or more runs side by side: each parameter against the first run's, with bars on one axis.
  compare(outcomes) {
    const [first] = outcomes, rows = [...new Set(outcomes.flatMap((o) => Object.keys(o.result.parameters ?? {})))];
    const entries = rows.map((name) => outcomes.map((o) => o.result.parameters?.[name] ?? null));
    const change = (p, q) => (p && q && q.value ? p.value / q.value - 1 : null);
    const error = (p, q) => (p?.standard_error > 0 && q ? Math.abs(p.standard_error / q.value) : 0);
    const reach = Math.max(...entries.flatMap((ps) => ps.map((p) => Math.abs(change(p, ps[0]) ?? 0) + 2 * error(p, ps[0]))), 1e-9);
    const units = Object.assign({}, ...outcomes.flatMap((o) => o.signals.map((s) => s.units)));
    const outputs = [...new Set(outcomes.flatMap((o) => Object.keys(o.result.rmse ?? {})))];
    this.same(`fmu-estimator compare ${outcomes.map((o) => quoted(o.name)).join(" ")}`);
    replace(this.detail, el("section", { "aria-label": "Side by side" }, el("h2", {}, "Side by side"),
      el("p", { class: "row" }, outcomes.map((o, k) => el("span", {}, swatch(k), ` ${o.name} `, el("span", { class: `tag ${o.result.verdict}` }, o.result.verdict)))),
      el("p", { class: "muted small" }, `Bars: two standard errors either way, over the estimate of ${first.name}. Percentages: the difference from it, with its standard error.`),
      el("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "Table of the runs" }, el("table", { class: "stacked" },
        el("thead", {}, el("tr", {}, el("th", { scope: "col" }, "parameter"), el("th", { scope: "col" }, `over ${first.name}, to ± ${show(100 * reach, 2)} %`), outcomes.map((o, k) => el("th", { scope: "col" }, swatch(k), ` ${o.name}`)))),
        el("tbody", {}, rows.map((name, j) => el("tr", {}, el("th", { scope: "row" }, name),
          el("td", { class: "bars" }, entries[j].map((p, k) => (p ? sideBar(change(p, entries[j][0]) ?? 0, error(p, entries[j][0]), reach, COLORS[k % COLORS.length]) : null))),
          entries[j].map((p, k) => {
            if (!p) return el("td", { class: "muted" }, "–");
            const [value, e] = withError(p.value, p.standard_error), c = k ? change(p, entries[j][0]) : null;
            const both = Math.hypot(error(p, entries[j][0]), error(entries[j][0], entries[j][0]));
            return el("td", {}, mark(k), `${value}${e ? ` ± ${e}` : ""} ${p.unit}`, c === null ? null : el("div", { class: "small muted" }, `${c >= 0 ? "+" : "−"}${show(100 * Math.abs(c), 3)} %${both ? ` ± ${show(100 * both, 2)} %` : ""}`));
          }))),
        outputs.map((name) => el("tr", {}, el("th", { scope: "row" }, `RMSE ${name}`), el("td", {}), outcomes.map((o, k) => el("td", {}, mark(k), `${show(o.result.rmse?.[name], 4)} ${units[name] ?? ""}`)))),
        el("tr", {}, el("th", { scope: "row" }, "method, seed"), el("td", {}), outcomes.map((o, k) => el("td", {}, mark(k), `${o.result.method}, ${o.result.seed}`))),
        el("tr", {}, el("th", { scope: "row" }, "FMU"), el("td", {}), outcomes.map((o, k) => el("td", {}, mark(k), o.result.fmu?.name ?? "–"))))))),
      this.told(outcomes.map((o) => o.name)), this.overlaid(outcomes));
  }

  // What the command compare says of them: which differences are more than noise.
  told(names) {
    const section = el("section", { hidden: true, class: "told", "aria-label": "What differs" });
    get("compare", { names: JSON.stringify(names) }).then(({ text, command }) => {
      section.hidden = false;
      section.append(el("h2", {}, "What differs"), el("pre", { tabindex: "0", "aria-label": `What ${command} says` }, text));
    }).catch(() => section.remove());
    return section;
  }

  // The first recording of each run in one plot, where they have signals.
  overlaid(outcomes) {
    const able = outcomes.filter((o) => o.signals.length);
    if (!able.length) return null;
    Promise.all(able.map((o) => new Remote({ of: "result", name: o.name, recording: 0 }).load())).then((sources) => {
      const outputs = [...new Set(able.flatMap((o) => o.signals[0].outputs))], units = able[0].signals[0].units;
      this.plot.set({ panels: outputs.flatMap((name) => [
        { key: name, title: name, unit: units[name], lines: [
          ...able.slice(0, 1).map((o, k) => ({ source: sources[k], name: `measured ${name}`, color: "--measured", width: 2.6, label: `measured in ${o.name}` })),
          ...able.map((o, k) => ({ source: sources[k], name: `simulated ${name}`, color: COLORS[outcomes.indexOf(o) % COLORS.length], label: o.name, dots: false }))] },
        { key: `r ${name}`, title: `residual of ${name}`, unit: units[name], zero: true, lines: able.map((o, k) => ({ source: sources[k], name: `residual ${name}`, color: COLORS[outcomes.indexOf(o) % COLORS.length], width: 1, short: o.name })) }]), transient: able[0].signals[0].transient });
    }).catch((error) => this.app.fail(error));
    return el("section", { "aria-label": "Signals side by side" }, el("h2", {}, "Signals side by side"), this.plot.node);
  }
}

// A place in a recording with some of what lies about it.
function around(place, s) {
  const room = Math.max(0.15 * (place.end - place.start), 0.04 * (s.end - s.begin));
  return [Math.max(place.start - room, s.begin), Math.min(place.end + room, s.end)];
}

function bar(relative, reach, p) {
  const half = Math.min(2 * relative / reach, 1) * 50, nominal = p.nominal ? (p.nominal / p.value - 1) / reach * 50 + 50 : null;
  const text = relative ? `two standard errors are ${show(200 * relative, 2)} %` : "no standard error";
  return el("span", { class: "bar", role: "img", "aria-label": text, title: text }, relative ? el("i", { style: { left: `${50 - half}%`, width: `${2 * half}%` } }) : null,
    nominal !== null && nominal >= 0 && nominal <= 100 ? el("b", { style: { left: `${nominal}%` }, title: `nominal ${show(p.nominal)}` }) : null, 2 * relative > reach ? el("em", {}, "wider") : null);
}

const swatch = (k) => el("i", { class: "swatch", style: { background: `var(${COLORS[k % COLORS.length]})` } });
const mark = (k) => el("span", { class: "narrow" }, swatch(k), " "); // where the table is stacked, which column it was

function sideBar(change, error, reach, color) {
  const at = 50 + 50 * Math.min(Math.max(change / reach, -1), 1), half = 50 * 2 * error / reach;
  return el("span", { class: "bar", "aria-hidden": "true" }, el("i", { style: { left: `${at - half}%`, width: `${2 * half}%`, background: `var(${color})` } }));
}

const quoted = (name) => (/^[\w./@%+=:,-]+$/.test(name) ? name : `'${name.replaceAll("'", "'\\''")}'`);

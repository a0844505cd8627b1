// Data: recordings with their roles; columns with their units and what each is; window, sign, scale; gaps, outliers.

import { el, replace, select, say } from "./dom.js";
import { get, post } from "./api.js";
import { number } from "./fields.js";
import { count, show } from "./numbers.js";
import { Plot, Remote } from "./plot.js";

const COLORS = ["--c1", "--c2", "--c3", "--c4", "--c5", "--c6"];
const ROLES = [["fit", "fit"], ["validate", "validate"], ["off", "off"]];

const SIGNALS = [["", "not used"], ["time", "time"], ["v", "voltage (v)"], ["i", "current (i)"], ["w", "speed (w)"], ["angle", "angle"], ["load", "load torque"]];
const UNITS = { time: "s", v: "V", i: "A", w: "rad/s", angle: "rad", load: "N.m" };

export class DataPage {
  constructor(app) {
    this.app = app;
    this.bares = {}; // recording, as it is read → what a file holds that cannot be read as it is
    this.said = {}; // file → what is said of it meanwhile: signals and units of columns, interval
    this.chosen = null;
    this.checks = {}; // name → what the command check says
    this.facts = {}; // recording, as it is read → what was read, or the sentence why not
    this.part = {}; // file → which of its tests is shown
    this.list = el("div");
    this.detail = el("div");
    this.plot = new Plot({ label: "The recording's columns over time" });
    this.plotted = "";
    this.node = el("div", { class: "columns" },
      el("section", { class: "side", "aria-label": "Recordings" }, this.list),
      el("section", { class: "wide", "aria-label": "The chosen recording" }, this.detail, this.plot.node)); // which stays: one may be dragging in it
  }

  select(name) { this.chosen = name; this.render(); }

  render() {
    const { recordings, files } = this.app.state;
    if (!recordings.some((r) => r.file === this.chosen)) this.chosen = recordings[0]?.file ?? null;
    const used = new Set(recordings.map((r) => r.file));
    const others = files.recordings.filter((name) => !used.has(name));
    replace(this.list,
      el("h2", {}, "Recordings"),
      el("label", { class: "drop", for: "files" },
        el("input", { type: "file", id: "files", multiple: true, class: "visually-hidden", onchange: (e) => this.taken(e) }),
        "Drop recordings, an FMU or a case file here, or ", el("u", {}, "choose files")),
      recordings.length ? el("ul", { class: "list" }, recordings.map((r, k) => this.row(r, k))) : null,
      others.length ? [el("h3", {}, "In this folder"), el("ul", { class: "list plain" }, others.map((name, k) => el("li", { class: "row" },
        el("button", { type: "button", class: "link name", tabindex: "-1", onclick: () => this.app.add(name) }, name), el("span", { class: "grow" }),
        el("button", { type: "button", id: `add-${k}`, "aria-label": `Add ${name}`, onclick: () => this.app.add(name) }, "Add"))))] : null,
      files.cases.length ? [el("h3", {}, "Case files"), el("ul", { class: "list plain" }, files.cases.map((name, k) => el("li", { class: "row" },
        el("button", { type: "button", class: "link name", tabindex: "-1", onclick: () => this.open(name) }, name), el("span", { class: "grow" }),
        el("button", { type: "button", id: `open-${k}`, "aria-label": `Open ${name}`, onclick: () => this.open(name) }, "Open"))))] : null);
    this.show();
  }

  taken(event) {
    const files = [...event.target.files];
    event.target.value = "";
    this.app.receive(files);
  }

  row(r, k) {
    const chosen = r.file === this.chosen;
    return el("li", { class: `card${chosen ? " chosen" : ""}` },
      el("button", { type: "button", class: "link name", id: `choose-${k}`, "aria-pressed": String(chosen), onclick: () => this.select(r.file) }, r.file),
      el("div", { class: "row" },
        el("fieldset", { class: "segments" }, el("legend", { class: "visually-hidden" }, `Role of ${r.file}`),
          ROLES.map(([role, text]) => el("label", {},
            el("input", { type: "radio", name: `role-${k}`, id: `role-${k}-${role}`, value: role, checked: r.role === role, onchange: () => this.edit(r.file, { role }) }),
            el("span", {}, text)))),
        el("span", { class: "grow" }),
        el("button", { type: "button", id: `remove-${k}`, "aria-label": `Take ${r.file} from the list`, title: "Take it from the list; the file stays", onclick: () => this.remove(r.file) }, "×")));
  }

  // part: what changes of a recording, or a function of what it is by then
  edit(file, part) {
    this.app.change((state) => ({ recordings: state.recordings.map((r) => (r.file === file ? { ...r, ...(typeof part === "function" ? part(r) : part) } : r)) }));
  }

  remove(file) { this.app.change((state) => ({ recordings: state.recordings.filter((r) => r.file !== file) })); }

  async open(name) {
    try { this.app.take(await post("open", { name })); say(`${name} is open; what you change is kept in app.case.toml.`); } catch (error) { this.app.fail(error); }
  }

  async show() {
    const file = this.chosen;
    if (file === null) {
      this.plotted = "";
      this.plot.node.hidden = true;
      replace(this.detail, el("div", { class: "empty" }, el("h2", {}, "No recording yet"),
        el("p", {}, "A recording is text with a header (CSV), Excel, MAT, MDF, Parquet or TDMS: time, voltage, current, speed or angle."),
        el("p", {}, "Drop one anywhere on this page. It is copied into the folder; one that lies there already stays where it is.")));
      return;
    }
    const r = this.app.state.recordings.find((x) => x.file === file);
    if (!r) return;
    const part = this.part[file] ?? 0, key = this.key(r, part);
    if (!(key in this.facts)) {
      try { this.facts[key] = await get("recording", { name: file, part }); } catch (error) { this.facts[key] = error.message; }
      if (file !== this.chosen || key !== this.key(this.app.state.recordings.find((x) => x.file === file) ?? r, this.part[file] ?? 0)) return;
    }
    const facts = this.facts[key];
    if (typeof facts === "string") {
      delete this.facts[key];
      if (part) { this.part[file] = 0; this.show(); return; }
      const bare = this.bares[key] ?? await get("bare", { name: file }).catch(() => null);
      if (file !== this.chosen) return;
      if (bare) this.bares[key] = bare;
      this.plot.node.hidden = true;
      replace(this.detail, el("h2", {}, file),
        bare?.lacks.length ? this.bareForm(r, bare) : el("p", { class: "say error" }, facts), this.reading(r, { tests: [], motors: [] }, !bare?.lacks.length));
      return;
    }
    const { problem } = this.app.state;
    replace(this.detail,
      el("h2", {}, facts.title),
      el("p", { class: "muted", id: "facts" }, [
        `${count(facts.samples)} samples`, `${show(facts.end - facts.begin, 5)} s`, `every ${show(facts.step * 1000, 5)} ms`,
        facts.even ? "even clock" : "the clock jitters", facts.missing_rows ? `${facts.missing_rows} rows lost` : null,
      ].filter(Boolean).join(" · ")),
      problem ? el("p", { class: "say error", id: "problem" }, problem) : null,
      this.testRow(r, facts, part),
      this.reading(r, facts),
      this.findings(file, r),
      el("div", { class: "chips", role: "list", "aria-label": "Columns" }, facts.columns.map((c, k) => this.chip(facts, r, c, k))),
      this.windowRow(facts, r));
    this.plot.node.hidden = false;
    this.draw(file, facts, r, part);
  }

  // A recording as it is read: its file, how, and which of its tests.
  key(r, part) { return JSON.stringify([r.file, r.reading, part]); }

  // Which test of a file that holds several is used, and which is shown.
  testRow(r, facts, part) {
    if (facts.tests.length < 2) return null;
    const every = [["", `all ${facts.tests.length} tests, fitted together`], ...facts.tests.map((name) => [name, `${name} alone`])];
    return el("div", { class: "row", id: "tests" }, el("label", { for: "test" }, "Tests"),
      select({ id: "test", onchange: (e) => { this.part[r.file] = 0; this.read(r, { test: e.target.value || null }); } }, every, r.reading.test ?? ""),
      facts.parts > 1 ? [el("label", { for: "part" }, "shown"),
        select({ id: "part", onchange: (e) => { this.part[r.file] = Number(e.target.value); this.show(); } }, facts.tests.map((name, k) => [String(k), name]), String(part))] : null);
  }

  // A file without a header, or without a time: what its columns are, and how far apart its samples, is asked for.
  bareForm(r, bare) {
    const headless = bare.lacks.includes("header");
    const said = this.said[r.file] ??= { signals: {}, units: {}, interval: r.reading.rate ? 1000 / r.reading.rate : null };
    const chosen = (k) => said.signals[k] ?? "";
    return el("form", { class: "panel", "aria-label": "What the file does not say", onsubmit: (e) => { e.preventDefault(); this.readBare(r, bare); } },
      el("p", { class: "say" }, headless ? "This file has no header: say what its columns are." : "This file has no time: say how far apart its samples are."),
      headless ? el("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "The file's columns" }, el("table", { class: "stacked" },
        el("thead", {}, el("tr", {}, ["column", "begins with", "is", "in"].map((t) => el("th", { scope: "col" }, t)))),
        el("tbody", {}, bare.columns.map((c, k) => el("tr", {}, el("th", { scope: "row" }, c.header),
          el("td", { class: "muted" }, c.first.map((v) => (v === null ? "–" : show(v, 5))).join("; ")),
          el("td", {}, select({ id: `bare-${k}`, "aria-label": `What ${c.header} is`, onchange: (e) => { said.signals[k] = e.target.value; this.show(); } }, SIGNALS, chosen(k))),
          el("td", {}, chosen(k) ? el("input", { id: `bare-unit-${k}`, type: "text", autocomplete: "off", "aria-label": `Unit of ${c.header}`, value: said.units[k] ?? "", placeholder: UNITS[chosen(k)],
            style: { width: "6em" }, oninput: (e) => { said.units[k] = e.target.value; } }) : null)))))) : null,
      el("div", { class: "row" }, el("span", { "aria-hidden": "true" }, "Sampling interval"),
        number({ id: "bare-interval", label: "Sampling interval, in ms", value: said.interval, hint: headless ? "" : "1", onchange: (v) => { said.interval = v; } }), el("span", { class: "muted" }, "ms"),
        el("button", { id: "bare-read", class: "main" }, "Read it so")));
  }

  readBare(r, bare) {
    const said = this.said[r.file], columns = {}, units = {};
    for (const [k, signal] of Object.entries(said.signals)) {
      if (!signal) continue;
      if (signal in columns) { say(`Two columns cannot both be the ${SIGNALS.find(([name]) => name === signal)[1]}.`, "error"); return; }
      columns[signal] = String(Number(k) + 1);
      if (said.units[k]?.trim()) units[signal] = said.units[k].trim();
    }
    if (bare.lacks.includes("header") && !Object.keys(columns).some((name) => name !== "time")) { say("Say of at least one column what it measures.", "error"); return; }
    if (!("time" in columns) && !(said.interval > 0)) { say("Give the sampling interval in ms, or say which column is the time.", "error"); return; }
    const rate = "time" in columns ? null : Number((1000 / said.interval).toPrecision(12));
    this.edit(r.file, (now) => ({ role: now.role === "off" ? "fit" : now.role, reading: { ...now.reading, columns, units, rate } }));
  }

  // How the file is read where its header does not say it, as the options of estimate do.
  reading(r, facts, open = false) {
    const told = r.reading, words = ["supply", "counts", "per_turn", "motor"].filter((key) => told[key] !== null).map((key) => `${key.replace("_", "-")} ${told[key]}`);
    const columns = Object.entries(told.columns).map(([signal, column]) => `${signal} is column ${column}`);
    const said = [...columns, ...(told.rate ? [`a sample every ${show(1000 / told.rate, 6)} ms`] : []), ...Object.entries(told.units).map(([name, unit]) => `${name} in ${unit}`), ...words];
    const before = document.getElementById("reading");
    const text = (key, label, hint) => el("label", { class: "row small" }, label, el("input", { id: `reading-${key}`, type: "text", value: told[key] ?? "", placeholder: hint,
      autocomplete: "off", style: { width: "9em" }, onchange: (e) => this.read(r, { [key]: e.target.value.trim() || null }) }));
    const value = (key, label, unit) => el("span", { class: "row small" }, el("span", { "aria-hidden": "true" }, label),
      number({ id: `reading-${key}`, label: `${label}${unit ? `, in ${unit}` : ""}`, value: told[key], width: "6em", onchange: (v) => (v !== null && v <= 0 ? say(`${label} must be above 0.`, "error") : this.read(r, { [key]: v })) }),
      unit ? el("span", { class: "muted" }, unit) : null);
    return el("details", { id: "reading", open: open || (before ? before.open : said.length > 0) },
      el("summary", {}, `How the file is read${said.length ? `: ${said.join(", ")}` : ""}`),
      el("div", { class: "row" },
        text("supply", "Supply of a duty cycle", "12 or a column"),
        value("counts", "Counts of an encoder a turn", ""),
        value("per_turn", "Way of a turn", "m"),
        open ? null : el("label", { class: "row small" }, "Unit of the time", el("input", { id: "reading-time", type: "text", value: told.units.time ?? "", placeholder: "as written", autocomplete: "off",
          style: { width: "6em" }, onchange: (e) => this.unit(r, "time", e.target.value.trim()) })),
        columns.length || told.rate || Object.keys(told.units).length ? el("button", { type: "button", id: "bare-again", onclick: () => this.read(r, { columns: {}, units: {}, rate: null }) }, "Forget what was said of its columns") : null,
        facts.motors.length || told.motor !== null ? el("label", { class: "row small" }, "Motor",
          select({ id: "reading-motor", onchange: (e) => this.read(r, { motor: e.target.value || null }) }, [["", "not said"], ...facts.motors.map((m) => [m, m])], told.motor ?? "")) : null));
  }

  // Read a column in another unit than its header says, or again as it says.
  unit(r, name, text) {
    this.edit(r.file, (now) => ({ reading: { ...now.reading, units: text
      ? { ...now.reading.units, [name]: text } : Object.fromEntries(Object.entries(now.reading.units).filter(([n]) => n !== name)) } }));
  }

  // What a column's unit is called in the case: as it was said, by the column's name or by its signal's.
  unitKey(c, r) {
    const signal = Object.entries(r.reading.columns).find(([, column]) => [c.name, c.plain, c.header].includes(column) || `column ${column}` === c.plain)?.[0];
    return [c.name, c.plain, signal].find((name) => name in r.reading.units) ?? signal ?? c.name;
  }

  read(r, part) { this.edit(r.file, (now) => ({ reading: { ...now.reading, ...part } })); }

  // What the command check finds in a recording; nothing while it looks, or where it cannot.
  findings(file, r) {
    const key = this.key(r, 0);
    if (!(key in this.checks)) {
      this.checks[key] = null;
      get("check", { name: file }).catch(() => null).then((told) => {
        this.checks[key] = told;
        if (told && this.app.page === this && this.chosen === file) this.show();
      });
    }
    const told = this.checks[key];
    if (!told) return null;
    const all = told.check.recordings ?? [];
    const doubts = all.flatMap((c) => c.implausible ?? []), lost = all.flatMap((c) => c.damage ?? []);
    if (!doubts.length && !lost.length) return el("p", { class: "muted small" }, "Nothing in it is implausible: ", el("code", {}, told.command));
    return el("div", { class: `say${doubts.some((d) => d.refused) ? " error" : ""}` }, el("ul", { class: "findings" },
      doubts.map((d) => el("li", {}, d.sentence)), lost.map((text) => el("li", {}, text))), el("code", {}, told.command));
  }

  // What a column is put on: "input v", or nothing.
  target(column) {
    const { mapping, mapped } = this.app.state;
    if (!mapped) return column.own ?? "";
    for (const causality of ["inputs", "outputs"]) {
      for (const [name, text] of Object.entries(mapping[causality])) {
        if (text === column.header || text === column.name || text.replace(/\s*\[[^\]]*\]$/, "") === column.plain) return `${causality} ${name}`;
      }
    }
    return "";
  }

  chip(facts, r, c, k) {
    const { targets } = this.app.state;
    const target = this.target(c), name = target.split(" ").slice(1).join(" "), channel = c.name;
    const key = [name, channel].find((x) => x in r.scale) ?? channel, off = [name, channel].find((x) => x in r.offset) ?? channel;
    const scale = r.scale[key] ?? 1, offset = r.offset[off] ?? 0;
    const set = (part, at, value, neutral) => this.edit(r.file, (now) => ({ [part]: value === neutral
      ? Object.fromEntries(Object.entries(now[part]).filter(([n]) => n !== at)) : { ...now[part], [at]: value } }));
    const options = [["", "not used"], ...targets.map((t) => [`${t.causality}s ${t.name}`,
      `${t.causality === "input" ? "drives" : "measures"} ${t.title || t.variable}${t.title ? ` (${t.variable})` : ""}`])];
    const si = c.unit && c.unit !== "?" ? c.unit : "";
    const marks = [
      c.gaps?.length ? el("button", { type: "button", class: "mark", id: `gap-${k}`, onclick: () => this.look(c.gaps[0][0], c.gaps[0][1], facts) }, `${count(c.missing)} missing in ${c.gaps.length} gap${c.gaps.length > 1 ? "s" : ""}`) : null,
      c.outliers?.length ? el("button", { type: "button", class: "mark", id: `out-${k}`, onclick: () => this.look(c.outliers[0], c.outliers[0], facts) }, `${c.outliers.length} outlier${c.outliers.length > 1 ? "s" : ""}`) : null,
    ];
    return el("div", { class: `chip${target ? "" : " unused"}`, role: "listitem" },
      el("div", { class: "row" }, el("i", { class: "swatch", style: { background: `var(${COLORS[k % COLORS.length]})` } }),
        el("b", { class: "name" }, c.header), c.assumed ? el("span", { class: "muted" }, `taken as ${si}`) : null),
      c.unreadable ? el("p", { class: "muted small" }, c.unreadable) : [
        select({ id: `target-${k}`, "aria-label": `What ${c.header} is`, onchange: (e) => this.assign(c, e.target.value) }, options, target),
        target ? el("div", { class: "row small" },
          el("button", { type: "button", id: `sign-${k}`, "aria-pressed": String(scale < 0), "aria-label": `Turn the sign of ${c.header}`, title: "Turn the sign", onclick: () => set("scale", key, -scale, 1) }, "±"),
          el("span", { "aria-hidden": "true" }, "×"),
          number({ id: `scale-${k}`, label: `Factor on ${c.header}`, value: scale, required: true, width: "4.6em", onchange: (v) => (v === 0 ? say("A factor of 0 leaves nothing.", "error") : set("scale", key, v, 1)) }),
          el("span", { "aria-hidden": "true" }, "+"),
          number({ id: `offset-${k}`, label: `Offset added to ${c.header}, in ${si}`, value: offset, required: true, width: "4.6em", onchange: (v) => set("offset", off, v, 0) }),
          el("span", { class: "muted" }, si)) : null,
        target ? el("label", { class: "row small" }, "unit ",
          el("input", { id: `unit-${k}`, type: "text", placeholder: c.given ? "as written" : c.written ?? (si || targets.find((t) => `${t.causality}s ${t.name}` === target)?.unit || ""), value: c.given ? c.written : "", autocomplete: "off", style: { width: "5em" }, "aria-label": `Unit of ${c.header}`,
            onchange: (e) => this.setUnit(c, r, target, e.target.value.trim()) })) : null,
        c.overruled ? el("p", { class: "mark small" }, `its header says ${c.overruled}; it is read as ${c.written}, as you said`) : null,
      ],
      el("div", { class: "row small" }, marks));
  }

  // A unit that the header lacks becomes part of the mapping; one that it states is overruled, and that is told.
  setUnit(c, r, target, text) {
    if (c.written === null && !c.given && !Object.keys(r.reading.columns).length) { this.assign(c, target, text); return; }
    const mapped = this.app.state.mapped, header = c.header;
    this.app.change((state) => {
      const key = this.unitKey(c, r), now = state.recordings.find((x) => x.file === r.file);
      const units = { ...now.reading.units };
      if (text) units[key] = text; else delete units[key];
      const recordings = state.recordings.map((x) => (x.file === r.file ? { ...x, reading: { ...x.reading, units } } : x));
      if (!mapped) return { recordings };
      const mapping = structuredClone(state.mapping), [causality, ...rest] = target.split(" ");
      mapping[causality][rest.join(" ")] = c.plain;
      return { recordings, mapping };
    });
    if (text && c.written !== null && !c.given) say(`${header} is now read as ${text}, against its header. Make sure that the header is the one that is wrong.`);
  }

  assign(column, target, unit = "") {
    this.app.change((state) => {
      const mapping = structuredClone(state.mapping);
      const before = this.target(column);
      const without = (text) => { const [causality, ...rest] = text.split(" "); delete mapping[causality]?.[rest.join(" ")]; };
      if (before) without(before);
      if (target) {
        const [causality, ...rest] = target.split(" ");
        mapping[causality][rest.join(" ")] = unit ? `${column.plain} [${unit}]` : column.header;
      }
      return { mapping };
    });
  }

  windowRow(facts, r) {
    const [from, to] = r.window ?? [null, null];
    const set = (a, b) => {
      const window = a === null && b === null ? null : [a ?? facts.begin, b ?? facts.end];
      if (window && !(window[0] < window[1])) say("The window must begin before it ends.", "error");
      else this.edit(r.file, { window });
    };
    return el("div", { class: "row window" }, el("span", {}, "Window"),
      number({ id: "from", label: "Begin of the window, in s", value: from, hint: show(facts.begin), onchange: (v) => set(v, to) }), el("span", { "aria-hidden": "true" }, "to"),
      number({ id: "to", label: "End of the window, in s", value: to, hint: show(facts.end), onchange: (v) => set(from, v) }), el("span", {}, "s"),
      el("button", { type: "button", id: "window-view", onclick: () => set(...this.inView(facts)) }, "Take what is in view"),
      r.window ? el("button", { type: "button", id: "window-all", onclick: () => set(null, null) }, "Whole record") : null);
  }

  inView(facts) {
    const [a, b] = this.plot.view, digits = Math.ceil(-Math.log10(facts.step)) + 1, round = (t) => Number(t.toFixed(Math.max(0, Math.min(12, digits))));
    return [round(Math.max(a, facts.begin)), round(Math.min(b, facts.end))];
  }

  look(from, to, facts) {
    const span = Math.max(3 * (to - from), 40 * facts.step);
    this.plot.show((from + to - span) / 2, (from + to + span) / 2);
    this.plot.canvas.focus();
  }

  async draw(file, facts, r, part) {
    const key = this.key(r, part);
    const columns = facts.columns.filter((c) => !c.unreadable && c.least !== null);
    const used = columns.filter((c) => this.target(c));
    const shown = used.length ? used : columns.slice(0, 6);
    let source = this.source;
    if (this.plotted !== key) {
      source = new Remote({ of: "recording", name: file, part });
      try { await source.load(); } catch (error) { this.app.fail(error); return; }
      if (file !== this.chosen) return;
    }
    const panels = shown.map((c) => {
      const name = this.target(c).split(" ").slice(1).join(" ");
      const scale = r.scale[name] ?? r.scale[c.name] ?? 1, offset = r.offset[name] ?? r.offset[c.name] ?? 0;
      return {
        key: c.name, title: c.plain, unit: c.unit === "?" ? "" : c.unit,
        lines: [{ source, name: c.name, color: COLORS[facts.columns.indexOf(c) % COLORS.length], scale, offset, short: c.plain }],
        rings: (c.outliers ?? []).map((t) => [t, ringed(source, c.name, t) * scale + offset]),
      };
    });
    const shades = shown.flatMap((c) => (c.gaps ?? []).map(([from, to]) => ({ panel: c.name, from: from - facts.step / 2, to: to + facts.step / 2, color: "--gap" })));
    const doubts = (this.checks[this.key(r, 0)]?.check.recordings ?? [])[part]?.implausible ?? [];
    shades.push(...doubts.flatMap((d) => d.places ?? []).flatMap((p) => shown.filter((c) => this.target(c).split(" ").slice(1).join(" ") === p.signal)
      .map((c) => ({ panel: c.name, from: p.start, to: p.end, color: "--place" }))));
    this.plot.set({ panels, shades, keep: this.plotted === key });
    this.plot.setWindow(r.window ? [...r.window] : [facts.begin, facts.end], (w) => this.dragged(facts, r.file, w));
    this.source = source;
    this.plotted = key;
  }

  dragged(facts, file, [from, to]) {
    const step = facts.step, snap = (t) => Number((facts.begin + Math.round((t - facts.begin) / step) * step).toPrecision(12));
    const whole = from <= facts.begin + step / 2 && to >= facts.end - step / 2;
    this.edit(file, { window: whole ? null : [snap(from), snap(to)] });
  }
}

// The extreme of a signal that the whole record's coarse view holds nearest to a time.
function ringed(source, name, t) {
  const data = source.whole, signal = data.signals[name];
  let k = 0;
  while (k + 1 < data.time.length && data.time[k + 1] <= t) k++;
  const middle = (signal.low[Math.max(k - 1, 0)] + signal.high[Math.max(k - 1, 0)]) / 2;
  return Math.abs(signal.low[k] - middle) > Math.abs(signal.high[k] - middle) ? signal.low[k] : signal.high[k];
}

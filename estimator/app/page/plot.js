// Signals over time on a canvas: any length at the speed of the screen, since the server sends of every pixel the
// least and the greatest sample. While one drags, what is there is drawn again; finer data follows a moment later.

import { el } from "./dom.js";
import { view } from "./api.js";
import { show } from "./numbers.js";

const LEFT = 62, RIGHT = 12, TOP = 20, GAP = 20, BOTTOM = 30; // CSS pixels
const SETTLED = 70, WHILE_MOVING = 160; // ms, until finer data is asked for
const NEAR = 9; // pixels, to take hold of a window's edge
const ENDS = ["pointerup", "pointercancel", "lostpointercapture"];
const STEP = 0.1, FACTOR = 1.25; // of the view: a key's move, a key's zoom

// Signals on the server. Holds the whole record coarsely and, finely, what is seen and as much on both sides.
export class Remote {
  constructor(query, signals = null) {
    this.query = query;
    this.signals = signals;
    this.whole = this.part = null;
    this.listeners = new Set();
    this.asked = "";
    this.failed = null;
  }

  async load(pixels = 1600) {
    try {
      this.whole = await view(this.full({ buckets: pixels }));
    } catch (error) {
      this.failed = error;
      throw error;
    }
    this.tell();
    return this;
  }

  full(more) {
    return { ...this.query, signals: this.signals && JSON.stringify(this.signals), ...more };
  }

  get begin() { return this.whole ? this.whole.begin : 0; }
  get end() { return this.whole ? this.whole.end : 1; }

  data(from, to) {
    const part = this.part;
    if (part && part.reach[0] <= Math.max(from, this.begin) && part.reach[1] >= Math.min(to, this.end)) return part;
    return this.whole;
  }

  async refine(from, to, pixels) {
    if (!this.whole || !this.whole.envelope) return;
    const span = to - from, reach = [Math.max(from - span, this.begin), Math.min(to + span, this.end)];
    const buckets = Math.ceil(pixels * (reach[1] - reach[0]) / span);
    const asked = `${from} ${to} ${pixels}`;
    if (asked === this.asked) return;
    this.asked = asked;
    try {
      const part = await view(this.full({ from: reach[0], to: reach[1], buckets }));
      if (asked !== this.asked) return;
      this.part = { ...part, reach };
      this.tell();
    } catch { /* what is there stays */ }
  }

  tell() { for (const listener of this.listeners) listener(); }
}

// Signals in this page's memory: { time, signals: name → array }.
export class Local {
  constructor(time, signals) {
    this.listeners = new Set();
    this.set(time, signals);
  }

  set(time, signals) {
    this.time = time;
    this.signals = Object.fromEntries(Object.entries(signals).map(([n, s]) => [n, { low: s, high: s }]));
    for (const listener of this.listeners) listener();
  }

  get begin() { return this.time[0] ?? 0; }
  get end() { return this.time[this.time.length - 1] ?? 1; }
  data() { return { time: this.time, signals: this.signals, envelope: false, count: this.time.length }; }
  async refine() { /* all is here */ }
}

export class Plot {
  // label: what the drawing shows, for those who do not see it; height: pixels of one panel.
  constructor({ label, height = 130, axis = "time [s]", unit = "s" }) {
    this.panelHeight = height;
    this.axis = axis;
    this.unit = unit;
    this.panels = [];
    this.shades = [];
    this.window = null;
    this.onwindow = null;
    this.hover = null;
    this.frames = []; // [instant, ms] of the last drawings
    this.canvas = el("canvas", { tabindex: "0", role: "img", "aria-label": label });
    this.canvas.plot = this;
    this.readout = el("output", { class: "readout", "aria-live": "polite" });
    this.legend = el("span", { class: "legend" });
    const button = (text, title, act) => el("button", { type: "button", title, "aria-label": title, onclick: act }, text);
    this.moving = button("Transient", "Show the part in which the signals move", () => this.show(...this.transient));
    this.moving.hidden = true;
    this.node = el("figure", { class: "plot" },
      el("div", { class: "plotbar" }, this.legend, el("span", { class: "grow" }),
        button("−", "Show more", () => this.zoom(FACTOR * FACTOR)), button("+", "Show less", () => this.zoom(1 / FACTOR / FACTOR)),
        this.moving, button("All", "Show all", () => this.all())),
      this.canvas, this.readout);
    this.edges = [0, 1].map((k) => el("span", {
      class: "edge", tabindex: "0", role: "slider", "aria-label": k ? "End of the window, in s" : "Begin of the window, in s",
      "aria-valuemin": "0", "aria-valuemax": "1", "aria-valuenow": "0", onkeydown: (e) => this.edgeKey(e, k),
      onpointerdown: (e) => this.takeEdge(e, k), hidden: true,
    }));
    this.holder = el("div", { class: "holder" });
    this.canvas.replaceWith(this.holder);
    this.holder.append(this.canvas, ...this.edges);
    this.view = [0, 1];
    this.redraw = () => { if (!this.dirty) { this.dirty = true; requestAnimationFrame(() => this.draw()); } };
    this.listen();
    new ResizeObserver(() => this.redraw()).observe(this.holder);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", this.redraw);
    addEventListener("themechange", this.redraw);
  }

  // panels: [{ title, unit, lines: [{ source, name, color, width, stairs, scale, offset, label }], rings: [[time, value]], zero }]
  // transient: [from, to], which is shown first
  set({ panels, shades = [], keep = false, transient = null }) {
    const before = this.sources();
    if (!keep && this.holding) { clearTimeout(this.edgeTimer); this.holding = false; this.onwindow(this.window); }
    this.transient = transient;
    this.moving.hidden = transient === null;
    this.panels = panels;
    this.shades = shades;
    for (const source of before) source.listeners.delete(this.redraw);
    for (const source of this.sources()) source.listeners.add(this.redraw);
    const named = new Map();
    for (const line of panels.flatMap((p) => p.lines)) if (line.label) named.set(line.label, line.color);
    this.legend.replaceChildren(...[...named].map(([label, color]) =>
      el("span", { class: "key" }, el("i", { style: { background: `var(${color})` } }), label)));
    if (!keep) this.show(...(transient ?? [this.begin, this.end]));
    else this.later();
    this.redraw();
  }

  sources() { return [...new Set(this.panels.flatMap((p) => p.lines.map((l) => l.source)))]; }
  get begin() { return Math.min(...this.sources().map((s) => s.begin)); }
  get end() { return Math.max(...this.sources().map((s) => s.end)); }

  all() { this.show(this.begin, this.end); }

  show(from, to) {
    if (!(to > from) || !Number.isFinite(to - from)) return;
    const least = Math.max((this.end - this.begin) * 1e-7, 1e-12);
    if (to - from < least) { const middle = (from + to) / 2; from = middle - least / 2; to = middle + least / 2; }
    this.view = [from, to];
    this.later();
    this.redraw();
  }

  zoom(factor, at = (this.view[0] + this.view[1]) / 2) {
    const whole = this.end - this.begin, [a, b] = this.view;
    if ((b - a) * factor > 1.5 * whole) { this.all(); return; }
    this.show(at - (at - a) * factor, at + (b - at) * factor);
  }

  pan(share) {
    const [a, b] = this.view, by = share * (b - a);
    if (b + by < this.begin || a + by > this.end) return;
    this.show(a + by, b + by);
  }

  later() {
    const now = performance.now();
    clearTimeout(this.timer);
    const wait = now - (this.refined ?? 0) > WHILE_MOVING ? SETTLED : Math.max(SETTLED, WHILE_MOVING - (now - this.refined));
    this.timer = setTimeout(() => {
      this.refined = performance.now();
      const pixels = Math.max(200, Math.round(this.width * (devicePixelRatio || 1)));
      for (const source of this.sources()) source.refine(this.view[0], this.view[1], pixels);
    }, wait);
  }

  get width() { return Math.max((this.holder.clientWidth || 600) - LEFT - RIGHT, 50); }
  x(t) { return LEFT + (t - this.view[0]) / (this.view[1] - this.view[0]) * this.width; }
  t(x) { return this.view[0] + (x - LEFT) / this.width * (this.view[1] - this.view[0]); }

  setWindow(window, onwindow) {
    if (!this.holding) this.window = window; // what comes in while an edge is being moved is older
    this.onwindow = onwindow;
    this.redraw();
  }

  listen() {
    const canvas = this.canvas;
    canvas.addEventListener("pointerdown", (e) => {
      if (e.button) return;
      canvas.setPointerCapture(e.pointerId);
      this.drag = { x: e.offsetX, view: this.view };
    });
    canvas.addEventListener("pointermove", (e) => {
      if (this.drag) {
        const by = (e.offsetX - this.drag.x) / this.width * (this.drag.view[1] - this.drag.view[0]);
        this.show(this.drag.view[0] - by, this.drag.view[1] - by);
      }
      this.point(e.offsetX >= LEFT ? this.t(e.offsetX) : null);
    });
    for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, () => { this.drag = null; });
    canvas.addEventListener("pointerleave", () => this.point(null));
    canvas.addEventListener("dblclick", () => this.all());
    canvas.addEventListener("wheel", (e) => {
      if (document.activeElement !== canvas && !e.ctrlKey) return; // the page scrolls until the plot was clicked
      e.preventDefault();
      this.zoom(e.deltaY > 0 ? FACTOR : 1 / FACTOR, this.t(e.offsetX));
    }, { passive: false });
    canvas.addEventListener("keydown", (e) => {
      const keys = {
        ArrowLeft: () => (e.shiftKey ? this.step(-1) : this.pan(-STEP)), ArrowRight: () => (e.shiftKey ? this.step(1) : this.pan(STEP)),
        "+": () => this.zoom(1 / FACTOR), "-": () => this.zoom(FACTOR), "=": () => this.zoom(1 / FACTOR), Home: () => this.all(),
        PageUp: () => this.pan(-1), PageDown: () => this.pan(1), Escape: () => this.point(null),
      };
      if (!keys[e.key] || e.altKey || e.ctrlKey || e.metaKey) return;
      e.preventDefault();
      keys[e.key]();
    });
  }

  step(by) {
    const from = this.hover ?? (this.view[0] + this.view[1]) / 2;
    this.point(Math.min(Math.max(from + by * (this.view[1] - this.view[0]) / 100, this.view[0]), this.view[1]));
  }

  edgeKey(e, k) {
    const span = this.view[1] - this.view[0];
    const by = { ArrowLeft: -0.01, ArrowRight: 0.01, ArrowDown: -0.01, ArrowUp: 0.01, PageDown: -0.1, PageUp: 0.1 }[e.key];
    const to = e.key === "Home" ? this.begin : e.key === "End" ? this.end : by === undefined ? null : this.window[k] + by * span;
    if (to === null) return;
    e.preventDefault();
    this.holding = true;
    this.moveEdge(k, to);
    clearTimeout(this.edgeTimer);
    this.edgeTimer = setTimeout(() => { this.holding = false; this.onwindow(this.window); }, 400);
  }

  takeEdge(e, k) {
    const edge = this.edges[k], left = this.holder.getBoundingClientRect().left;
    edge.setPointerCapture(e.pointerId);
    edge.focus();
    e.preventDefault();
    this.holding = true;
    const move = (m) => this.moveEdge(k, this.t(m.clientX - left));
    const done = () => {
      for (const end of ENDS) edge.removeEventListener(end, done);
      edge.removeEventListener("pointermove", move);
      this.holding = false;
      this.onwindow(this.window);
    };
    edge.addEventListener("pointermove", move);
    for (const end of ENDS) edge.addEventListener(end, done); // where it ends without being let go, too
  }

  moveEdge(k, to) {
    const least = (this.end - this.begin) / 1000, window = [...this.window];
    window[k] = Math.min(Math.max(to, this.begin), this.end);
    if (k === 0) window[0] = Math.min(window[0], window[1] - least);
    else window[1] = Math.max(window[1], window[0] + least);
    this.window = window;
    this.redraw();
  }

  point(t) {
    this.hover = t;
    const parts = [];
    if (t !== null) {
      parts.push(el("b", {}, `${show(t, 6)} ${this.unit}`));
      for (const panel of this.panels) {
        for (const line of panel.lines) {
          const data = line.source.data(...this.view), signal = data && data.signals[line.name];
          if (!signal) continue;
          const k = nearest(data, t), [low, high] = [signal.low[k], signal.high[k]].map((y) => value(line, y)).sort((a, b) => a - b);
          const text = low === high ? show(high) : `${show(low, 4)} … ${show(high, 4)}`;
          parts.push(el("span", {}, el("i", { style: { background: `var(${line.color})` } }),
            `${line.short ?? line.label ?? panel.title} ${text} ${panel.unit ?? ""}`));
        }
      }
    }
    this.readout.replaceChildren(...parts);
    this.redraw();
  }

  draw() {
    const began = performance.now();
    this.dirty = false;
    const dpr = devicePixelRatio || 1, width = this.holder.clientWidth, h = this.panelHeight;
    const height = this.panels.length * (h + GAP) - GAP + TOP + BOTTOM;
    if (!width || !this.panels.length) return;
    const canvas = this.canvas, pixelWidth = Math.round(width * dpr), pixelHeight = Math.round(height * dpr);
    if (canvas.width !== pixelWidth || canvas.height !== pixelHeight) {
      canvas.width = pixelWidth;
      canvas.height = pixelHeight;
      canvas.style.height = `${height}px`;
    }
    const c = canvas.getContext("2d"), style = getComputedStyle(document.documentElement);
    const color = (name) => style.getPropertyValue(name).trim();
    c.setTransform(dpr, 0, 0, dpr, 0, 0);
    c.clearRect(0, 0, width, height);
    c.font = "12px system-ui, sans-serif";
    const right = LEFT + this.width;
    this.panels.forEach((panel, p) => this.drawPanel(c, color, panel, TOP + p * (h + GAP), h, right));
    const bottom = height - BOTTOM;
    c.fillStyle = color("--muted");
    c.textAlign = "center";
    c.textBaseline = "top";
    for (const t of ticks(this.view[0], this.view[1], Math.max(2, this.width / 110))) {
      if (this.x(t) > LEFT - 1 && this.x(t) < right - 8) c.fillText(show(t, 7), this.x(t), bottom + 4);
    }
    c.textAlign = "right";
    c.fillText(this.axis, right, bottom + 17);
    this.drawWindow(c, color, TOP, bottom, right);
    if (this.hover !== null) {
      c.strokeStyle = color("--muted");
      c.lineWidth = 1;
      c.setLineDash([3, 3]);
      c.beginPath();
      c.moveTo(this.x(this.hover), TOP);
      c.lineTo(this.x(this.hover), bottom);
      c.stroke();
      c.setLineDash([]);
    }
    this.frames.push([began, performance.now() - began]);
    if (this.frames.length > 600) this.frames.splice(0, 300);
  }

  drawPanel(c, color, panel, top, h, right) {
    const [a, b] = this.view;
    let low = Infinity, high = -Infinity;
    const found = panel.lines.map((line) => {
      const data = line.source.data(a, b), signal = data && data.signals[line.name];
      if (!signal) return null;
      const from = Math.max(lower(data.time, a) - 1, 0), to = Math.min(lower(data.time, b) + 1, data.time.length);
      for (let k = from; k < to; k++) {
        const y0 = value(line, signal.low[k]), y1 = value(line, signal.high[k]);
        if (y0 < low) low = y0;
        if (y1 < low) low = y1;
        if (y0 > high) high = y0;
        if (y1 > high) high = y1;
      }
      return { line, data, signal, from, to };
    });
    if (!(high >= low)) { low = 0; high = 1; }
    if (panel.zero) { low = Math.min(low, 0); high = Math.max(high, 0); }
    const margin = 0.06 * (high - low) || Math.abs(high) * 0.1 || 1;
    low -= margin;
    high += margin;
    const y = (v) => top + h - (v - low) / (high - low) * h;
    c.fillStyle = color("--plot");
    c.fillRect(LEFT, top, right - LEFT, h);
    c.save();
    c.beginPath();
    c.rect(LEFT, top, right - LEFT, h);
    c.clip();
    for (const shade of this.shades) {
      if (shade.panel !== undefined && shade.panel !== panel.key) continue;
      c.fillStyle = color(shade.color);
      c.fillRect(this.x(shade.from), top, Math.max(this.x(shade.to) - this.x(shade.from), 4), h);
    }
    c.strokeStyle = color("--grid");
    c.lineWidth = 1;
    const rows = ticks(low, high, h > 90 ? 4 : 3);
    for (const v of rows) line(c, LEFT, Math.round(y(v)) + 0.5, right, Math.round(y(v)) + 0.5);
    for (const t of ticks(a, b, Math.max(2, this.width / 110))) line(c, Math.round(this.x(t)) + 0.5, top, Math.round(this.x(t)) + 0.5, top + h);
    for (const one of found) if (one) this.drawLine(c, color, one, y);
    c.strokeStyle = c.fillStyle = color("--refused");
    c.lineWidth = 1.5;
    for (const [t, v] of panel.rings ?? []) {
      if (t < a || t > b) continue;
      c.beginPath();
      c.arc(this.x(t), y(v), 5, 0, 7);
      c.stroke();
    }
    c.restore();
    c.fillStyle = color("--muted");
    c.textAlign = "right";
    c.textBaseline = "middle";
    for (const v of rows) c.fillText(show(v, 4), LEFT - 6, y(v));
    c.fillStyle = color("--text");
    c.textAlign = "left";
    c.textBaseline = "bottom";
    c.fillText(panel.unit ? `${panel.title} [${panel.unit}]` : panel.title, LEFT, top - 3);
  }

  drawLine(c, color, one, y) {
    if (one.data.envelope) this.drawBand(c, color, one, y);
    else this.drawSamples(c, color, one, y);
  }

  // Of many samples, what lies between the least and the greatest, as an area that is never thinner than the line.
  drawBand(c, color, { line: own, data, signal, from, to }, y) {
    const half = (own.width ?? 1.4) / 2;
    c.fillStyle = color(own.color);
    c.beginPath();
    for (let k = from; k < to;) {
      while (k < to && signal.low[k] !== signal.low[k]) k++;
      const first = k;
      while (k < to && signal.low[k] === signal.low[k]) k++;
      if (k === first) continue;
      for (let j = first; j < k; j++) {
        const top = Math.min(y(value(own, signal.low[j])), y(value(own, signal.high[j]))) - half, x = this.x(data.time[j]);
        if (j === first) c.moveTo(x - half, top);
        c.lineTo(x, top);
      }
      for (let j = k - 1; j >= first; j--) {
        c.lineTo(this.x(data.time[j]) + (j === first ? half : 0), Math.max(y(value(own, signal.low[j])), y(value(own, signal.high[j]))) + half);
      }
      c.closePath();
    }
    c.fill();
  }

  drawSamples(c, color, { line: own, data, signal, from, to }, y) {
    c.strokeStyle = color(own.color);
    c.lineWidth = own.width ?? 1.4;
    c.lineJoin = to - from < 2000 ? "round" : "bevel";
    c.beginPath();
    let open = false, last = 0;
    for (let k = from; k < to; k++) {
      const v = value(own, signal.low[k]), x = this.x(data.time[k]);
      if (v !== v) { open = false; continue; }
      if (!open) c.moveTo(x, y(v));
      else if (own.stairs) c.lineTo(x, last);
      c.lineTo(x, last = y(v));
      open = true;
    }
    c.stroke();
    if (own.dots === false || to - from >= this.width / 6) return;
    c.fillStyle = color(own.color);
    for (let k = from; k < to; k++) {
      const v = value(own, signal.low[k]);
      if (v === v) c.fillRect(this.x(data.time[k]) - 2, y(v) - 2, 4, 4);
    }
  }

  drawWindow(c, color, top, bottom, right) {
    const has = this.window !== null && this.onwindow !== null;
    this.edges.forEach((edge, k) => {
      edge.hidden = !has;
      if (!has) return;
      const x = this.x(this.window[k]);
      edge.hidden = x < LEFT - NEAR || x > right + NEAR;
      Object.assign(edge.style, { left: `${x}px`, top: `${top}px`, height: `${bottom - top}px` });
      edge.setAttribute("aria-valuemin", this.begin);
      edge.setAttribute("aria-valuemax", this.end);
      edge.setAttribute("aria-valuenow", show(this.window[k], 7));
    });
    if (!has) return;
    c.fillStyle = color("--veil");
    const [from, to] = this.window.map((t) => Math.min(Math.max(this.x(t), LEFT), right));
    c.fillRect(LEFT, top, from - LEFT, bottom - top);
    c.fillRect(to, top, right - to, bottom - top);
  }
}

const value = (line, y) => y * (line.scale ?? 1) + (line.offset ?? 0);

function line(c, x0, y0, x1, y1) {
  c.beginPath();
  c.moveTo(x0, y0);
  c.lineTo(x1, y1);
  c.stroke();
}

// The first index whose time is not below t.
function lower(time, t) {
  let low = 0, high = time.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (time[middle] < t) low = middle + 1;
    else high = middle;
  }
  return low;
}

function nearest(data, t) {
  const k = lower(data.time, t), n = data.time.length;
  if (data.envelope) return Math.max(k - 1, 0);
  if (k === 0 || k >= n) return Math.min(k, n - 1);
  return t - data.time[k - 1] < data.time[k] - t ? k - 1 : k;
}

export function ticks(low, high, most) {
  const raw = (high - low) / Math.max(most, 1), power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((m) => m * power).find((s) => s >= raw * 0.999) ?? raw;
  const found = [];
  for (let k = Math.ceil(low / step); k * step <= high * (1 + 1e-12) + 1e-300 && found.length < 50; k++) {
    found.push(Number((k * step).toPrecision(12)));
  }
  return found;
}

// Measured beside simulated signals as panels of a plot: inputs on top, then an output each.

const TITLES = { V: "voltage", A: "current", "rad/s": "speed", rad: "angle", "N.m": "torque", K: "temperature", W: "power" };

// names: of the signals that a source has, "input v", "measured i", …
export function panelsOf(source, names, units, { simulated = "simulated", residuals = false } = {}) {
  const of = (kind) => names.filter((n) => n.startsWith(`${kind} `)).map((n) => n.slice(kind.length + 1));
  const title = (name) => (TITLES[units[name]] && TITLES[units[name]] !== name ? `${TITLES[units[name]]} ${name}` : name);
  const panels = of("input").map((name) => ({
    key: name, title: title(name), unit: units[name], zero: true,
    lines: [{ source, name: `input ${name}`, color: "--c1", stairs: true, dots: false, short: name }],
  }));
  for (const name of of("measured")) {
    const lines = [{ source, name: `measured ${name}`, color: "--measured", width: 2.2, label: "measured" }];
    if (names.includes(`simulated ${name}`)) lines.push({ source, name: `simulated ${name}`, color: "--simulated", width: 1.6, dots: false, label: simulated });
    panels.push({ key: name, title: title(name), unit: units[name], lines });
    if (residuals && names.includes(`residual ${name}`)) {
      panels.push({ key: `residual ${name}`, title: `residual of ${name}`, unit: units[name], zero: true,
        lines: [{ source, name: `residual ${name}`, color: "--residual", width: 1, label: "residual" }] });
    }
  }
  return panels;
}

/* What the lines of a chart are worth where the pointer is; the numbers are read from the lines themselves. */
"use strict";
const points = new WeakMap();
const read = (path) => {
  if (!points.has(path)) {
    const found = [];
    let x = 0, y = 0;
    for (const [, command, rest] of path.getAttribute("d").matchAll(/([Mlh])([^Mlh]*)/g)) {
      const numbers = (rest.match(/-?\d+/g) || []).map(Number);
      if (command === "h") continue;
      if (command === "M") { x = y = 0; found.push(null); }
      for (let k = 0; k < numbers.length; k += 2) found.push([x += numbers[k], y += numbers[k + 1]]);
    }
    points.set(path, found);
  }
  return points.get(path);
};
const number = (value) => Number(value.toPrecision(4)).toString();
for (const chart of document.querySelectorAll("svg.chart")) {
  const { first, last, left, width } = chart.dataset, cursor = chart.querySelector(".cursor");
  const said = chart.closest("figure").querySelector(".readout"), usual = said ? said.textContent : "";
  chart.addEventListener("pointermove", (event) => {
    const point = new DOMPoint(event.clientX, event.clientY).matrixTransform(chart.getScreenCTM().inverse());
    const part = (point.x - left) / width;
    if (part < 0 || part > 1) return;
    cursor.setAttribute("transform", `translate(${point.x} 0)`);
    cursor.style.visibility = "visible";
    const told = [`t = ${number(+first + part * (last - first))} s`];
    for (const path of chart.querySelectorAll("path[data-name]")) {
      const near = read(path).filter((p) => p).reduce((a, b) =>
        Math.abs(b[0] - 10 * part * width) < Math.abs(a[0] - 10 * part * width) ? b : a, [Infinity, 0]);
      const { name, low, high, height } = path.dataset, [, what, unit] = name.match(/^(.*) \[(.*)\]$/);
      told.push(`${what}: ${number(+high - (near[1] / height) * (high - low))} ${unit}`);
    }
    said.textContent = told.join(" · ");
  });
  chart.addEventListener("pointerleave", () => { cursor.style.visibility = "hidden"; said.textContent = usual; });
}

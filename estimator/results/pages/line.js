/* Filters by outcome and name; the motor and its value where the pointer is. */
"use strict";
const boxes = [...document.querySelectorAll(".filters input[type=checkbox]")], find = document.getElementById("find");
const filter = () => {
  const wanted = new Set(boxes.filter((box) => box.checked).map((box) => box.value));
  const word = find.value.trim().toLowerCase();
  const fits = (name, outcome) => wanted.has(outcome) && name.toLowerCase().includes(word);
  for (const row of document.querySelectorAll(".cases tr[data-case]"))
    row.classList.toggle("hidden", !fits(`${row.dataset.name} ${row.dataset.case}`, row.dataset.outcome));
  for (const row of document.querySelectorAll(".grid-of-motors tr")) {
    let any = false;
    for (const cell of row.querySelectorAll("td")) {
      const shown = fits(`${row.dataset.name} ${cell.dataset.case}`, cell.dataset.outcome);
      cell.classList.toggle("hidden", !shown);
      any ||= shown;
    }
    row.classList.toggle("hidden", !any);
  }
};
const keep = () => {
  const said = new URLSearchParams({ without: boxes.filter((box) => !box.checked).map((box) => box.value).join(), find: find.value });
  history.replaceState(null, "", `#${said}`);
  filter();
};
const said = new URLSearchParams(location.hash.slice(1)), without = (said.get("without") ?? "").split(",");
for (const box of boxes) box.checked = !without.includes(box.value);
find.value = said.get("find") ?? "";
filter();
for (const box of boxes) box.addEventListener("change", keep);
find.addEventListener("input", keep);
const demand = document.getElementById("demand");
if (demand) for (const thing of document.querySelectorAll("[data-case]")) for (const when of ["pointerenter", "focusin"]) thing.addEventListener(when, () => {
  demand.textContent = `${demand.dataset.command} --resume --report-of '${thing.dataset.case.replaceAll("'", "'\\''")}'`;
});
const renew = Number(document.body.dataset.renew ?? 0);
if (renew) setTimeout(() => location.reload(), 1000 * renew);
const all = JSON.parse(document.getElementById("points").textContent);
document.querySelectorAll("svg.chart").forEach((chart, k) => {
  const { points, values, unit } = all[k], { left, width } = chart.dataset;
  const said = chart.closest("figure").querySelector(".readout");
  chart.addEventListener("pointermove", (event) => {
    const point = new DOMPoint(event.clientX, event.clientY).matrixTransform(chart.getScreenCTM().inverse());
    const at = Math.floor(((point.x - left) / width) * points.length);
    if (at >= 0 && at < points.length) said.textContent = `${points[at]}: ${values[at]} ${unit}`;
  });
  chart.addEventListener("pointerleave", () => { said.textContent = "\u00a0"; });
});

// Inputs for numbers, in German or English; what is typed is checked where it stands, and shown as it was understood.

import { el } from "./dom.js";
import { parse, show } from "./numbers.js";

// id: a stable name, so that the focus survives a change; onchange: told a number, or null for an empty field.
export function number({ id, label, value, hint = "", required = false, onchange, least = null, whole = false, width = "6.5em" }) {
  const input = el("input", {
    id, type: "text", inputmode: "decimal", autocomplete: "off", spellcheck: "false", "aria-label": label,
    placeholder: hint, value: value === null || value === undefined ? "" : show(value, 7), style: { width },
  });
  input.addEventListener("input", () => { input.dataset.dirty = "1"; input.setCustomValidity(""); input.removeAttribute("aria-invalid"); });
  input.addEventListener("change", () => {
    const given = parse(input.value);
    const wrong = Number.isNaN(given) ? `${input.value} is no number; write such as 0.013 or 0,013`
      : given === null ? (required ? "a number is needed here" : "")
        : least !== null && given < least ? `it must be at least ${least}`
          : whole && given !== Math.round(given) ? "it must be a whole number" : "";
    input.setCustomValidity(wrong);
    if (wrong) {
      input.setAttribute("aria-invalid", "true");
      input.reportValidity();
      return;
    }
    delete input.dataset.dirty;
    input.value = given === null ? "" : show(given, 7);
    onchange(given);
  });
  input.addEventListener("keydown", (e) => {
    if (e.key === "Enter") input.dispatchEvent(new Event("change"));
    if (e.key === "Escape") { input.value = value === null || value === undefined ? "" : show(value, 7); delete input.dataset.dirty; }
  });
  return input;
}

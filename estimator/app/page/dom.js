// Elements made of names and texts. A text is never read as HTML: names of files and columns come from anyone.

export function el(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (value === null || value === undefined || value === false) continue;
    if (name.startsWith("on")) made.addEventListener(name.slice(2), value);
    else if (name === "value" || name === "checked" || name === "disabled" || name === "selected") made[name] = value;
    else if (name === "style") Object.assign(made.style, value);
    else made.setAttribute(name, value === true ? "" : value);
  }
  made.append(...children.flat(Infinity).filter((c) => c !== null && c !== undefined && c !== false));
  return made;
}

export function select(attributes, options, chosen) {
  return el("select", attributes, options.map(([value, text]) =>
    el("option", { value, selected: value === chosen }, text)));
}

// Put other content into an element; an element that stays, or the one of the same id, keeps the keyboard's focus, and
// its caret.
export function replace(parent, ...children) {
  const focused = document.activeElement;
  const inside = focused && focused !== document.body && parent.contains(focused), held = inside && focused.id ? focused.id : null;
  const caret = held && focused.selectionStart !== undefined ? [focused.selectionStart, focused.selectionEnd] : null;
  const typed = [...parent.querySelectorAll("input[data-dirty]")].map((i) => [i.id, i.value, i.getAttribute("aria-invalid")]);
  parent.replaceChildren(...children.flat(Infinity).filter(Boolean));
  for (const [id, value, invalid] of typed) { // what was typed and not taken yet stays
    const input = document.getElementById(id);
    if (!input) continue;
    input.value = value;
    input.dataset.dirty = "1";
    if (invalid) input.setAttribute("aria-invalid", invalid);
  }
  if (inside && focused.isConnected) { focused.focus({ preventScroll: true }); return; } // it was taken out and put back
  if (!held) return;
  const again = document.getElementById(held);
  if (!again) return;
  again.focus({ preventScroll: true });
  if (caret && again.setSelectionRange) { try { again.setSelectionRange(...caret); } catch { /* not a text */ } }
}

let said = 0;
export function say(text, kind = "info") {
  const banner = document.getElementById("banner");
  const mine = ++said;
  banner.replaceChildren(el("div", { class: `say ${kind}` }, text,
    el("button", { type: "button", "aria-label": "Close this message", onclick: () => banner.replaceChildren() }, "×")));
  if (kind === "info") setTimeout(() => { if (mine === said) banner.replaceChildren(); }, 6000);
}

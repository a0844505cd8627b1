// Numbers as people type them, in German and in English, and as the page shows them.

// "3.14", "3,14", "1.234,5", "1,234.5", "1 234,5", "1e-3", "−2" → number; null where it is empty; NaN where it is none.
// The last of two kinds of separator is the decimal one; one that stands alone is decimal; one that comes twice is not.
export function parse(text) {
  let s = text.trim().replace(/[\s\u00a0\u202f'’_]/g, "").replace(/[−–]/g, "-");
  if (s === "") return null;
  const comma = s.lastIndexOf(","), dot = s.lastIndexOf(".");
  if (comma >= 0 && dot >= 0) {
    const [thousand, decimal] = comma > dot ? [".", ","] : [",", "."];
    if (s.split(decimal).length > 2 || !grouped(s.split(decimal)[0], thousand)) return NaN;
    s = s.replaceAll(thousand, "").replace(decimal, ".");
  } else if (s.split(",").length > 2) {
    if (!grouped(s, ",")) return NaN;
    s = s.replaceAll(",", "");
  } else if (s.split(".").length > 2) {
    if (!grouped(s, ".")) return NaN;
    s = s.replaceAll(".", "");
  } else s = s.replace(",", ".");
  return /^[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d{1,3})?$/i.test(s) && Number.isFinite(Number(s)) ? Number(s) : NaN;
}

const grouped = (whole, by) => /^[+-]?\d{1,3}$/.test(whole.split(by)[0]) && whole.split(by).slice(1).every((g) => /^\d{3}$/.test(g));

// At most so many digits, without trailing zeros, with a power of ten where that is shorter.
export function show(value, digits = 5) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  if (value === 0) return "0";
  const size = Math.abs(value);
  if (size >= 1e-3 && size < 1e6) return String(Number(value.toPrecision(digits)));
  const [mantissa, power] = value.toExponential(digits - 1).split("e");
  return `${Number(mantissa)}e${Number(power)}`;
}

// A number and its standard error, the error with two digits, the value to the same place.
export function withError(value, error) {
  if (value === null || value === undefined) return ["–", ""];
  if (error === null || error === undefined || !(error > 0)) return [show(value, 6), ""];
  const power = Math.abs(value) >= 1e-3 && Math.abs(value) < 1e6 ? 0 : Math.floor(Math.log10(Math.abs(value) || 1));
  const place = Math.floor(Math.log10(error)) - 1;
  const decimals = Math.max(0, Math.min(12, power - place));
  const unit = 10 ** power;
  const tail = power ? `e${power}` : "";
  return [(value / unit).toFixed(decimals) + tail, (error / unit).toFixed(decimals) + tail];
}

export function percent(part, whole, digits = 2) {
  if (!Number.isFinite(part) || !Number.isFinite(whole) || whole === 0 || part === null) return "";
  const value = 100 * part / Math.abs(whole);
  return `${show(value, digits)} %`;
}

export function duration(seconds) {
  if (seconds === null || seconds === undefined) return "";
  if (seconds < 10) return `${seconds.toFixed(1)} s`;
  if (seconds < 99.5) return `${seconds.toFixed(0)} s`;
  return seconds < 5970 ? `${(seconds / 60).toFixed(0)} min` : `${(seconds / 3600).toFixed(1)} h`;
}

export const count = (n) => String(n).replace(/\B(?=(\d{3})+$)/g, "\u202f");

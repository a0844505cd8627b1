// Requests to the server that served this page; the token is part of the page's own address.

const base = new URL(".", location.href).href;

export class Refused extends Error {
  constructor(message, status) { super(message); this.status = status; }
}

export function address(path, query = {}) {
  const url = new URL(`api/${path}`, base);
  for (const [name, value] of Object.entries(query)) {
    if (value !== null && value !== undefined) url.searchParams.set(name, value);
  }
  return url.href;
}

async function answer(path, query, init) {
  let response;
  try {
    response = await fetch(address(path, query), { credentials: "omit", ...init });
  } catch {
    throw new Refused("The app does not answer: it was ended, or its terminal was closed.", 0);
  }
  if (response.ok) return response;
  let text = `status ${response.status}`;
  try { text = (await response.json()).error; } catch { /* no JSON */ }
  throw new Refused(text, response.status);
}

export const get = async (path, query) => (await answer(path, query)).json();

export const post = async (path, body, query) => (await answer(path, query, {
  method: "POST",
  headers: { "Content-Type": body instanceof Blob ? "application/octet-stream" : "application/json" },
  body: body instanceof Blob ? body : JSON.stringify(body ?? {}),
})).json();

// A stretch of signals: { time, signals: name → { low, high } }; low is high where samples are given one by one.
export async function view(query) {
  const content = await (await answer("view", query)).arrayBuffer();
  const length = new DataView(content).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(content, 4, length)));
  let at = 4 + length;
  const time = new Float64Array(content, at, header.count);
  at += 8 * header.count;
  const block = () => { const found = new Float32Array(content, at, header.count); at += 4 * header.count; return found; };
  const signals = {};
  for (const name of header.names) {
    const low = block();
    signals[name] = { low, high: header.envelope ? block() : low };
  }
  return { ...header, time, signals };
}

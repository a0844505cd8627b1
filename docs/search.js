/* Search over all pages, without a server: the index is a script, so that it is read from a disk as well. */
addEventListener("DOMContentLoaded", () => {
  "use strict";
  const MOST = 20, BEFORE = 60, AFTER = 140, LONG = 2000; // results; characters of an excerpt, and of a long text
  const input = document.getElementById("mkdocs-search-query");
  const list = document.getElementById("mkdocs-search-results");
  if (!input || !list) return;

  let entries = null;
  const load = () => {
    if (entries) return;
    entries = [];
    const script = document.createElement("script");
    script.src = base_url + "/search/search_index.js";
    script.onload = () => {
      entries = window.searchIndex.docs.map((d) => ({ ...d, low: d.text.toLowerCase(), head: d.title.toLowerCase() }));
      show();
    };
    document.head.append(script);
  };

  /* All words must occur, and each counts: a title ten times a text, and a short text more than a long one. */
  const score = (entry, words) => {
    let total = 1;
    for (const word of words) {
      const within = Math.min(entry.low.split(word).length - 1, 9) / (1 + entry.low.length / LONG);
      const hits = 10 * (entry.head.split(word).length - 1) + within;
      if (!hits) return 0;
      total *= hits;
    }
    return total;
  };

  const excerpt = (entry, word) => {
    const at = Math.max(entry.low.indexOf(word), 0);
    const from = Math.max(at - BEFORE, 0), to = at + AFTER;
    return (from ? "…" : "") + entry.text.slice(from, to) + (to < entry.text.length ? "…" : "");
  };

  const show = () => {
    const words = input.value.toLowerCase().split(/\s+/).filter((word) => word.length > 1);
    const found = words.length ? entries.map((e) => [score(e, words), e]).filter(([s]) => s) : [];
    found.sort((a, b) => b[0] - a[0]);
    list.replaceChildren(...found.slice(0, MOST).map(([, entry]) => {
      const item = document.createElement("article"), title = document.createElement("h3");
      const link = document.createElement("a"), text = document.createElement("p");
      link.href = base_url + "/" + entry.location;
      link.textContent = entry.title;
      text.textContent = excerpt(entry, words[0]);
      title.append(link);
      item.append(title, text);
      return item;
    }));
    if (words.length && !found.length) list.textContent = list.dataset.noResultsText;
  };

  input.form.addEventListener("submit", (event) => event.preventDefault());
  input.addEventListener("focus", load);
  input.addEventListener("input", () => { load(); show(); });
  const asked = new URLSearchParams(location.search).get("q");
  if (asked) { input.value = asked; load(); }
});

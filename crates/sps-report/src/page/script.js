"use strict";

// A click on the header of a column sorts its table: up, then down, then as it was.
for (const table of document.querySelectorAll(".scroll table")) {
  const body = table.tBodies[0];
  const rows = [...body.rows];
  const headers = [...table.tHead.rows[0].cells];

  const rank = (row, at) => {
    const cell = row.cells[at];
    return "rank" in cell.dataset ? Number(cell.dataset.rank) : cell.textContent;
  };
  const missing = (value) => value === "" || value === "–";
  const compare = (a, b) => {
    if (missing(a) || missing(b)) return missing(a) - missing(b);
    if (typeof a === "number" && typeof b === "number") return a - b;
    return String(a).localeCompare(String(b), "en", { numeric: true });
  };
  const ascending = (at) => (a, b) => compare(rank(a, at), rank(b, at));
  // What is missing stays last.
  const descending = (at) => (a, b) => {
    const [x, y] = [rank(a, at), rank(b, at)];
    return missing(x) || missing(y) ? compare(x, y) : compare(y, x);
  };

  headers.forEach((header, at) => {
    const button = document.createElement("button");
    button.type = "button";
    button.title = "sort";
    button.append(...header.childNodes);
    header.append(button);
    button.addEventListener("click", () => {
      const next = { ascending: "descending", descending: null }[header.ariaSort];
      const order = next === undefined ? "ascending" : next;
      for (const other of headers) other.removeAttribute("aria-sort");
      if (order) header.setAttribute("aria-sort", order);
      const by = { ascending: ascending(at), descending: descending(at) }[order];
      body.append(...(by ? rows.toSorted(by) : rows));
    });
  });
}

// A link opens the section that it leads to; on paper all are open.
const open = (section) => {
  for (const details of section?.querySelectorAll("details") ?? []) details.open = true;
};
const follow = () => open(document.getElementById(location.hash.slice(1)));
addEventListener("hashchange", follow);
addEventListener("beforeprint", () => open(document));
follow();

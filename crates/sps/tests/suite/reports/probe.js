// What is there, and what is wrong with how it is laid out.
const problems = [];
const check = (holds, problem) => holds || problems.push(problem);
const root = document.documentElement;
const inside = (element) => element.getBoundingClientRect().right <= innerWidth + 0.5;

check(root.scrollWidth <= innerWidth, `the page is ${root.scrollWidth} pixels wide`);

const tables = [...document.querySelectorAll(".scroll table")];
for (const table of tables) {
  const name = table.closest("section").id;
  const box = table.closest(".scroll");
  check(inside(box), `${name} is cut`);
  const scrolls = getComputedStyle(box).overflowX === "auto";
  check(scrolls || table.offsetWidth <= box.clientWidth, `${name} does not scroll`);
}
for (const cell of document.querySelectorAll("td, th")) {
  check(cell.scrollWidth <= cell.clientWidth + 1, `"${cell.textContent}" is cut`);
}
for (const card of document.querySelectorAll("article")) {
  check(inside(card) && card.scrollWidth <= card.clientWidth, `${card.textContent} is cut`);
}

const figures = [...document.querySelectorAll("figure > svg")];
for (const figure of figures) {
  const name = figure.closest("section").id;
  const { width, height } = figure.getBoundingClientRect();
  check(width > 200 && height > 50, `${name} is missing: ${width} x ${height}`);
  check(inside(figure), `${name} is cut`);
  const all = figure.getBBox();
  const view = figure.viewBox.baseVal;
  check(all.width <= view.width + 2 && all.height <= view.height + 2, `${name} is larger than its view`);
}

for (const image of document.images) {
  check(image.complete && image.naturalWidth > 0, `a picture is missing: ${image.alt}`);
  check(inside(image), `a picture is cut: ${image.alt}`);
}
for (const link of document.querySelectorAll("nav a")) {
  check(document.querySelector(link.getAttribute("href")), `nothing at ${link.getAttribute("href")}`);
}

// Up, down, and as it was.
const [means] = tables;
const headers = [...means.tHead.rows[0].cells];
const at = headers.findIndex((header) => header.textContent.startsWith("R²"));
const ranks = () => [...means.tBodies[0].rows].map((row) => Number(row.cells[at].dataset.rank));
const before = ranks();
const sorted = before.toSorted((a, b) => a - b);
for (const wanted of [sorted, sorted.toReversed(), before]) {
  headers[at].querySelector("button").click();
  check(String(ranks()) === String(wanted), `R² is ${ranks()}, expected ${wanted}`);
}

({
  tables: tables.length,
  figures: figures.length,
  pictures: document.images.length,
  dark: matchMedia("(prefers-color-scheme: dark)").matches,
  problems: problems.join("; "),
});

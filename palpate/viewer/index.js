"use strict";
// The page of a run: tables are sorted by a click on a head, objects are those that have all words of the filter.
(() => {
  const value = (row, column) => {
    const cell = row.cells[column];
    if (cell.dataset.value !== undefined) return Number(cell.dataset.value);
    return cell.innerText.trim();
  };
  const compare = (a, b) =>
    typeof a === "number" && typeof b === "number" ? a - b : String(a).localeCompare(String(b), "en", { numeric: true });
  const missing = (x) => x === "" || x === "–" || Number.isNaN(x);
  function sort(table, head) {
    const heads = [...table.tHead.rows[0].cells], column = heads.indexOf(head);
    const falling = head.getAttribute("aria-sort") === "ascending";
    for (const each of heads) each.removeAttribute("aria-sort");
    head.setAttribute("aria-sort", falling ? "descending" : "ascending");
    const body = table.tBodies[0];
    const rows = [...body.rows].map((row) => ({ row, key: value(row, column), last: row.matches(".total") }));
    // Totals and missing values stay at the end.
    rows.sort((a, b) =>
      a.last - b.last || missing(a.key) - missing(b.key) || (falling ? -1 : 1) * compare(a.key, b.key));
    body.append(...rows.map(({ row }) => row));
  }
  for (const table of document.querySelectorAll("table"))
    for (const head of table.tHead.rows[0].cells)
      head.addEventListener("click", () => sort(table, head));

  const filter = document.getElementById("filter");
  const objects = [...document.querySelectorAll("figure[data-words]")];
  const count = document.getElementById("count");
  filter?.addEventListener("input", () => {
    const words = filter.value.toLowerCase().split(/\s+/).filter(Boolean);
    for (const each of objects) each.hidden = !words.every((word) => each.dataset.words.includes(word));
    count.textContent = words.length ? `${objects.filter((each) => !each.hidden).length} of ${objects.length}` : "";
  });
  document.body.dataset.state = "ready";
})();

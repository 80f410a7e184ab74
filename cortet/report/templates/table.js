// Sorts and filters the table of the cohort page, and shows the columns that are chosen. Without scripts it is the same
// table, in its first order, with all columns.
"use strict";
(() => {
  const table = document.getElementById("table");
  const body = table.tBodies[0];
  const rows = [...body.rows];
  const headings = [...table.tHead.rows[0].cells];
  const collator = new Intl.Collator("en", { numeric: true });

  const value = (row, column) => {
    const cell = row.cells[column];
    return cell.dataset.value === undefined ? cell.textContent.trim() : Number(cell.dataset.value);
  };
  // numbers by size, texts by alphabet, empty cells last whichever way
  function compare(a, b, sign) {
    if (a === "" || b === "") return (a === "") - (b === "");
    return sign * (typeof a === "number" && typeof b === "number" ? a - b : collator.compare(a, b));
  }
  function sort(column) {
    const heading = headings[column];
    const sign = heading.getAttribute("aria-sort") === "ascending" ? -1 : 1;
    for (const other of headings) other.removeAttribute("aria-sort");
    heading.setAttribute("aria-sort", sign > 0 ? "ascending" : "descending");
    body.append(...[...rows].sort((a, b) => compare(value(a, column), value(b, column), sign)));
  }
  headings.forEach((heading, column) => {
    const button = document.createElement("button");
    button.type = "button";
    button.textContent = heading.textContent;
    button.addEventListener("click", () => sort(column));
    heading.replaceChildren(button);
  });

  const columns = document.getElementById("columns");
  const chosen = headings.map((heading) => !("more" in heading.dataset));
  function choose(column, shown) {
    chosen[column] = shown;
    for (const row of [table.tHead.rows[0], ...rows]) row.cells[column].hidden = !shown;
    document.getElementById("chosen").textContent = `${chosen.filter(Boolean).length} of ${headings.length} shown`;
  }
  headings.forEach((heading, column) => {
    choose(column, chosen[column]);
    if (column === 0) return; // it names the rows
    const label = document.createElement("label");
    const box = document.createElement("input");
    box.type = "checkbox";
    box.checked = chosen[column];
    box.setAttribute("aria-label", `column ${heading.textContent}`);
    box.addEventListener("change", () => choose(column, box.checked));
    label.append(box, ` ${heading.textContent}`);
    columns.querySelector("p").append(label);
  });
  columns.hidden = chosen.every(Boolean);

  const form = document.getElementById("filter");
  const [words, state, count] = ["words", "state", "count"].map((id) => document.getElementById(id));
  const texts = new Map(rows.map((row) => [row, row.textContent.toLowerCase()]));
  function filter() {
    const wanted = words.value.toLowerCase().split(/\s+/);
    let shown = 0;
    for (const row of rows) {
      const fits = wanted.every((word) => texts.get(row).includes(word))
        && (!state.value || row.dataset.state === state.value);
      row.hidden = !fits;
      shown += fits;
    }
    count.textContent = `${shown} of ${rows.length} shown`;
  }
  form.addEventListener("input", filter);
  form.addEventListener("submit", (event) => event.preventDefault());
  form.addEventListener("reset", () => {
    for (const heading of headings) heading.removeAttribute("aria-sort");
    body.append(...rows);
    setTimeout(filter); // once the fields are empty
  });
  form.hidden = false;
  document.getElementById("sortable").hidden = false;
  filter();
})();

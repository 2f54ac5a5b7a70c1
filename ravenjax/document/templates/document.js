// Tables that sort, search and fold; charts whose values can be read, series hidden, drawings saved. Without it all is shown.
const campaign = document.title.split(":")[0].replace(/[^\w.-]+/g, "_");
const SMALL = matchMedia("(max-width: 640px)").matches;
const FOLD = SMALL ? 5 : 10;  // rows of a long table that are shown at first
const LONG = SMALL ? 7 : 15;  // rows beyond which a table folds
const NARROW = 2;  // columns that fit a phone
const FEW = 4;  // rows from which on it sorts

function element(name, attributes, ...children) {
  const made = document.createElement(name);
  for (const [attribute, value] of Object.entries(attributes || {})) made.setAttribute(attribute, value);
  made.append(...children);
  return made;
}

function save(text, kind, name) {
  const link = element("a", { href: URL.createObjectURL(new Blob([text], { type: kind })), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

// --- tables

function number(text) {
  const found = /^[^\p{L}\d−-]*?([−-]?[\d,]*\.?\d+)(e[+-]?\d+)?/u.exec(text.trim());
  return found ? Number(found[1].replace("−", "-").replaceAll(",", "") + (found[2] || "")) : NaN;
}

function key(cell) {
  if (!cell) return "";
  const words = [...cell.childNodes].filter((part) => !["SMALL", "SPAN"].includes(part.nodeName)).map((part) => part.textContent);
  const text = (cell.querySelector("b")?.textContent ?? words.join(" ")).trim();
  return cell.dataset.sort ?? (text || (cell.querySelector("[aria-label]")?.getAttribute("aria-label") ?? ""));
}

function headings(table) {
  const rows = table.tHead ? [...table.tHead.rows] : [];
  return rows.length ? [...rows.at(-1).cells] : [];
}

function told(head) {
  return (head.querySelector("button.sort") ?? head).innerText.replace(/\s+/g, " ").trim();
}

function above(table, column) {  // heading over several columns
  const first = table.tHead && table.tHead.rows.length > 1 ? table.tHead.rows[0] : null;
  let end = 0;
  for (const cell of first ? first.cells : []) {
    end += cell.colSpan;
    if (column < end) return cell.textContent.trim();
  }
  return "";
}

class Table {
  constructor(table) {
    this.table = table;
    this.rows = [...table.tBodies].flatMap((body) => [...body.rows]);
    this.start = this.rows.slice();
    this.heads = headings(table);
    this.parts = this.rows.some((row) => row.classList.contains("first"));  // rows that belong to the one above
    this.folds = this.rows.length > LONG;
    this.open = !this.folds;
    this.sought = "";
    this.column = null;
    this.label();
    if (this.folds) this.tools();
    if (this.rows.length >= FEW && !this.parts && table.dataset.order !== "fixed") this.sortable();
    this.show();
  }

  label() {  // the name of its column beside every cell, for narrow windows; roles, for they lay the table out anew
    const names = this.heads.map((head, column) => {
      const over = above(this.table, column);
      return (over ? over + ": " : "") + told(head);
    });
    const roles = { TABLE: "table", THEAD: "rowgroup", TBODY: "rowgroup", TR: "row", TD: "cell", CAPTION: "caption" };
    this.table.querySelectorAll("thead, tbody, tr, td, caption").forEach((part) => part.setAttribute("role", roles[part.tagName]));
    this.table.querySelectorAll("th").forEach((head) => head.setAttribute("role", head.closest("thead") ? "columnheader" : "rowheader"));
    this.table.setAttribute("role", "table");
    if (this.heads.length > NARROW) this.table.classList.add("cards");
    for (const row of this.rows) [...row.cells].forEach((cell, column) => {
      if (cell.tagName === "TD" && column) cell.dataset.label = names[column] ?? "";
      if (cell.tagName === "TD" && !cell.children.length && cell.textContent.length > 40) cell.classList.add("long");
    });
  }

  tools() {
    const search = element("input", { type: "search", placeholder: "search", "aria-label": "search in this table" });
    search.addEventListener("input", () => { this.sought = search.value.trim().toLowerCase(); this.show(); });
    this.said = element("span", { class: "said", "aria-live": "polite" });
    this.more = element("button", { type: "button" });
    this.more.addEventListener("click", () => { this.open = !this.open; this.show(); });
    this.bar = element("div", { class: "tools" }, element("label", {}, search), this.said, this.more);
    (this.table.closest(".scroll") ?? this.table).before(this.bar);
  }

  sortable() {
    const by = element("select", { "aria-label": "sort by" }, element("option", { value: "" }, "order as given"));
    this.heads.forEach((head, column) => {
      if (!head.textContent.trim()) return;
      by.append(element("option", { value: column }, head.innerText.replace(/\s+/g, " ")));
      const button = element("button", { type: "button", class: "sort" });
      button.append(...head.childNodes);
      head.append(button);
      button.addEventListener("click", () => this.sort(column));
    });
    by.addEventListener("change", () => this.sort(by.value === "" ? null : Number(by.value), true));
    if (this.bar) this.bar.append(element("label", { class: "by" }, by));
  }

  sort(column, anew) {
    const known = column === null ? [] : this.start.map((row) => number(key(row.cells[column])));
    const numeric = known.filter((value) => !Number.isNaN(value)).length > known.length / 2;
    const order = ["none", ...(numeric ? ["descending", "ascending"] : ["ascending", "descending"])];
    const same = this.column === column && !anew;
    this.turn = column === null ? "none" : order[same ? (order.indexOf(this.turn) + 1) % 3 : 1];
    this.column = column;
    const sign = this.turn === "descending" ? -1 : 1;
    this.rows = this.start.slice();
    if (this.turn !== "none") {
      this.rows.sort((one, other) => {
        const [a, b] = [one, other].map((row) => key(row.cells[column]));
        if (!numeric) return sign * a.localeCompare(b, undefined, { numeric: true });
        const [x, y] = [number(a), number(b)];
        if (Number.isNaN(x) || Number.isNaN(y)) return Number(Number.isNaN(x)) - Number(Number.isNaN(y));  // without a number: last
        return sign * (x - y);
      });
    }
    this.heads.forEach((head, place) => {
      if (place === column && this.turn !== "none") head.setAttribute("aria-sort", this.turn);
      else head.removeAttribute("aria-sort");
    });
    this.table.tBodies[0].append(...this.rows);
    this.show();
  }

  show() {
    if (!this.folds) return;
    let group = "";
    let shown = 0;
    let matching = 0;
    let due = true;
    for (const row of this.rows) {
      const text = row.textContent.toLowerCase();
      const begins = !this.parts || row.classList.contains("first");
      if (begins) group = this.parts ? text : "";
      const matches = !this.sought || text.includes(this.sought) || group.includes(this.sought);
      matching += Number(matches);
      if (begins) due = this.open || this.sought !== "" || shown < FOLD;  // what belongs together folds together
      row.classList.toggle("folded", !(matches && due));
      shown += Number(matches && due);
    }
    const all = this.rows.length;
    this.said.textContent = this.sought ? matching + " of " + all + " rows match" : shown < all ? "first " + shown + " of " + all + " rows" : all + " rows";
    this.more.textContent = this.open ? "fold" : "show all " + all;
    this.more.hidden = this.sought !== "";
  }
}
document.querySelectorAll("table").forEach((table) => {
  if (!table.matches(".matrix, .cells, .numbers table, .choices")) new Table(table);
});

// --- sections: on a phone each but the first is closed, until its heading or a link to it is touched

function open(section, shown = true) {
  section.classList.toggle("closed", !shown);
  section.querySelector("button.fold").setAttribute("aria-expanded", String(shown));
}
function openNamed() {
  const section = document.getElementById(location.hash.slice(1))?.closest(".folding > section");
  if (SMALL && section) {
    open(section);
    section.scrollIntoView();
  }
}
if (SMALL) {
  document.querySelectorAll(".folding > section").forEach((section, place) => {
    const heading = section.querySelector("h2");
    const button = element("button", { type: "button", class: "fold" });
    button.append(...heading.childNodes);
    heading.append(button);
    button.addEventListener("click", () => open(section, section.classList.contains("closed")));
    open(section, place === 0);
  });
  addEventListener("hashchange", openNamed);
  openNamed();
}

// --- buttons

document.addEventListener("click", (event) => {
  const target = /** @type {any} */ (event.target);
  if (target.closest("a[href^='#']")) setTimeout(openNamed);
  const copy = target.closest("button[data-copy]");
  if (copy) navigator.clipboard.writeText(copy.dataset.copy).then(() => {
    copy.textContent = "copied";
    setTimeout(() => { copy.textContent = "copy"; }, 1500);
  });
  const table = target.closest("button[data-csv]");
  if (table) {
    const text = JSON.parse(document.getElementById("csv-" + table.dataset.csv).textContent);
    save(text, "text/csv", campaign + "_" + table.dataset.csv + ".csv");
  }
  const series = target.closest("button[data-series]");
  if (series) {
    const shown = series.getAttribute("aria-pressed") !== "true";
    series.setAttribute("aria-pressed", shown);
    series.closest("figure").querySelectorAll('.mark[data-series="' + series.dataset.series + '"]')
      .forEach((mark) => mark.classList.toggle("off", !shown));
  }
  const figure = target.closest("button[data-svg]");
  if (figure) saveDrawing(figure.closest("figure"), figure.dataset.svg);
});

// --- charts

const LOOKS = ["fill", "fill-opacity", "stroke", "stroke-width", "stroke-opacity", "stroke-dasharray", "font-family", "font-size", "text-anchor"];

function saveDrawing(figure, name) {  // the drawing that is shown, with its legend, as a file that needs no style sheet
  const source = [...figure.querySelectorAll(":scope > svg")].find((one) => getComputedStyle(one).display !== "none");
  const copy = source.cloneNode(true);
  const [from, to] = [source, copy].map((one) => [...one.querySelectorAll("*")]);
  from.forEach((one, place) => {
    const style = getComputedStyle(one);
    if (style.display === "none") to[place].remove();
    else for (const trait of LOOKS) to[place].setAttribute(trait, style.getPropertyValue(trait));
    to[place].removeAttribute("style");
  });
  const names = [...figure.querySelectorAll(".legend [aria-pressed=true]")];
  const [, , width, height] = source.getAttribute("viewBox").split(" ").map(Number);
  const entries = names.map((one, row) => {
    const y = height + 16 + 18 * row;
    const colour = getComputedStyle(one.querySelector("i")).backgroundColor;
    const text = element("span", {}, one.textContent.trim()).innerHTML;
    return '<rect x="6" y="' + (y - 6) + '" width="14" height="4" fill="' + colour + '"/><text x="26" y="' + y +
      '" font-family="sans-serif" font-size="12" fill="' + getComputedStyle(one).color + '">' + text + "</text>";
  });
  const paper = getComputedStyle(document.documentElement).getPropertyValue("--paper");
  const tall = height + 18 * names.length + 8;
  copy.removeAttribute("class");
  const text = '<svg xmlns="http://www.w3.org/2000/svg" width="' + width + '" height="' + tall + '" viewBox="0 0 ' + width + " " + tall +
    '"><rect width="100%" height="100%" fill="' + paper + '"/>' + copy.innerHTML.replace(/ class="[^"]*"/g, "") + entries.join("") + "</svg>";
  save(text, "image/svg+xml", campaign + "_" + name + ".svg");
}

const tip = element("div", { class: "tip", hidden: "" });
document.body.append(tip);
function say(lines, x, y) {
  tip.replaceChildren(...lines);
  tip.hidden = false;
  const { width, height } = tip.getBoundingClientRect();
  tip.style.left = Math.max(6, Math.min(x + 14, innerWidth - width - 6)) + "px";
  tip.style.top = (y + 18 + height > innerHeight ? y - height - 12 : y + 18) + "px";
}
function silent() {
  tip.hidden = true;
  document.querySelectorAll(".reading").forEach((line) => line.remove());
}

const written = (axis, value) => {
  // As document/numbers.py writes percents.
  if (axis.share) return (100 * value).toFixed((value > 0 && value < 0.01) || (value > 0.99 && value < 1) ? 2 : 1) + "\u202f%";
  const text = Math.abs(value) >= 100 || Number.isInteger(value) ? Math.round(value).toLocaleString("en") : String(Number(value.toPrecision(3)));
  return (text + " " + axis.unit).trim().replace("-", "−");
};

function at(curve, x) {  // value of a curve, undefined beside it
  const last = curve.x.length - 1;
  if (last < 0 || x < curve.x[0] || x > curve.x[last]) return undefined;
  let next = curve.x.findIndex((place) => place > x);
  if (next < 0) next = last + 1;
  if (curve.step || next > last) return curve.y[next - 1];
  const part = (x - curve.x[next - 1]) / (curve.x[next] - curve.x[next - 1]);
  return curve.y[next - 1] + part * (curve.y[next] - curve.y[next - 1]);
}

function read(figure, drawing, event) {
  figure.values ??= JSON.parse(figure.querySelector("script[type='application/json']").textContent);
  const { x: axis, y: up, curves } = figure.values;
  if (!curves.length) return silent();
  const hit = drawing.querySelector(".hit");
  const box = hit.getBoundingClientRect();
  if (event.clientX < box.left || event.clientX > box.right || event.clientY < box.top || event.clientY > box.bottom) return silent();
  const part = Math.min(1, Math.max(0, (event.clientX - box.left) / box.width));
  let x = axis.log ? axis.low * (axis.high / axis.low) ** part : axis.low + part * (axis.high - axis.low);
  if (axis.unit === "ms") x = Math.round(x);
  const lines = [element("p", {}, axis.title.replace(/, \w+$/, "") + ": " + written(axis, x))];
  for (const button of figure.querySelectorAll(".legend [aria-pressed=true]")) {
    const curve = curves.find((one) => one.name === button.textContent.trim());
    const value = curve && at(curve, x);
    if (value === undefined) continue;
    const swatch = element("i", { style: button.getAttribute("style") });
    lines.push(element("p", {}, swatch, curve.name.replace(/ \([^()]*\)$/, "") + ": " + written(up, value)));
  }
  silent();
  const line = document.createElementNS("http://www.w3.org/2000/svg", "line");
  const { x: left, y: top, width, height } = hit.getBBox();
  for (const [name, value] of Object.entries({ class: "reading", x1: left + part * width, x2: left + part * width, y1: top, y2: top + height })) {
    line.setAttribute(name, value);
  }
  drawing.append(line);
  if (lines.length > 1) say(lines, event.clientX, event.clientY);
}

function look(event) {
  const marked = event.target.closest?.("[data-tip]");
  if (marked) return say([element("p", {}, marked.dataset.tip)], event.clientX, event.clientY);
  const drawing = event.target.closest?.("figure.plot > svg");
  if (drawing) return read(drawing.closest("figure"), drawing, event);
  if (!tip.hidden) silent();
}
document.addEventListener("pointermove", look);
document.addEventListener("pointerdown", look);
document.addEventListener("scroll", silent, { passive: true });
addEventListener("keydown", (event) => { if (event.key === "Escape") silent(); });

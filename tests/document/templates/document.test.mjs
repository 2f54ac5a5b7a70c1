import assert from "node:assert/strict";
import test from "node:test";

import { element, run } from "../../browser_scripts.mjs";

const document = element({ title: "quick run: results", createElement: () => element(), body: element() });
const names = ["campaign", "number", "key", "above", "written", "at", "Table"];
const page = run("ravenjax/document/templates/document.js", { document, matchMedia: () => ({ matches: false }), addEventListener: () => {} }, names);
const text = (words) => ({ nodeName: "#text", textContent: words });
const cell = (words, more = {}) => element({ childNodes: [text(words)], ...more });

test("files are named by the campaign, without letters that a file name may not have", () => {
  assert.equal(page.campaign, "quick_run");
});

test("a cell's number is the first that is no part of a word", () => {
  const read = { "1,234.5 mm": 1234.5, "−3.2": -3.2, "-3": -3, "12.5\u202f%": 12.5, "1e-3": 1e-3, ".5": 0.5, "< 0.1 %": 0.1, "(7)": 7, "2 of 9": 2 };
  for (const [words, value] of Object.entries(read)) assert.equal(page.number(words), value, words);
  for (const words of ["", "none", "C09 encoder", "–"]) assert.ok(Number.isNaN(page.number(words)), words);
});

test("a cell is sorted by what it is told to be, its bold words, its own words, or its label", () => {
  const bold = (words) => ({ querySelector: (what) => (what === "b" ? text(words) : null) });
  assert.equal(page.key(undefined), "");
  assert.equal(page.key(cell(" plain ")), "plain");
  assert.equal(page.key(cell("x", bold("40 %"))), "40 %");
  assert.equal(page.key(cell("x", { dataset: { sort: "3" } })), "3");
  assert.equal(page.key(element({ childNodes: [text("12"), { nodeName: "SMALL", textContent: "of 40" }] })), "12");
  const labelled = { querySelector: (what) => (what === "[aria-label]" ? element({ getAttribute: () => "high" }) : null) };
  assert.equal(page.key(cell("", labelled)), "high");
});

test("a heading over several columns is that of each of them", () => {
  const head = (words, colSpan) => ({ textContent: words, colSpan });
  const table = { tHead: { rows: [{ cells: [head("", 1), head(" faults ", 2), head("cue", 1)] }, {}] } };
  assert.deepEqual([0, 1, 2, 3, 4].map((column) => page.above(table, column)), ["", "faults", "faults", "cue", ""]);
  assert.equal(page.above({ tHead: { rows: [{ cells: [head("a", 1)] }] } }, 0), "");
});

test("values are written as the page writes them", () => {
  assert.equal(page.written({ share: true }, 0.1234), "12.3\u202f%");
  assert.equal(page.written({ unit: "ms" }, 1234.4), "1,234 ms");
  assert.equal(page.written({ unit: "mm" }, -0.012345), "−0.0123 mm");
  assert.equal(page.written({ unit: "" }, 5), "5");
});

test("a curve is read between its points, a step at the point before, and not beside it", () => {
  const line = { x: [0, 10, 20], y: [0, 1, 3] };
  assert.deepEqual([0, 5, 10, 15, 20].map((x) => page.at(line, x)), [0, 0.5, 1, 2, 3]);
  assert.deepEqual([0, 9, 10, 20].map((x) => page.at({ ...line, step: true }, x)), [0, 0, 1, 3]);
  assert.equal(page.at(line, -1), undefined);
  assert.equal(page.at(line, 21), undefined);
  assert.equal(page.at({ x: [], y: [] }, 0), undefined);
});

/** What a table of these columns shows after each click on one of them. */
function clicks(rows, column, times) {
  const start = rows.map((words) => ({ cells: words.map((one) => cell(one)), words: words[column] }));
  const shown = [];
  const table = Object.create(page.Table.prototype);
  Object.assign(table, { start, rows: start.slice(), heads: [element(), element()], column: null, folds: false });
  table.table = { tBodies: [{ append: (...all) => shown.push(all.map((row) => row.words)) }] };
  for (let k = 0; k < times; k += 1) table.sort(column);
  return { shown, heads: table.heads };
}

test("numbers sort largest first, then smallest, then as given; what is no number comes last", () => {
  const { shown, heads } = clicks([["a", "9"], ["b", "none"], ["c", "10"], ["d", "−2"]], 1, 3);
  assert.deepEqual(shown, [["10", "9", "−2", "none"], ["−2", "9", "10", "none"], ["9", "none", "10", "−2"]]);
  assert.equal(heads[1].getAttribute("aria-sort"), null);
  assert.equal(clicks([["a", "9"], ["b", "10"]], 1, 1).heads[1].getAttribute("aria-sort"), "descending");
});

test("words sort from a to z first, numbers in them by their size", () => {
  const { shown } = clicks([["case b"], ["case a10"], ["case a9"]], 0, 2);
  assert.deepEqual(shown, [["case a9", "case a10", "case b"], ["case b", "case a10", "case a9"]]);
});

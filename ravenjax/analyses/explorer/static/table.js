// Shows the runs of a result folder: as circles on the map, and as a table.

import { nearest, words } from "./axes.js";
import { csv, save } from "./saving.js";
import { CLASSES, classOf, text } from "./verdicts.js";
import { icon } from "./legend.js";

/** The element of an id; the page's HTML decides its kind. @type {(id: string) => any} */
const $ = (id) => document.getElementById(id);
const MOST = 24;
const FAULT = ["site", "arm", "channel", "effect", "value", "start_ms", "duration_ms"];

const percent = (share) => `${text(Number((100 * share).toPrecision(2)))} %`;

/** A sentence: how many of the folder's faults evade the checks, with an interval if the faults were drawn. */
export function shares({ k, n, value, low, high }) {
  if (!n) return "";
  const sure = low === null ? "chosen, not drawn, so there is no interval" : `95 % interval ${percent(low)} to ${percent(high)}`;
  return `Of ${text(n)} distinct faults, ${text(k)} evade every safety check and do harm: ${percent(value)} (${sure}). `;
}

export class Table {
  /** open(fault, changes): what a row's button does. */
  constructor(campaign, { folder, cue, runs, rows, evading, columns }, open) {
    this.campaign = campaign;
    this.folder = folder;
    this.runs = runs;
    this.listed = rows;
    this.evading = evading;
    this.columns = columns;
    this.open = open;
    const names = Object.keys(columns);
    this.rows = columns.run_id.map((_, k) => {
      const row = Object.fromEntries(names.map((name) => [name, columns[name][k]]));
      row.cue = row.verdict.endsWith("/cue");
      row[`cue${cue}_first_ms`] = row.cue_ms;
      return row;
    });
  }

  fault(row) {
    const fault = Object.fromEntries(FAULT.map((name) => [name, row[name]]));
    if (!fault.arm) delete fault.arm;
    if (fault.duration_ms < 0) fault.duration_ms = "end";
    return fault;
  }

  changes(row) {
    return Object.fromEntries(Object.entries(row).filter(([name, value]) => name.startsWith("param:") && value !== null).map(([name, value]) => [name.slice(6), value]));
  }

  /** Runs with the site, arm, channel and effect of a map, with their nearest square. Other properties may differ. */
  dots(fault, { across, up }) {
    const held = ["site", "arm", "effect", "channel"].filter((name) => name !== across.name && name !== up.name);
    return this.rows
      .filter((row) => held.every((name) => (row[name] || undefined) === (fault[name] || undefined)))
      .map((row) => ({ ...row, i: nearest(across, row[across.name]), j: nearest(up, row[up.name] < 0 ? Infinity : row[up.name]) }))
      .filter(({ i, j }) => i >= 0 && j >= 0);
  }

  show() {
    $("table").hidden = false;
    const faulty = this.rows.filter(({ site }) => site);
    const few = this.listed < this.runs ? `. This page lists ${text(this.listed)} of them, with at most one fault in one time window` : "";
    $("table-lead").textContent = `${shares(this.evading)}${text(this.runs)} runs in ${this.folder}${few}. Circles on the map are runs with the chosen arm, site and effect, at the nearest square. Their other properties may differ from those of the map.`;
    const counts = {};
    for (const row of faulty) counts[classOf(row)] = (counts[classOf(row)] ?? 0) + 1;
    $("table-which").innerHTML = Object.keys(CLASSES).filter((name) => counts[name]).map((name) => `<option value="${name}">${CLASSES[name].says} (${counts[name]})</option>`).join("");
    $("table-which").addEventListener("change", () => this.fill(faulty));
    this.fill(faulty);
  }

  fill(rows) {
    const own = rows.filter((row) => classOf(row) === $("table-which").value).sort((a, b) => (b.unintended_mm ?? 0) - (a.unintended_mm ?? 0));
    $("table-rest").textContent = own.length > MOST ? `the ${MOST} that move the tip most, of ${own.length}` : "";
    $("table-rows").replaceChildren(
      ...own.slice(0, MOST).map((row) => {
        const line = document.createElement("tr");
        const name = classOf(row);
        line.innerHTML = `<th scope="row">${row.index}<small>${row.group.replaceAll("<", "&lt;")}</small></th><td class="left long"></td><td class="left">${icon(name, CLASSES[name].mark)} ${CLASSES[name].says}</td><td data-label="unintended motion, mm">${text(row.unintended_mm)}</td><td><button type="button">watch</button></td>`;
        line.children[1].textContent = words(this.campaign, this.fault(row));
        line.querySelector("button").addEventListener("click", () => this.open(this.fault(row), this.changes(row)));
        return line;
      }),
    );
  }

  save() {
    save(csv(Object.keys(this.columns), this.rows), "text/csv", `${this.folder}.csv`);
  }
}

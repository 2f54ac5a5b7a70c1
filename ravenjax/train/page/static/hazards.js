// The instructor's hazards: search, groups, favourites, and a plan on the session's clock that can be saved by name.

import { clock } from "./panels.js";

const FOLDED_FROM = 13; // from this number of hazards on, groups are folded
const FAVOURITES = "ravenjax-favourite-hazards";
const PLANS = "ravenjax-hazard-plans";
const SOON_S = 10; // default delay of a hazard that is added to the plan

/** Whether a hazard contains every word of the search. */
export function fits(hazard, sought) {
  const text = [hazard.hazard, hazard.title, hazard.layer, ...(hazard.right_response ?? [])].join(" ").toLowerCase();
  return sought.toLowerCase().split(/\s+/).every((word) => text.includes(word));
}

/** [name, hazards] of each layer of the loop, in order of appearance. */
export function grouped(hazards) {
  const groups = new Map();
  for (const one of hazards) {
    const name = one.layer || "others";
    if (!groups.has(name)) groups.set(name, []);
    groups.get(name).push(one);
  }
  return [...groups];
}

/** Hazards at times of the session's clock. A hazard that is due while another is active waits for its end. */
export class Plan {
  constructor() {
    this.entries = []; // {at: s, number}, by time
  }

  add(at, number) {
    this.entries.push({ at, number });
    this.entries.sort((one, other) => one.at - other.at);
  }

  remove(entry) {
    this.entries = this.entries.filter((one) => one !== entry);
  }

  /** Removes the hazard that is due from the plan and returns its number; null: none is due. */
  due(seconds, free) {
    if (!free || !this.entries.length || this.entries[0].at > seconds) return null;
    return this.entries.shift().number;
  }
}

const kept = (place, otherwise) => {
  try {
    return JSON.parse(localStorage.getItem(place)) ?? otherwise;
  } catch {
    return otherwise;
  }
};

export class HazardPanel {
  constructor(card, list, send) {
    this.card = card;
    this.list = list;
    this.send = send;
    this.plan = new Plan();
    this.folded = new Map();
    this.marks = []; // [s, number] of hazards that became active
    this.hazards = [];
    this.search = made("input", { type: "search", id: "hazard-search", placeholder: "search: B11, stop", ariaLabel: "search hazards" });
    this.starred = made("input", { type: "checkbox", id: "hazard-starred" });
    const label = made("label", {}, this.starred, "favourites only");
    const tools = made("div", { className: "hazard-tools" }, this.search, label);
    list.before(tools);
    this.strip = made("div", { className: "hazard-strip", title: "hazards that became active and planned hazards, by the session's time" });
    this.queue = made("ol", { className: "list hazard-plan" });
    this.presets = made("select", { id: "hazard-preset", ariaLabel: "saved plans" });
    this.name = made("input", { type: "text", id: "hazard-plan-name", maxLength: 40, placeholder: "name, then Save", ariaLabel: "name of the plan" });
    const keep = made("button", { type: "button", className: "small", id: "hazard-keep" }, "Save");
    const clear = made("button", { type: "button", className: "small", id: "hazard-clear" }, "Clear");
    const row = made("div", { className: "hazard-presets" }, this.presets, this.name, keep, clear);
    const note = made("p", { className: "note" }, "The plan runs in this window: keep the window open.");
    list.after(made("h3", {}, "Plan"), this.strip, this.queue, row, note);
    this.search.addEventListener("input", () => this.fill());
    this.starred.addEventListener("change", () => this.fill());
    this.presets.addEventListener("change", () => this.load(this.presets.value));
    keep.addEventListener("click", () => this.keep());
    clear.addEventListener("click", () => {
      this.plan.entries = [];
      this.planned();
    });
  }

  /** hazards: those of the session's header. */
  welcome(hazards) {
    this.hazards = hazards;
    this.seconds = 0;
    this.started = null;
    this.now = 0;
    this.states = new Map();
    this.marks = [];
    this.fill();
    this.planned();
    this.offered();
  }

  event(event) {
    if (event.kind === "started") this.started = event.tick;
    const states = { hazard_armed: "armed", hazard_struck: "struck", hazard_over: "over" };
    const state = states[event.kind];
    if (!state || !this.hazards[event.number]) return;
    this.states.set(event.number, { state, outcome: event.outcome });
    if (state === "struck") this.marks.push([(event.tick - (this.started ?? event.tick)) / 1000, event.number]);
    const item = this.list.querySelector(`[data-number="${event.number}"]`);
    if (item) this.mark(item, event.number);
    this.planned();
  }

  frame(frame, phase) {
    const free = frame.number("hazard") < 0 && phase !== "over";
    for (const button of this.list.querySelectorAll("button.arm")) button.disabled = !free;
    for (const item of this.list.querySelectorAll("[data-number]")) // marked as armed from the click on, also while it waits to become active
      item.classList.toggle("armed", Number(item.dataset.number) === frame.number("hazard") && phase !== "over");
    this.now = this.started === null ? 0 : (frame.number("session_tick") - this.started) / 1000;
    const seconds = Math.round(this.now + frame.number("left_ms") / 1000);
    if (seconds !== this.seconds) {
      this.seconds = seconds;
      this.planned();
    }
    const number = phase === "running" ? this.plan.due(this.now, free) : null;
    if (number !== null) {
      this.send({ type: "instructor", do: "arm", hazard: number });
      this.planned();
    }
    const cursor = this.strip.querySelector(".now-line");
    if (cursor) cursor.style.left = `${Math.min(100, (100 * this.now) / (this.seconds || 1))}%`;
  }

  fill() {
    const [favourites, sought] = [new Set(kept(FAVOURITES, [])), this.search.value.trim()];
    const found = this.hazards.filter((one) => fits(one, sought) && (!this.starred.checked || favourites.has(one.hazard)));
    const folding = this.hazards.length >= FOLDED_FROM && !sought && !this.starred.checked;
    this.list.replaceChildren();
    for (const [name, members] of grouped(found)) {
      const closed = folding && (this.folded.get(name) ?? true);
      if (this.hazards.length >= FOLDED_FROM) this.list.append(this.heading(name, members.length, closed));
      if (!closed) for (const one of members) this.list.append(this.item(one, favourites.has(one.hazard)));
    }
    if (!found.length && this.hazards.length) this.list.append(made("li", { className: "none" }, "no hazard fits"));
  }

  heading(name, count, closed) {
    const button = made("button", { type: "button", ariaExpanded: String(!closed) }, `${closed ? "▸" : "▾"} ${name}`, made("small", {}, String(count)));
    button.addEventListener("click", () => {
      this.folded.set(name, !closed);
      this.fill();
    });
    return made("li", { className: "group" }, button);
  }

  item(hazard, favourite) {
    const { number, title, right_response: right = [], within_s: within } = hazard;
    const arm = made("button", { type: "button", className: "arm" }, "arm");
    arm.addEventListener("click", () => this.send({ type: "instructor", do: "arm", hazard: number }));
    const star = made("button", { type: "button", className: "star", ariaPressed: String(favourite), title: "favourite, in every session" }, favourite ? "★" : "☆");
    star.addEventListener("click", () => {
      const all = new Set(kept(FAVOURITES, []));
      if (!all.delete(hazard.hazard)) all.add(hazard.hazard);
      localStorage.setItem(FAVOURITES, JSON.stringify([...all]));
      this.fill();
    });
    const later = made("button", { type: "button", className: "later", title: `on the plan, ${SOON_S} s from now` }, "plan");
    later.addEventListener("click", () => {
      this.plan.add(Math.round(this.now + SOON_S), number);
      this.planned();
    });
    const item = made("li", {}, made("b", {}, `${hazard.hazard} ${title}`), made("small", {}, `${right.join(", ")} within ${within} s`), made("span", {}, arm, later, star));
    item.dataset.number = number;
    this.mark(item, number);
    return item;
  }

  mark(item, number) {
    const told = this.states?.get(number);
    if (!told) return;
    item.className = told.state;
    if (told.outcome) item.querySelector("small").textContent = told.outcome;
  }

  /** Draws the plan and the hazards that became active. */
  planned() {
    const place = (seconds) => `${Math.min(100, Math.max(0, (100 * seconds) / (this.seconds || 1)))}%`;
    const dot = (seconds, number, kind) => made("i", { className: kind, style: `left:${place(seconds)}`, title: `${clock(1000 * seconds)} ${this.title(number)}` });
    this.strip.replaceChildren(
      made("u", { className: "now-line", style: `left:${place(this.now)}` }),
      ...this.marks.map(([at, number]) => dot(at, number, "struck")),
      ...this.plan.entries.map(({ at, number }) => dot(at, number, "planned")),
    );
    this.queue.replaceChildren(...this.plan.entries.map((entry) => this.entry(entry)));
  }

  entry(entry) {
    const at = made("input", { type: "number", min: 0, value: entry.at, ariaLabel: "s on the session's clock" });
    at.addEventListener("change", () => {
      this.plan.remove(entry);
      this.plan.add(Math.max(0, Number(at.value) || 0), entry.number);
      this.planned();
    });
    const away = made("button", { type: "button", className: "small", ariaLabel: "take it off the plan" }, "×");
    away.addEventListener("click", () => {
      this.plan.remove(entry);
      this.planned();
    });
    return made("li", {}, at, made("span", {}, `s  ${this.title(entry.number)}`), away);
  }

  title(number) {
    const { hazard, title } = this.hazards[number] ?? {};
    return `${hazard} ${title}`;
  }

  /** Plans are saved by the hazards' ids, so that they fit other sessions of the scenario. */
  keep() {
    const name = this.name.value.trim();
    if (!name || !this.plan.entries.length) return;
    const entries = this.plan.entries.map(({ at, number }) => ({ at, id: this.hazards[number].group }));
    localStorage.setItem(PLANS, JSON.stringify({ ...kept(PLANS, {}), [name]: entries }));
    this.name.value = "";
    this.offered();
  }

  load(name) {
    const numbers = new Map(this.hazards.map((one) => [one.group, one.number]));
    this.plan.entries = [];
    for (const { at, id } of kept(PLANS, {})[name] ?? []) if (numbers.has(id)) this.plan.add(at, numbers.get(id));
    this.planned();
  }

  offered() {
    const names = Object.keys(kept(PLANS, {}));
    this.presets.replaceChildren(made("option", { value: "" }, names.length ? "saved plans" : "no saved plans"), ...names.map((name) => made("option", { value: name }, name)));
  }
}

function made(tag, values, ...parts) {
  const one = document.createElement(tag);
  Object.assign(one, values);
  one.append(...parts);
  return one;
}

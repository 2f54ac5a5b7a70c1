// The main module of the page: controls of a fault, the answer in words, a map of outcomes, and one run in detail.

import { command, read, toml, written } from "./address.js";
import { AXES, axisOf, channelOf, nearest, onTick, siteOf, spanOf, unitOf, words } from "./axes.js";
import { Controls } from "./controls.js";
import { openEngine } from "./engine.js";
import { Field, levels } from "./field.js";
import { course, png, sheet } from "./pictures.js";
import { Run } from "./run.js";
import { copy, csv, save } from "./saving.js";
import { Table } from "./table.js";
import { CLASSES, answer, classOf, count, told, whole } from "./verdicts.js";
import { icon } from "./legend.js";

/** The element of an id; the page's HTML decides its kind. @type {(id: string) => any} */
const $ = (id) => document.getElementById(id);
/** Returns the text of a data element, and removes the element to free its memory. */
const taken = (name) => {
  const place = $(`data-${name}`);
  const text = place.textContent;
  place.remove();
  return text;
};
const data = (name) => JSON.parse(taken(name));
/** Lets the page handle input between two parts of its start. */
const pause = () => new Promise((resolve) => setTimeout(resolve));
const campaign = data("campaign");
await pause();
const description = data("program");
campaign.tick_ms = description.tick_ms;
await pause();
const MAP = 1; // priorities of computations: the run that is shown comes before the map
const RUN = 5;
const LATER = 0;
const FIRST_POINTS = 400; // points of a map whose time of completion the page stores for its tests
const WAIT_MS = 60; // the map is computed once its controls have not moved for this time

/** Faults that a page can compute: site -> channel -> effects. */
const able = {};
for (const { site, channel, effects } of description.channels) {
  const own = effects.filter((name) => !campaign.unasked.includes(name));
  if (own.length) (able[site] ??= {})[channel] = [...new Set([...(able[site][channel] ?? []), ...own])];
}

/** The first state of the page: a fault of the campaign, preferably after the last check. */
/** @returns {any} */
function firstState() {
  const own = description.examples.find(({ site }) => site === "usb_out") ?? description.examples.find(({ site }) => site in able);
  const site = own?.site ?? Object.keys(able)[0];
  const channel = own?.channel in able[site] ? own.channel : Object.keys(able[site])[0];
  const effect = own && able[site][channel].includes(own.effect) ? own.effect : able[site][channel][0];
  const start = Math.round((own?.start_ms ?? campaign.duration_ms / 3) / 50) * 50;
  const fault = { site, arm: campaign.arms[0], channel, effect, value: 0, start_ms: start, duration_ms: 64 };
  const span = spanOf(campaign, fault);
  fault.value = span ? (span.whole ? Math.round(span.high / 2) : span.high / 2) : 0;
  return { fault, across: span ? "value" : "start_ms", up: "duration_ms", motion: null, changes: {}, open: false, ms: 0 };
}

const state = firstState();
let engine = null;
let remembering = 0;
let address = location.hash; // the address that this page wrote or read last
let token = null;
/** @type {any} */
let axes = {};

const paths = new Set(description.parameters.map(({ path }) => path));

/** Corrects the state, so that the program can compute it. Returns the possible axes of the map. */
function correct() {
  const { fault } = state;
  for (const path of Object.keys(state.changes)) if (!paths.has(path) || !Number.isFinite(state.changes[path])) delete state.changes[path];
  if (!(state.motion in description.motions)) state.motion = null;
  fault.start_ms = fault.start_ms >= 0 ? onTick(campaign, fault.start_ms) : 0;
  if (fault.duration_ms !== "end") fault.duration_ms = onTick(campaign, fault.duration_ms >= 1 ? fault.duration_ms : 64, 1);
  if (!(fault.site in able)) Object.assign(fault, firstState().fault);
  const channels = able[fault.site];
  if (!(fault.channel in channels)) fault.channel = Object.keys(channels)[0];
  if (!channels[fault.channel].includes(fault.effect)) [fault.effect] = channels[fault.channel];
  fault.arm = siteOf(campaign, fault).per_arm ? (campaign.arms.includes(fault.arm) ? fault.arm : campaign.arms[0]) : undefined;
  const span = spanOf(campaign, fault);
  if (!span) fault.value = undefined;
  else if (!Number.isFinite(fault.value) || fault.value < span.low || fault.value > span.high) fault.value = span.whole ? Math.round(span.high / 2) : span.high / 2;
  const several = Object.keys(channels).filter((name) => channels[name].includes(fault.effect)).length > 1;
  const possible = Object.keys(AXES).filter((name) => (name === "value" ? span : name === "channel" ? several : true));
  if (!possible.includes(state.across)) state.across = possible.find((name) => name !== state.up);
  if (!possible.includes(state.up) || state.up === state.across) state.up = possible.find((name) => name !== state.across);
  return possible;
}

/** Reports that the page cannot continue, and why. */
function giveUp(error) {
  if (error.name === "AbortError") return;
  $("answer").textContent = `This page cannot continue: ${error.message || error}`;
  $("progress").textContent = "";
  document.body.dataset.failed = "1";
}
addEventListener("unhandledrejection", ({ reason }) => giveUp(reason));

const question = () => ({ ...engine.question(), ...state.changes, motion: state.motion ?? description.motion });
const at = (i, j) => ({ ...state.fault, [state.across]: axes.across.values[i], [state.up]: axes.up.values[j] });
const judged = (outcome) => Object.assign(outcome, { cue_set: campaign.cue });

const field = new Field($("field"), (i, j) => choose(i, j));
const run = new Run(campaign, () => taken("figure"), { moved: (ms) => ((state.ms = ms), remember()), dragged: (start) => change({ start_ms: start }) });
const controls = new Controls(campaign, description, able, { fault: change, set, motion: lead, axis });
let rows = null;
/** The runs of a result folder, if the page has one. */
function tabulate() {
  const table = data("table");
  if (!table) return;
  rows = new Table(campaign, table, (fault, changes) => {
    Object.assign(state, { changes, motion: null, open: true });
    afterwards = reveal;
    change(fault, true);
  });
  rows.show();
  field.dot(axes.across, axes.up, rows.dots(state.fault, axes));
}

let waiting = 0;
/** Computes the map again as soon as the user pauses. */
function soon() {
  clearTimeout(waiting);
  if (token) engine.cancel(token);
  token = null;
  waiting = setTimeout(fill, WAIT_MS);
}

function change(fault, known = false) {
  Object.assign(state.fault, fault);
  const redrawn = known || Object.keys(fault).some((name) => name !== state.across && name !== state.up);
  refresh(redrawn);
  if (state.open) open();
}

function set(path, value) {
  if (value === undefined) delete state.changes[path];
  else state.changes[path] = value;
  refresh(true);
  if (state.open) open();
}

/** Selects another motion of the hands; null: the campaign's own. */
function lead(motion) {
  state.motion = motion;
  refresh(true);
  if (state.open) open();
}

function axis(which, name) {
  const other = which === "across" ? "up" : "across";
  if (state[other] === name) state[other] = state[which];
  state[which] = name;
  refresh(true);
}

function refresh(redrawn) {
  const possible = correct();
  const channels = Object.keys(able[state.fault.site]).filter((name) => able[state.fault.site][name].includes(state.fault.effect));
  axes = { across: axisOf(campaign, state.fault, state.across, channels), up: axisOf(campaign, state.fault, state.up, channels) };
  controls.show(state, possible);
  if (!engine) field.reset(axes.across, axes.up, []); // shows the axes while the robot starts
  const spans = { [state.across]: axes.across.values, [state.up]: axes.up.values };
  $("fault-words").textContent = words(campaign, state.fault, spans);
  field.mark(nearest(axes.across, state.fault[state.across]), nearest(axes.up, state.fault[state.up]));
  remember();
  if (redrawn) {
    delete document.body.dataset.filled;
    soon();
  } else spot();
}

function remember() {
  clearTimeout(remembering);
  remembering = setTimeout(() => {
    if (location.hash !== address) return; // the user changed the address; `hashchange` follows
    history.replaceState(null, "", written(state));
    address = location.hash;
  }, 200);
}

/** Fills the map from coarse to fine. A newer call cancels an older one. */
async function fill() {
  if (!engine) return;
  clearTimeout(waiting);
  if (token) engine.cancel(token);
  const own = (token = {});
  field.reset(axes.across, axes.up, rows ? rows.dots(state.fault, axes) : []);
  const began = performance.now();
  try {
    for (const spread of levels(axes.across.values.length, axes.up.values.length)) {
      const faults = spread.points.map(([i, j]) => at(i, j));
      await engine.outcomes(question(), faults, {
        priority: MAP,
        token: own,
        onOutcomes: (which, outcomes) => {
          if (token !== own) return;
          for (const [k, point] of which.entries()) field.set(...spread.points[point], spread, judged(outcomes[k]));
          say();
          if (field.cells.size >= FIRST_POINTS) document.body.dataset.first ??= String(Math.round(performance.now()));
        },
      });
      if (token !== own) return;
      field.settle(spread);
      Object.assign(document.body.dataset, { points: field.cells.size, ms: Math.round(performance.now() - began) });
    }
    requestAnimationFrame(() => {
      if (token === own) document.body.dataset.filled = "1";
    });
  } catch (error) {
    giveUp(error);
  }
}

let saying = false;
function say() {
  if (saying) return;
  saying = true;
  requestAnimationFrame(() => {
    saying = false;
    const counted = count(field.outcomes());
    const [before, many, after] = answer(counted, campaign.limit_mm, 1e3 * question()[`haptics.cues.${campaign.cue}.threshold_m`], campaign.harm);
    const strong = document.createElement("strong");
    strong.textContent = many;
    $("answer").replaceChildren(before, strong, after);
    $("brief").textContent = counted.all ? `${whole(counted.evading)} of ${whole(counted.all)} ${counted.evading === 1 ? "evades the checks and does" : "evade the checks and do"} harm` : "";
    const all = axes.across.values.length * axes.up.values.length;
    $("progress").textContent = counted.all < all ? `${whole(counted.all)} of ${whole(all)} operations` : `${whole(all)} operations`;
    for (const item of $("legend").children) {
      const k = counted.classes[item.dataset.class] ?? 0;
      item.querySelector("b").textContent = whole(k);
      item.toggleAttribute("data-none", !k);
      item.hidden = !k && ["failed", "phantom", "misreported", "lost", "limited", "flagged"].includes(item.dataset.class);
    }
    spot();
  });
}

/** The point under the frame, in words. */
function spot() {
  if (!field.at) return;
  const outcome = field.get(...field.at);
  $("spot").textContent = `${words(campaign, at(...field.at))}: ${outcome ? CLASSES[classOf(outcome)].says : "being computed"}.`;
}

function choose(i, j) {
  const fault = at(i, j);
  const same = state.open && fault[state.across] === state.fault[state.across] && fault[state.up] === state.fault[state.up];
  afterwards = null;
  clicked = true;
  state.open = true;
  if (!same) change({ [state.across]: fault[state.across], [state.up]: fault[state.up] });
}

let clicked = false; // whether the pointer has chosen a cell
/** What follows as soon as the run is shown. @type {(() => void) | null} */
let afterwards = null;
const reveal = () => $("run").scrollIntoView({ block: "start" });
// While a hand draws across the map the window stays; it scrolls to the run when the hand lets go.
$("field").addEventListener("click", () => {
  if (clicked) whenShown(reveal);
  clicked = false;
});

/** Does something now if the chosen run is shown, otherwise as soon as it is. */
function whenShown(what) {
  afterwards = what;
  if (replaying?.shown) follow();
}

function follow() {
  afterwards?.();
  afterwards = null;
}

/** The run that is being computed or shown. @type {any} */
let replaying = null;
/** Shows the chosen run. */
async function open() {
  state.open = true;
  if (!engine) return;
  if (replaying) engine.cancel(replaying);
  const own = (replaying = { shown: false });
  const fault = { ...state.fault };
  try {
    const replay = await engine.replay(question(), fault, { priority: RUN, token: own });
    if (replaying !== own) return;
    judged(replay.outcome);
    $("run").hidden = false;
    $("told").textContent = told(replay.outcome, campaign.limit_mm, campaign.harm).join(" ");
    $("smallest").hidden = !spanOf(campaign, fault) || campaign.effects[fault.effect].value === "bit";
    run.show(replay, fault, state.ms);
    document.body.dataset.verdict = replay.outcome.verdict;
    own.shown = true;
    follow();
    remember();
    if (replay.outcome.unintended_first_ms >= 0 && Object.keys(description.actions).length) run.actBy(replay, await engine.deadlines(question(), fault, replay.outcome, { priority: LATER, token: own }));
  } catch (error) {
    giveUp(error);
  }
  remember();
}

/** The smallest size that does harm, on the side of the present one. */
async function search() {
  const { smallest } = await import("./smallest.js");
  const fault = { ...state.fault };
  const span = spanOf(campaign, fault);
  const kind = campaign.effects[fault.effect].value;
  const usual = kind === "factor" || (kind === "number" && channelOf(campaign, fault).usual?.every((one) => one === 1)) ? 1 : 0;
  const to = fault.value >= usual ? span.high : span.low;
  $("said").textContent = "searching …";
  const ask = (values) => engine.outcomes(question(), values.map((value) => ({ ...fault, value })), { priority: RUN });
  const found = await smallest(ask, usual, to, span.whole, ({ unintended_first_ms: ms, failed }) => !failed && ms >= 0);
  const unit = unitOf(campaign, fault);
  if (found) change({ value: found.value });
  $("said").textContent = found
    ? `With ${found.value} ${unit} ${campaign.harm ? `there is ${campaign.harm}` : `the unintended motion exceeds ${campaign.limit_mm} mm`}, with ${found.safe} ${unit} ${campaign.harm ? "there is none" : "it does not"}. ${found.runs} operations.`
    : campaign.harm
      ? `With no size up to ${to} ${unit} is there ${campaign.harm} at this moment.`
      : `With no size up to ${to} ${unit} does the unintended motion exceed ${campaign.limit_mm} mm at this moment.`;
}

const takes = () => Boolean(campaign.effects[state.fault.effect].value);
const file = () => toml(campaign, state, takes(), question());
const stem = () => `${campaign.name}_${state.fault.site}_${state.fault.effect}`;
const drawn = () => sheet(words(campaign, run.fault), [...$("signals").children], campaign.duration_ms);
const writers = {
  svg: () => save(field.svg(), "image/svg+xml", `${stem()}.svg`),
  png: () => $("field").toBlob((blob) => save(blob, "image/png", `${stem()}.png`)),
  csv: () => {
    const all = [...field.cells.values()].map(({ i, j, outcome }) => ({ ...at(i, j), class: classOf(outcome), ...outcome, tripped: outcome.tripped.map(({ name }) => name).join(" ") }));
    save(csv([...new Set(all.flatMap((row) => Object.keys(row)))], all), "text/csv", `${stem()}.csv`);
  },
  table: () => rows.save(),
  "signals-svg": () => save(drawn(), "image/svg+xml", `${stem()}_signals.svg`),
  "signals-png": async () => save(await png(drawn()), "image/png", `${stem()}_signals.png`),
  "signals-csv": () => save(course(run.replay, campaign.duration_ms), "text/csv", `${stem()}_signals.csv`),
  figure: async () => save(await run.figure.picture(), "image/png", `${stem()}_${Math.round(state.ms)}ms.png`),
};
const copies = {
  toml: file,
  command: () => command(file()),
  map: () => toml(campaign, { ...state, fault: { ...state.fault, [state.across]: axes.across.values, [state.up]: axes.up.values } }, takes(), question()),
};
document.addEventListener("click", async ({ target }) => {
  const button = target instanceof Element ? target.closest("button") : null;
  if (button?.dataset.save) writers[button.dataset.save]();
  if (button?.dataset.copy) {
    const shown = button.textContent;
    await copy(copies[button.dataset.copy]());
    button.textContent = "copied";
    setTimeout(() => (button.textContent = shown), 1500);
  }
});
$("smallest").addEventListener("click", search);
$("pin").addEventListener("click", () => run.keep());
$("undo").addEventListener("click", () => {
  Object.assign(state, { changes: {}, motion: null });
  refresh(true);
  if (state.open) open();
});
$("field").addEventListener("keydown", (event) => {
  const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
  if (event.key === "Enter" || event.key === " ") {
    if (!state.open) open();
    whenShown(() => $("run-title").focus());
  } else if (step) {
    const [i, j] = field.at;
    const clamp = (k, axis_) => Math.max(0, Math.min(axis_.values.length - 1, k));
    const fault = at(clamp(i + step[0], axes.across), clamp(j + step[1], axes.up));
    change({ [state.across]: fault[state.across], [state.up]: fault[state.up] });
  } else return;
  event.preventDefault();
});
$("run").addEventListener("keydown", ({ key }) => {
  if (key !== "Escape") return;
  run.play(false);
  $("field").focus();
});
addEventListener("hashchange", () => {
  address = location.hash;
  const wanted = read(address);
  if (!wanted) return;
  Object.assign(state, wanted);
  refresh(true);
  if (state.open) open();
});
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => field.ask());

$("legend").innerHTML = Object.entries(CLASSES)
  .map(([name, { mark, says }]) => `<li data-class="${name}" data-none>${icon(name, mark)} <span><b>0</b> ${says}</span></li>`)
  .join("");
Object.assign(state, read(location.hash) ?? {});
await pause();
refresh(true);
setTimeout(tabulate);
openEngine(description, { threads: Math.max(1, Math.min(8, navigator.hardwareConcurrency ?? 2)) }).then((opened) => {
  engine = opened;
  if (state.open) open();
  fill();
});

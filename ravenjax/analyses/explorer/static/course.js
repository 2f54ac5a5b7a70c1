// Compares one run with its golden run: events in time, signals, and the signals that differed first.

import { length, millis, text } from "./verdicts.js";

/** Signals in the order in which the robot's tick computes them: [series, words]. */
export const CHAIN = [
  ["packet_received", "a packet arrives"],
  ["surgeon_mode", "pedal state in the control software"],
  ["runlevel", "run level"],
  ["mvel", "estimated motor velocity"],
  ["jpos", "estimated joint position"],
  ["position", "estimated tip position"],
  ["position_d", "desired tip position"],
  ["jpos_d", "desired joint position"],
  ["tau_d", "desired torque"],
  ["current_cmd_cnt", "motor command before the checks"],
  ["soft_estopped", "software emergency stop"],
  ["dac_cnt", "motor command after the checks"],
  ["brakes", "brakes"],
  ["cable_tension", "cable tension"],
  ["link_jpos", "true joint position"],
  ["tip", "true tip position"],
  ["cue_force", "force of the haptic cue"],
];

const names = (series, arms, name) => [name, ...arms.map((arm) => `${arm}/${name}`)].filter((one) => one in series);

/** [{words, ms}] of the signals that differ between the two runs, by time; within a tick in the order of CHAIN. */
export function chain({ golden, faulty }, arms, ticks) {
  const out = [];
  for (const [place, [name, words]] of CHAIN.entries())
    for (const one of names(faulty, arms, name)) {
      const [a, b] = [golden[one], faulty[one]];
      const first = a.findIndex((value, k) => value !== b[k] && !(Number.isNaN(value) && Number.isNaN(b[k])));
      if (first >= 0) out.push({ words: arms.length > 1 && one.includes("/") ? `${words} (${one.split("/")[0]})` : words, ms: Math.floor(first / (a.length / ticks)), place });
    }
  return out.sort((a, b) => a.ms - b.ms || a.place - b.place);
}

/** Column k of a series of `width` numbers a tick. */
export const column = (series, k, width) => Float32Array.from({ length: series.length / width }, (_, tick) => series[tick * width + k]);

const WIDE = 1000;
const LEFT = 8;

const svg = (name, attributes, inner = "") =>
  `<${name} ${Object.entries(attributes).map(([key, value]) => `${key}="${value}"`).join(" ")}>${inner}</${name}>`;

/** SVG path of a series over the width WIDE: the least and the greatest value of each interval. */
function path(values, low, high, height) {
  const n = values.length;
  const bins = Math.min(n, WIDE / 2);
  const y = (value) => (height - ((Math.min(Math.max(value, low), high) - low) / (high - low)) * height).toFixed(1);
  let out = "";
  for (let bin = 0; bin < bins; bin += 1) {
    const [from, to] = [Math.floor((bin * n) / bins), Math.max(Math.floor((bin * n) / bins) + 1, Math.floor(((bin + 1) * n) / bins))];
    let [least, most] = [Infinity, -Infinity];
    for (let k = from; k < to; k += 1) [least, most] = [Math.min(least, values[k]), Math.max(most, values[k])];
    if (!Number.isFinite(least)) continue;
    const x = ((from / n) * WIDE).toFixed(1);
    out += `${out ? "L" : "M"}${x} ${y(least)}` + (most > least ? `L${x} ${y(most)}` : "");
  }
  return out;
}

/** One signal: title, unit, curves [{values, look}], a line at `limit`, a shade over `acts` (from, to, as shares of the time). */
export function signal({ title, unit, curves, limit, acts, height = 84 }) {
  let [low, high] = [Infinity, -Infinity];
  for (const { values } of curves) for (const value of values) if (Number.isFinite(value)) [low, high] = [Math.min(low, value), Math.max(high, value)];
  const range = `${text(low)} to ${limit === undefined ? `${text(high)} ${unit}` : length(high, limit)}`;
  if (limit !== undefined) [low, high] = [Math.min(low, 0), Math.max(high, limit * 1.15)];
  if (!(high > low)) [low, high] = [low - 1, high + 1];
  const lines = curves.map(({ values, look }) => svg("path", { d: path(values, low, high, height), class: look, "vector-effect": "non-scaling-stroke" })).join("");
  const at = limit === undefined ? "" : height - ((limit - low) / (high - low)) * height;
  const bar = limit === undefined ? "" : svg("line", { x1: 0, x2: WIDE, y1: at, y2: at, class: "limit", "vector-effect": "non-scaling-stroke" });
  const shade = acts ? svg("rect", { x: acts[0] * WIDE, width: Math.max(2, (acts[1] - acts[0]) * WIDE), y: 0, height, class: "acts" }) : "";
  return `<figure class="signal"><figcaption><b>${title}</b> <span>${range}</span></figcaption>${svg(
    "svg",
    { viewBox: `0 0 ${WIDE} ${height}`, preserveAspectRatio: "none", style: `height:${height}px`, role: "img", "aria-label": `${title}, ${range}` },
    shade + bar + lines,
  )}<i class="now"></i></figure>`;
}

/** When a fault ends, ms. */
export const ends = ({ start_ms: start, duration_ms: lasts }, duration) => (lasts === "end" ? duration : Math.min(duration, start + lasts));

export const LANES = ["Fault", "Checks", "Cue", "Harm", "Act by"];

const HARM = {
  unintended_first_ms: "unintended motion exceeds the limit",
  loss_first_ms: "loss of motion: the instrument does not follow",
  false_report_first_ms: "false report: the robot reports a wrong position of the tip",
};

/** Events of a run on lanes: [{lane, look, from, to, words}]; own: what counts as harm, if that is not the limit alone. */
export function events(outcome, fault, duration, checks, own = "") {
  const end = ends(fault, duration);
  const out = [{ lane: "Fault", look: "fault", from: fault.start_ms, to: end, words: `the fault begins; it lasts until ${millis(end)}` }];
  for (const { name, first_ms: ms } of outcome.tripped ?? [])
    out.push({ lane: "Checks", look: "check", from: ms, to: ms, words: `${checks[name]?.meaning ?? name}${checks[name]?.does ? ` (${checks[name].does})` : ""}` });
  const cue = outcome[`cue${outcome.cue_set ?? 0}_first_ms`];
  if (cue >= 0) out.push({ lane: "Cue", look: "cue", from: cue, to: cue, words: "the haptic cue begins" });
  for (const [name, words] of Object.entries(own ? { ...HARM, unintended_first_ms: own } : HARM)) if (outcome[name] >= 0) out.push({ lane: "Harm", look: "harm", from: outcome[name], to: outcome[name], words });
  return out;
}

const ACTIONS = {
  pedal: "lifting the pedal",
  estop: "pressing the E-stop",
  stop: "a stop by the software",
  hold: "holding the last good command",
};

/** Events for the last time at which each action prevents the harm; and a sentence about actions that never do. */
export function deadlines(found) {
  const words = (action) => ACTIONS[action] ?? action;
  const actions = Object.keys(found);
  const never = actions.filter((action) => found[action] < 0).map(words);
  const marks = actions.filter((action) => found[action] >= 0).map((action) => ({ lane: "Act by", look: "deadline", from: found[action], to: found[action], words: `last time at which ${words(action)} prevents the harm` }));
  return { marks, never: never.length ? `These actions come too late even right after the fault's first effect: ${never.join(", ")}.` : "" };
}

/** The lanes as HTML: a bar or a mark each, placed in percent of the run. */
export function lanes(all, duration) {
  const percent = (ms) => `${((100 * ms) / duration).toFixed(3)}%`;
  return LANES.filter((lane) => lane !== "Act by" || all.some((one) => one.lane === lane))
    .map((lane) => {
      const own = all.filter((one) => one.lane === lane);
      const marks = own
        .map(({ look, from, to, words }) => `<i class="${look}${to > from ? " spans" : ""}" style="left:${percent(from)};${to > from ? `width:max(3px,${percent(to - from)})` : ""}" title="${millis(from)}: ${words.replaceAll('"', "")}"></i>`)
        .join("");
      return `<div class="lane"><span>${lane}</span><div class="track" data-lane="${lane}">${marks || '<em>none</em>'}</div></div>`;
    })
    .join("");
}

export { LEFT, WIDE };

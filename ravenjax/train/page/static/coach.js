// Guides new operators: what to press before the time runs, and the direction to the first goal.

import { LETTERS } from "./plots.js";
import { seen } from "./sign.js";

const FINE_MM = 1; // smaller distances are not mentioned
const PRAISE_MS = 7000;
const KEYS = {
  gold: [["A", "D"], ["F", "R"], ["W", "S"]],
  green: [["←", "→"], ["PgDn", "PgUp"], ["↑", "↓"]],
};
const JAWS = { gold: ["G", "T"], green: [";", "P"] }; // close, open
const WAYS = [["left", "right"], ["down", "up"], ["away", "toward you"]];
const PADS = [["pad left", "pad right"], ["slider down", "slider up"], ["pad up", "pad down"]];

export const coarse = () => matchMedia("(pointer: coarse)").matches;

/** Steps to bring a tip to a goal, both in the world, m: [[direction, mm, key]], the longest first, at most two. */
export function steps(arm, tip, at, touch = false) {
  const way = seen(at.map((c, i) => 1000 * (c - tip[i])));
  return way
    .map((mm, k) => [WAYS[k][Number(mm > 0)], Math.abs(mm), (touch ? PADS : (KEYS[arm] ?? KEYS.gold))[k][Number(mm > 0)]])
    .filter(([, mm]) => mm >= FINE_MM)
    .sort((a, b) => b[1] - a[1])
    .slice(0, 2);
}

/** What to do at the object, or with the object at a peg. */
function graspWords(arm, holds, touch = coarse()) {
  const key = (JAWS[arm] ?? JAWS.gold)[Number(holds)];
  return holds ? `Set the object down: open the jaws${touch ? "" : ` with ${key}`}.` : `Close the jaws on the object${touch ? "" : ` with ${key}`}.`;
}

/** The steps as a sentence of DOM elements. */
export function guide(arm, tip, at, touch = coarse()) {
  /** @type {(string | Node)[]} */
  const parts = [strong(`${LETTERS[arm]}: `)];
  steps(arm, tip, at, touch).forEach(([way, mm, key], i) => {
    const press = document.createElement("kbd");
    press.textContent = key;
    parts.push(`${i ? ", then " : ""}${mm.toFixed(0)} mm ${way} `, press);
  });
  return parts;
}

function strong(text) {
  const made = document.createElement("b");
  made.textContent = text;
  return made;
}

export class Coach {
  constructor(place) {
    this.place = place;
    this.gone = false;
    this.first = null;
    this.praised = 0;
    this.said = "";
    this.text = place.querySelector("p");
    this.begin = place.querySelector(".begin");
    place.querySelector(".close").addEventListener("click", () => (this.gone = true));
    new ResizeObserver(() => this.leaveRoom()).observe(place);
  }

  /** Lets the picture end above the card on a narrow screen, so that the card hides no tip: see page.css. */
  leaveRoom() {
    const height = this.place.offsetHeight;
    document.documentElement.style.setProperty("--coach", `${height && height + 12}px`);
  }

  /** Takes the arms of a session that begins. jaws: whether its task needs them. */
  welcome(arms, jaws) {
    this.first = null;
    const off = { touch: !coarse(), typed: coarse(), jaws: !jaws };
    for (const one of this.begin.querySelectorAll("li, [data-arm]"))
      one.hidden = [...one.classList].some((kind) => off[kind]) || (one.dataset.arm ? !arms.includes(one.dataset.arm) : false);
  }

  /** Called once a frame. started: the time runs; blocked: another console drives, or the field is covered. `Why` shows the words about the pedal. */
  frame({ phase, started, down, blocked }, scope, now = performance.now()) {
    const { target } = scope;
    if (this.first === null && target >= 0 && phase !== "over") this.first = scope.progress > 0 ? -1 : target;
    const goal = scope.goal();
    let said = "";
    if (this.gone || blocked) said = "";
    else if (phase === "ready" && !started) said = "begin";
    else if (phase !== "running" || this.first === null || this.first < 0) said = "";
    else if (this.reached(scope)) said = now < this.praised ? "reached" : "";
    else if (down && goal) said = goal.distance <= goal.radius ? "hold" : "way";
    this.show(said, goal, scope);
  }

  reached(scope) {
    if (scope.progress <= 0 && scope.target === this.first) return false;
    this.praised ||= performance.now() + PRAISE_MS;
    return true;
  }

  show(said, goal, scope) {
    this.place.hidden = !said;
    this.begin.hidden = said !== "begin";
    this.text.hidden = said === "begin";
    if (said === "way") {
      const arm = goal.arm || scope.nearest(goal.at);
      const text = guide(arm, scope.tip(arm), goal.at);
      this.text.replaceChildren(...text);
    } else if (said !== this.said)
      this.text.textContent =
        {
          hold: scope.task.object ? graspWords(goal.arm || scope.nearest(goal.at), Boolean(scope.held)) : "Hold the tip in the pink circle.",
          reached: `Goal reached. When the instrument moves on its own, lift the pedal. ${coarse() ? "“more” has Rehearse, to try" : "B lets you try"} a motion on the virtual robot first.`,
        }[said] ?? "";
    this.said = said;
  }
}

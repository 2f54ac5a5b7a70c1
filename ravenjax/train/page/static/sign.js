// Shows the cue as a sign in the field: the instrument that is off course, and the cue's direction. It never flashes.

import { LETTERS } from "./plots.js";

const KEPT_MS = 500; // so that a person sees even a cue of one millisecond
const ALONG = 0.38; // directions with a smaller share are not named
const WORDS = [["left", "right"], ["down", "up"], ["away from you", "toward you"]];

/** Components along the axes of the view (right, up, toward) of a direction in the world. @type {(way: number[]) => number[]} */
export const seen = ([x, y, z]) => [x, z, -y];

/** A direction in view axes in words, its largest component first. */
export function named(way) {
  const length = Math.hypot(...way);
  if (!length) return [];
  return way
    .map((part, k) => [part / length, WORDS[k]])
    .filter(([part]) => Math.abs(part) >= ALONG)
    .sort((a, b) => Math.abs(b[0]) - Math.abs(a[0]))
    .map(([part, [less, more]]) => (part < 0 ? less : more));
}

export class CueSign {
  /** place: the sign's element; field: the element that gets a frame. */
  constructor(place, field) {
    this.place = place;
    this.field = field;
    this.until = 0;
    this.arrow = place.querySelector("svg");
    this.depth = place.querySelector("i");
  }

  /** strength: 0 to 1; way: direction in view axes. Called at least once a frame. */
  show(arm, way, strength, now = performance.now()) {
    if (strength > 0 && Math.hypot(...way) > 0) {
      this.until = now + KEPT_MS;
      const [right, up, toward] = way;
      const flat = Math.hypot(right, up) / Math.hypot(...way);
      this.arrow.style.display = flat < ALONG ? "none" : "";
      this.arrow.style.transform = `rotate(${Math.round((-180 * Math.atan2(up, right)) / Math.PI)}deg)`;
      this.depth.textContent = flat < ALONG ? (toward > 0 ? "⊙" : "⊗") : "";
      this.place.querySelector("b").textContent = `${LETTERS[arm]} off course. Lift the pedal.`;
      this.place.querySelector("span").textContent = `The cue pulls the hand ${named(way).join(", ")}.`;
      this.place.style.setProperty("--strength", String(0.45 + 0.55 * Math.min(1, strength)));
      this.place.dataset.arm = arm;
    }
    const on = now < this.until;
    if (this.place.hidden === on) this.place.hidden = !on;
    this.field.classList.toggle("cued", on);
  }
}

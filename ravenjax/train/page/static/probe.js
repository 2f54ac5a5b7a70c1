// Measures the delay from a key press to its effects. It stamps the press, and the first frame in which each of these
// changes: the hand (the delay to the session and back), the mark of the desired tip, and the tip or the force, which
// include the robot's own lag. For the mark and the tip it also stamps the time of drawing.

const MOVED_M = 2e-6;
const FORCE = 1e-4;
const LONGEST_MS = 1000;

export class Probe {
  constructor() {
    this.samples = [];
    this.waiting = null;
    this.latest = null;
  }

  pressed(stamp) {
    if (this.latest && !this.waiting) this.waiting = { stamp, from: state(this.latest), found: {} };
  }

  arrived(frame) {
    const { waiting } = this;
    this.latest = frame;
    if (!waiting) return;
    const now = state(frame);
    for (const name of ["hand", "mark", "tip"])
      if (!(name in waiting.found) && differs[name](waiting.from, now)) waiting.found[name] = frame.arrived - waiting.stamp;
    if (performance.now() - waiting.stamp > LONGEST_MS) this.waiting = null; // nothing moved: the pedal is up
  }

  /** Called in the animation frame that drew the latest frame. */
  drawn() {
    const { waiting } = this;
    if (!waiting) return;
    for (const name of ["mark", "tip"])
      if (name in waiting.found && !(`${name}_drawn` in waiting.found)) waiting.found[`${name}_drawn`] = performance.now() - waiting.stamp;
    if (!("tip_drawn" in waiting.found)) return;
    this.samples.push(waiting.found);
    this.waiting = null;
  }

  /** Medians, ms after the press, of `hand`, `mark`, `tip`, `mark_drawn`, `tip_drawn`; their number; all samples. */
  latency() {
    const median = (name) => {
      const sorted = this.samples.map((one) => one[name]).filter((ms) => ms !== undefined).sort((a, b) => a - b);
      return sorted[Math.floor(sorted.length / 2)] ?? null;
    };
    const names = ["hand", "mark", "tip", "mark_drawn", "tip_drawn"];
    return { count: this.samples.length, ...Object.fromEntries(names.map((name) => [name, median(name)])), samples: this.samples };
  }
}

function state(frame) {
  const shown = frame.number("view") === 1 ? "virtual_tip" : "tip";
  return frame.arms.map((arm) => ({
    hand: [...frame.get(`${arm}/hand`)],
    mark: [...frame.aim(arm)],
    tip: [...frame.get(`${arm}/${shown}`)],
    force: frame.peaks(arm).force,
  }));
}

const far = (a, b) => Math.hypot(...a.map((x, k) => x - b[k]));
const differs = {
  hand: (a, b) => a.some((one, i) => far(one.hand, b[i].hand) > 0),
  mark: (a, b) => a.some((one, i) => far(one.mark, b[i].mark) > MOVED_M),
  tip: (a, b) => a.some((one, i) => far(one.tip, b[i].tip) > MOVED_M || Math.abs(one.force - b[i].force) > FORCE),
};

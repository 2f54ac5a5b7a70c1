// A drill of half a minute before the session's time runs: the pedal, three directions, and an instrument that drifts.
// It never reaches the robot.

import { coarse, guide } from "./coach.js";
import { Scope } from "./scope.js";
import { seen } from "./sign.js";

const START = [0, 0, 0.195]; // m, world
const SPEED = 0.02; // m/s at full deflection
const REACH_M = 0.003;
const WALL_M = 0.04; // limit that keeps the tip in sight
const WAYS = [[0.014, 0, 0], [0, 0, 0.012], [0, 0.014, 0]]; // right, up, away
const ADRIFT = [-0.012, 0, -0.008]; // m/s of the drifting instrument
const BACK = seen(ADRIFT).map((x) => -x / Math.hypot(...ADRIFT)); // direction of the cue
const QUIET_S = [1, 2.5];
const WAIT_S = 6; // longest wait for the foot to lift
export const QUICK_S = 1; // longest time for lifting the foot; slower trainees try again
const REMOTE = { gold: [-0.06, 0.03, 0.28], green: [0.06, 0.03, 0.28] };
const FLAT = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];
const TISSUE = { top: 0.182, sag: [0, 0], half: [0.075, 0.06] };

/** The drill without its drawing: the tip and the present request. */
export class Lesson {
  constructor(arm, chance = Math.random) {
    this.arm = arm;
    this.tip = START;
    this.goals = [];
    let at = this.tip;
    for (const way of WAYS) this.goals.push((at = at.map((c, i) => c + way[i])));
    this.target = 0;
    this.stage = "pedal";
    this.chance = chance;
    this.reaction = null;
    this.tries = 0;
    this.watch();
  }

  /** How long the instrument stays still, drawn again for each try. */
  watch() {
    this.waited = 0;
    this.adrift = 0;
    this.quiet = QUIET_S[0] + this.chance() * (QUIET_S[1] - QUIET_S[0]);
  }

  /** hand: {pedal, move [right, up, toward]}; seconds since the last step. */
  step({ pedal, move }, s) {
    const { stage } = this;
    if (stage === "pedal" && pedal) this.stage = "way";
    else if (stage === "way" && !pedal) this.stage = "pedal";
    if (["way", "quiet"].includes(stage) && pedal) {
      const way = [move[0], -move[2], move[1]];
      this.tip = this.tip.map((c, i) => Math.max(START[i] - WALL_M, Math.min(START[i] + WALL_M, c + SPEED * s * way[i])));
    }
    if (stage === "way" && Math.hypot(...this.tip.map((c, i) => c - this.goals[this.target][i])) < REACH_M) {
      this.target += 1;
      if (this.target === this.goals.length) [this.stage, this.target] = ["quiet", -1];
    }
    if (stage === "quiet" && pedal) this.waited += s;
    if (stage === "quiet" && this.waited > this.quiet) this.stage = "adrift";
    if (stage !== "adrift") return;
    this.adrift += s;
    if (pedal && this.adrift < WAIT_S) this.tip = this.tip.map((c, i) => c + ADRIFT[i] * s);
    else this.lifted(pedal ? null : this.adrift);
  }

  /** Takes the seconds until the foot came up, null: never. After a slow reaction the drill restarts with a demonstration. */
  lifted(reaction) {
    this.tries += 1;
    this.reaction = reaction;
    this.stage = reaction !== null && reaction <= QUICK_S ? "done" : "quiet";
    if (this.stage === "done") return;
    this.tip = START;
    this.watch();
  }
}

export class Drill {
  /** input, haptics and sign are those of the session. */
  constructor(place, input, haptics, sign) {
    this.place = place;
    this.input = input;
    this.haptics = haptics;
    this.sign = sign;
    this.on = false;
    place.querySelector("[data-drill=again]").addEventListener("click", () => this.open(this.arm));
    place.querySelector("[data-drill=close]").addEventListener("click", () => this.close());
  }

  open(arm) {
    this.arm = arm;
    this.lesson = new Lesson(arm);
    const targets = this.lesson.goals.map((at, number) => ({ number, arm, at, radius_m: REACH_M }));
    this.scope = new Scope(this.place.querySelector("canvas"), [arm], { [arm]: { origin: [0, 0, 0], turn: FLAT, remote: REMOTE[arm] } }, TISSUE, { targets });
    this.input.mute(true);
    this.place.hidden = false;
    if (this.on) return;
    this.on = true;
    this.beat(performance.now());
  }

  close() {
    this.on = false;
    this.place.hidden = true;
    this.haptics.feel(0);
    this.input.mute(false);
  }

  beat(last) {
    requestAnimationFrame((now) => {
      if (!this.on) return;
      const { lesson } = this;
      const hand = this.input.now();
      lesson.step({ pedal: hand.pedal, move: hand.arms[this.arm]?.move ?? [0, 0, 0] }, Math.min(0.1, (now - last) / 1000));
      this.scope.draw({ number: (name) => ({ target: lesson.target, progress: lesson.target / 3 })[name] ?? 0, get: () => lesson.tip }, true);
      const force = lesson.stage === "adrift" ? 0.03 : 0;
      this.haptics.feel(force, BACK);
      this.sign.show(this.arm, BACK, force ? 0.6 : 0, now);
      this.say();
      this.beat(now);
    });
  }

  /** Words about the last try that was too slow. */
  missed() {
    const { reaction } = this.lesson;
    return reaction === null ? "You kept the pedal down" : `That took ${reaction.toFixed(1)} s`;
  }

  say() {
    const { lesson, place } = this;
    const text = place.querySelector("p");
    const pedal = coarse() ? "Hold PEDAL, or drag the pad." : "Hold SPACE.";
    if (lesson.stage === "way") text.replaceChildren(...guide(this.arm, lesson.tip, lesson.goals[lesson.target]));
    else {
      const told = {
        pedal: `${pedal} It is the foot pedal: the instrument moves only while you hold it.`,
        quiet: lesson.tries ? `${this.missed()}; the limit is ${QUICK_S} s. Try again: keep the pedal down, and watch.` : "Well done. Keep the pedal down, and watch.",
        adrift: "It moves by itself! Lift the pedal.",
        done: `You lifted the pedal after ${(lesson.reaction ?? 0).toFixed(1)} s; the limit is ${QUICK_S} s. The pedal is your brake.`,
      }[lesson.stage];
      if (text.textContent !== told) text.textContent = told;
    }
    place.querySelector("h2 span").textContent = lesson.stage === "done" ? "done" : `${Math.min(5, lesson.target < 0 ? (lesson.stage === "adrift" ? 5 : 4) : lesson.target + 1)} of 5`;
    place.dataset.stage = lesson.stage;
  }
}

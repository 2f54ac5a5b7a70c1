// Shows the instructor the trainee's state: the hands, the task's progress, and the results of hazards.

const SMOOTH = 0.1; // weight of a new value in the smoothed speed

export class TraineeCard {
  constructor(place) {
    this.place = place;
    this.rows = new Map();
  }

  welcome(arms) {
    this.scores = new Map();
    this.last = null;
    this.rows = new Map();
    this.place.replaceChildren();
    for (const name of [...arms, "pedal", "task", "hazards"]) {
      const [term, value] = [document.createElement("dt"), document.createElement("dd")];
      term.textContent = arms.includes(name) ? `${name} hand` : name;
      term.className = arms.includes(name) ? name : "";
      this.place.append(term, value);
      this.rows.set(name, value);
    }
    this.speeds = new Map(arms.map((arm) => [arm, 0]));
    this.set("hazards", "none met yet");
  }

  event({ kind, number, outcome, score }) {
    if (kind !== "hazard_over") return;
    this.scores.set(number, score ?? null);
    const counted = [...this.scores.values()].filter((one) => one !== null);
    const mean = counted.length ? `, mean score ${(counted.reduce((a, b) => a + b, 0) / counted.length).toFixed(0)} of 100` : "";
    this.set("hazards", `${this.scores.size} so far${mean}; last: ${outcome}`);
  }

  frame(frame, arms) {
    const tick = frame.number("session_tick");
    for (const arm of arms) {
      const hand = frame.get(`${arm}/hand`);
      const past = this.last?.get(arm);
      const ms = tick - (this.tick ?? tick);
      if (past && ms > 0) {
        const speed = Math.hypot(...[0, 1, 2].map((k) => hand[k] - past[k])) / ms; // um/ms is mm/s
        this.speeds.set(arm, this.speeds.get(arm) + SMOOTH * (speed - this.speeds.get(arm)));
      }
      const grasp = frame.number(`${arm}/grasp`);
      this.set(arm, `${this.speeds.get(arm).toFixed(0)} mm/s, ${grasp.toFixed(0)} mrad`);
    }
    this.last = new Map(arms.map((arm) => [arm, [...frame.get(`${arm}/hand`)]]));
    this.tick = tick;
    this.set("pedal", frame.number("pedal") === 1 ? "down" : "up");
    this.set("task", `${(100 * frame.number("progress")).toFixed(0)} %`);
  }

  set(name, text) {
    const place = this.rows.get(name);
    if (place && place.textContent !== text) place.textContent = text;
  }
}

// Shows alarms of the robot's own checks as words in the field: the cause, the robot's reaction, and what to do now.

import { coarse } from "./coach.js";

const KEPT_MS = 6000;
const STOPPED = "The robot has stopped and holds its brakes.";
const TRIAL = "Discard the trial (M), then try another motion.";
const RESTART = "Lift the pedal. Find the cause, then restart (Backspace).";

/** Words for each check that alerts a person or stops the robot. */
export const ALARMS = {
  overdrive_instant: ["A motor command was far too large", STOPPED, RESTART],
  overdrive_hard: ["Motor commands were too large for too long", STOPPED, RESTART],
  soft_estop: ["The control software has stopped itself", STOPPED, RESTART],
  plc_watchdog: ["The control computer sends no watchdog signal", STOPPED, RESTART],
  estop: ["Emergency stop", STOPPED, RESTART],
  ik_reject: ["The arm cannot reach where your hand points", "The robot ignores this step.", "Move your hand back."],
  joint_limit: ["A joint is at its limit", "The robot goes no farther in this direction.", "Move your hand back."],
  master_timeout: ["The robot receives nothing from the console", "The robot treats the pedal as up.", "Lift the pedal. Press it again once the connection is back."],
};
/** Checks that trip because another check or a person has stopped the robot. They do not replace the cause. */
export const FOLLOW = new Set(["soft_estop", "plc_watchdog", "estop"]);

/** Words for any other check. */
const other = (check) => [check.replaceAll("_", " "), "A check of the robot has tripped.", "Lift the pedal and find out why."];

export class Alarms {
  constructor(place) {
    this.place = place;
    this.until = 0;
    this.check = "";
  }

  /** Takes an event of kind "alarm" or "alarm_count". */
  tell({ check, virtual = false }, now = performance.now()) {
    if (now < this.until && FOLLOW.has(check) && ALARMS[this.check]?.[1] === STOPPED) return;
    this.until = now + KEPT_MS;
    if (check === this.check && !this.place.hidden) return;
    this.check = check;
    if (check === "estop" && !virtual) {
      this.place.hidden = true; // the banner and the line about the pedal say what a pressed E-stop does
      return;
    }
    const words = ALARMS[check] ?? other(check);
    const [matter, did, act] = virtual ? [words[0], words[1] === STOPPED ? "The virtual robot has stopped." : "This happened to the virtual robot.", TRIAL] : words;
    this.place.querySelector("b").textContent = matter;
    this.place.querySelector("span").textContent = did;
    this.place.querySelector("em").textContent = coarse() ? act.replace(" (Backspace)", "") : act;
    this.place.hidden = false;
  }

  /** Clears the words, because the robot was restarted. */
  forget() {
    this.until = 0;
    this.check = "";
    this.place.hidden = true;
  }

  /** Called once a frame. The words stay while the robot is stopped. */
  age(stopped, now = performance.now()) {
    if (this.place.hidden) return;
    if (now > this.until && !(stopped && ALARMS[this.check]?.[1] === STOPPED)) this.forget();
  }
}

// Says in one line why the robot does not move now, and what to do.

import { FOLLOW } from "./alarms.js";
import { coarse } from "./coach.js";

const RECENT_MS = 30000; // silences in this time make a connection that stutters
const USUAL_PER_S = 25; // messages, as input.js sends them
const FEW_PER_S = 15;
const IDLE_MS = 3000;
const AT_ONCE_MS = 1000; // a robot that stops within this time after a restart has the same cause as before; an assumption
const DRIVERS = { itp: "The ITP console", crtk: "A console over ROS", script: "A script" };
const SINCE = {
  resume: "The session was paused",
  restart: "The robot was restarted",
  reset: "The robot was restarted",
  handover: "This page was given control",
  silence: "The page stalled, so the robot stopped",
  silent: "The page stalled, so the robot stopped",
  left: "This page had left",
  link: "No reports of the robot arrived",
};

/** The line, "" while the robot moves. level: run level; since: why the pedal must be lifted; rate: messages that this page sends, per second; warned: the field shows a cue or an alarm; again: the robot stopped at once after a restart. */
export function reason({ link, phase, owner, view, level, live, pressed, down, idle, warned = false, since, silences, rate, check, again = false }, touch = coarse()) {
  const pedal = touch ? "PEDAL" : "SPACE";
  if (link === "down") return "No connection: the robot holds still until the session answers.";
  if (phase === "over") return "The session is over.";
  if (phase === "lost") return "No reports of the robot arrive: wait until they do.";
  if (phase === "paused") return "The instructor has paused the session: wait.";
  if (phase === "stopped") {
    const by = check ? `the check ${check.replaceAll("_", " ")}` : "an emergency stop";
    const restart = `then restart${touch ? "" : " (Backspace)"}.`;
    if (again && check) return `Stopped again at once by ${by}: the cause is still there. Lift the pedal, remove the cause, ${restart}`;
    return `Stopped by ${by}: lift the pedal, ${restart}`;
  }
  if (owner !== "page" && owner !== "nobody") return `${DRIVERS[owner] ?? owner} drives: wait, or take over while its pedal is up.`;
  if (level < 2) return "The robot is homing: wait.";
  if (pressed && !down) {
    const lift = `Let go of ${pedal}, then hold it again.`;
    if (silences > 1 || rate < FEW_PER_S)
      return `The connection stutters: ${rate < FEW_PER_S ? `${rate} of ${USUAL_PER_S} messages a second, ` : ""}${silences} silence${silences === 1 ? "" : "s"} in half a minute. ${lift}`;
    return since in SINCE ? `${SINCE[since]}. ${lift}` : lift;
  }
  if (view === "replay" && !down) return `Hold ${pedal}: the robot repeats the motion that you tried.`;
  if (!down && warned) return "The pedal is up: the robot holds still.";
  if (!down) return touch ? "Hold PEDAL, or drag a pad: the robot moves only while you do." : "Hold SPACE: the robot moves only while the pedal is down.";
  if (view === "virtual") return "The robot rests: only the virtual one follows your hands.";
  if (!live) return "The pedal is down; the robot starts to follow in a moment: wait.";
  if (idle && view === "real" && !warned) return touch ? "The pedal is down: drag a pad to move." : "The pedal is down: move with A D W S R F; / shows all keys.";
  return "";
}

export class Why {
  /** input: the hands of this window. */
  constructor(place, input) {
    this.place = place;
    this.input = input;
    this.since = "";
    this.silent = [];
    this.check = "";
    this.moved = 0;
    this.phase = "";
    this.restarted = -Infinity; // tick at which the robot was restarted, or first followed the hands afterwards
    this.again = false;
  }

  event({ kind, why, down, check, phase, virtual, tick }, now = performance.now()) {
    if (kind === "rearm") this.since = why;
    if (kind === "rearm" && why.startsWith("silen")) this.silent.push(now);
    if (kind === "pedal" && down) this.since = "";
    if (kind === "alarm" && !virtual && (!FOLLOW.has(check) || !this.check)) this.check = check;
    if (kind !== "phase") return;
    const before = this.phase;
    this.phase = phase;
    if (phase === "ready") this.check = "";
    if (phase === "ready" && before === "stopped") this.restarted = tick;
    if (phase === "running" && before === "ready" && this.restarted >= 0) this.restarted = tick;
    if (phase === "stopped" && before !== "paused") this.again = tick - this.restarted < AT_ONCE_MS;
  }

  /** Called once a frame. state: the arguments of `reason` that this object does not know. */
  frame(state, now = performance.now()) {
    const hands = Object.values(this.input.now().arms);
    if (!state.down || hands.some(({ move, turn, grasp }) => [...move, ...turn, grasp].some((x) => x !== 0))) this.moved = now;
    this.silent = this.silent.filter((at) => now - at < RECENT_MS);
    const check = ["estop", ""].includes(this.check) ? "" : this.check;
    const idle = now - this.moved > IDLE_MS;
    const text = reason({ ...state, check, again: this.again, idle, since: this.since, silences: this.silent.length, rate: this.input.rate });
    if (this.place.textContent !== text) this.place.textContent = text;
    this.place.hidden = !text;
  }
}

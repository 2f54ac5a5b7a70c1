import assert from "node:assert/strict";
import test from "node:test";

import { load } from "../../../browser_scripts.mjs";

Object.assign(globalThis, { matchMedia: () => ({ matches: false }) });
const { reason, Why } = await load("ravenjax/train/page/static/why.js");
const { lasting, refusals, trialWords } = await load("ravenjax/train/page/static/panels.js");

const DRIVES = { link: "up", phase: "running", owner: "page", view: "real", level: 3, live: true, pressed: true, down: true, idle: false, since: "", silences: 0, rate: 25, check: "" };
const told = (change) => reason({ ...DRIVES, ...change }, false);

test("one line says why the robot does not move, and what to do", () => {
  assert.equal(told({}), "", "it moves");
  for (const [change, words] of [
    [{ link: "down" }, /^No connection/],
    [{ phase: "over" }, /over/],
    [{ phase: "lost" }, /No reports/],
    [{ phase: "paused" }, /instructor has paused/],
    [{ phase: "stopped", check: "overdrive_hard" }, /check overdrive hard: lift the pedal, then restart/],
    [{ phase: "stopped" }, /an emergency stop/],
    [{ phase: "stopped", check: "overdrive_hard", again: true }, /^Stopped again at once by the check overdrive hard: the cause is still there/],
    [{ owner: "itp" }, /ITP console drives: wait/],
    [{ level: 1 }, /homing/],
    [{ down: false, since: "resume" }, /^The session was paused. Let go of SPACE, then hold/],
    [{ down: false, silences: 3, rate: 9 }, /stutters: 9 of 25 .* 3 silences .* Let go/],
    [{ down: false, pressed: false }, /^Hold SPACE/],
    [{ down: false, pressed: false, view: "replay" }, /repeats the motion/],
    [{ view: "virtual" }, /robot rests/],
    [{ live: false }, /starts to follow/],
    [{ down: false, pressed: false, warned: true }, /^The pedal is up/],
    [{ idle: true }, /move with A D W S R F/],
  ])
    assert.match(told(change), words);
});

test("silences count for half a minute, and a stop is named by its first check", () => {
  const place = {};
  const input = { rate: 25, now: () => ({ arms: {} }) };
  const why = new Why(place, input);
  for (const at of [0, 20_000, 25_000]) why.event({ kind: "rearm", why: "silence" }, at);
  const { link, phase, owner, view, level, live } = DRIVES;
  why.frame({ link, phase, owner, view, level, live, pressed: true, down: false }, 31_000);
  assert.match(place.textContent, /2 silences/);
  for (const check of ["overdrive_hard", "soft_estop", "estop"]) why.event({ kind: "alarm", check });
  why.frame({ link, phase: "stopped", owner, view, level: 0, live: false, pressed: true, down: false }, 31_000);
  assert.match(place.textContent, /overdrive hard/);
});

test("a stop within a second after a restart, or after the robot follows again, is named as such", () => {
  const again = (...phases) => {
    const why = new Why({}, {});
    for (const [phase, tick] of phases) why.event({ kind: "phase", phase, tick });
    return why.again;
  };
  const stopped = [["ready", 0], ["running", 900], ["stopped", 1000]];
  assert.equal(again(...stopped), false, "the first stop");
  assert.equal(again(...stopped, ["ready", 5000], ["stopped", 5004]), true, "before the pedal is down");
  assert.equal(again(...stopped, ["ready", 5000], ["running", 9000], ["stopped", 9100], ["paused", 9100], ["stopped", 9100]), true, "once the pedal is down");
  assert.equal(again(...stopped, ["ready", 5000], ["running", 9000], ["paused", 20_000], ["running", 20_000], ["stopped", 20_100]), false, "much later");
});

test("a button that cannot be pressed says why, and durations are short", () => {
  assert.deepEqual(refusals({ view: "real", phase: "running" }), { rehearse: "", reengage: "try a motion first", discard: "nothing was tried", restart: "the robot is not stopped" });
  assert.equal(refusals({ view: "real", phase: "ready" }).rehearse, "press the pedal once");
  assert.match(refusals({ view: "real", phase: "running", robot: "192.168.0.7" }).rehearse, /elsewhere/);
  assert.equal(refusals({ view: "virtual", phase: "running" }).reengage, "");
  assert.deepEqual([240, 2400, 28_244].map(lasting), ["240 ms", "2.4 s", "28 s"]);
});

test("a trial and its repetition say what the pedal must do now, and how much is repeated", () => {
  assert.match(trialWords("virtual", { lift: true, down: false }), /Let go of the pedal, then hold it again/);
  assert.match(trialWords("virtual", { lift: false, down: false }), /Hold the pedal/);
  assert.match(trialWords("virtual", { lift: false, down: true }), /the virtual robot follows/);
  assert.match(trialWords("replay", { lift: true, down: false, of_ms: 27_000 }), /0 of 27 s. Let go of the pedal/);
  assert.match(trialWords("replay", { lift: false, down: true, done_ms: 12_100, of_ms: 27_000 }), /12 of 27 s. Keep/);
});

import assert from "node:assert/strict";
import test from "node:test";

import { element, load } from "../../../browser_scripts.mjs";

Object.assign(globalThis, { matchMedia: () => ({ matches: false }), ResizeObserver: class { observe() {} } });
const { Scope } = await load("ravenjax/train/page/static/scope.js");
const { CueSign, named, seen } = await load("ravenjax/train/page/static/sign.js");
const { Alarms } = await load("ravenjax/train/page/static/alarms.js");
const { steps } = await load("ravenjax/train/page/static/coach.js");
const { Lesson } = await load("ravenjax/train/page/static/drill.js");

const PLAIN = { origin: [0, 0, 0], turn: [[1, 0, 0], [0, 1, 0], [0, 0, 1]] };
const TISSUE = { top: 0.18, sag: [1, 2], half: [0.075, 0.06] };

/** A scope whose tips are where `tips` says, at a goal. */
function scope(task, tips, target, progress = 0) {
  const made = new Scope({ getContext: () => null }, Object.keys(tips), Object.fromEntries(Object.keys(tips).map((arm) => [arm, PLAIN])), TISSUE, task);
  made.take({ number: (name) => ({ target, progress })[name] ?? 0, get: (name) => tips[name.split("/")[0]] });
  return made;
}
const close = (a, b) => assert.ok(Math.abs(a - b) < 1e-9, `${a} is not ${b}`);

test("of pegs and laps it is the arm's turn that the progress says", () => {
  const task = { pegs: [{ number: 0, at: [0.01, 0, 0.19], height_m: 0.006 }], object: { number: 1, at: [0, 0, 0.19] }, turns: { arms: ["gold", "green"], of: 8 } };
  const tips = { gold: [0, 0, 0.2], green: [0, 0, 0.19] };
  assert.deepEqual([0, 1, 2, 3, 8].map((placed) => scope(task, tips, 1, Math.fround(placed / 8)).turn()), ["gold", "green", "gold", "green", "gold"]);
  close(scope(task, tips, 1).goal().distance, 0.01); // L's, though R is nearer
});

test("a pull is named along the operator's view, its largest part first", () => {
  assert.deepEqual(seen([1, 2, 3]), [1, 3, -2]);
  assert.deepEqual(named([1, 0, 0]), ["right"]);
  assert.deepEqual(named([-0.6, 0.8, 0.1]), ["up", "left"]);
  assert.deepEqual(named([0, 0, -2]), ["away from you"]);
  assert.deepEqual(named([0, 0, 0]), []);
});

test("the sign points where the cue pulls, stays half a second, and says depth in a sign of its own", () => {
  const parts = { svg: element(), i: element(), b: element(), span: element() };
  const place = element({ hidden: true, style: { setProperty: () => {} }, querySelector: (name) => parts[name] });
  const field = element({ classList: { toggle: (_, on) => (field.cued = on) } });
  const sign = new CueSign(place, field);
  sign.show("green", [0, 1, 0], 0.5, 1000);
  assert.deepEqual([place.hidden, field.cued, parts.svg.style.transform, parts.b.textContent, parts.span.textContent], [false, true, "rotate(-90deg)", "R off course. Lift the pedal.", "The cue pulls the hand up."]);
  sign.show("green", [0, 1, 0], 0, 1400);
  assert.equal(place.hidden, false);
  sign.show("green", [0, 1, 0], 0, 1501);
  assert.deepEqual([place.hidden, field.cued], [true, false]);
  sign.show("gold", [0, 0, 1], 1, 2000);
  assert.deepEqual([parts.svg.style.display, parts.i.textContent, parts.span.textContent], ["none", "⊙", "The cue pulls the hand toward you."]);
});

test("what follows from a stop does not hide its cause, and words age", () => {
  const parts = { b: element(), span: element(), em: element() };
  const place = element({ hidden: true, querySelector: (name) => parts[name] });
  const alarms = new Alarms(place);
  alarms.tell({ check: "overdrive_instant" }, 0);
  for (const check of ["soft_estop", "plc_watchdog", "estop"]) alarms.tell({ check }, 50);
  assert.equal(parts.b.textContent, "A motor command was far too large");
  alarms.age(true, 60_000);
  assert.equal(place.hidden, false, "of a stop the words stay");
  alarms.age(false, 60_000);
  assert.equal(place.hidden, true);
  alarms.tell({ check: "joint_limit" }, 70_000);
  assert.deepEqual([place.hidden, parts.em.textContent], [false, "Move your hand back."]);
  alarms.age(false, 77_000);
  alarms.tell({ check: "joint_limit", virtual: true }, 78_000);
  assert.match(parts.em.textContent, /Discard the trial/);
  alarms.age(false, 85_000);
  assert.equal(place.hidden, true);
  for (const check of ["estop", "soft_estop"]) alarms.tell({ check }, 90_000);
  assert.equal(place.hidden, true, "the banner says what a pressed E-stop does");
});

test("the way to a goal is told by keys, the longest first", () => {
  assert.deepEqual(steps("gold", [0, 0, 0.2], [0.005, 0.012, 0.2005]), [["away", 12, "W"], ["right", 5, "D"]]);
  assert.deepEqual(steps("green", [0, 0, 0.2], [0, 0, 0.19]).map(([way, , key]) => [way, key]), [["down", "PgDn"]]);
  assert.deepEqual(steps("gold", [0, 0, 0.2], [-0.004, 0, 0.2], true).map(([, , key]) => key), ["pad left"]);
});

test("the drill asks for pedal, three ways and a lifted pedal, and takes the time of the foot", () => {
  const lesson = new Lesson("gold", () => 0);
  const go = (s, move, pedal = true) => {
    for (let t = 0; t < s; t += 0.02) lesson.step({ pedal, move }, 0.02);
  };
  go(1, [1, 0, 0], false);
  assert.deepEqual([lesson.stage, lesson.tip[0]], ["pedal", 0], "nothing moves without the pedal");
  go(0.7, [1, 0, 0]);
  assert.deepEqual([lesson.stage, lesson.target], ["way", 1]);
  go(0.5, [0, 1, 0]);
  assert.equal(lesson.target, 2);
  go(0.7, [0, 0, -1]);
  assert.deepEqual([lesson.stage, lesson.target], ["quiet", -1]);
  go(1.1, [0, 0, 0]);
  assert.equal(lesson.stage, "adrift");
  const at = lesson.tip[0];
  go(0.5, [0, 0, 0]);
  assert.ok(lesson.tip[0] < at - 0.004, "it moves by itself");
  lesson.step({ pedal: false, move: [0, 0, 0] }, 0.02);
  assert.equal(lesson.stage, "done");
  assert.ok(lesson.reaction > 0.4 && lesson.reaction < 0.8, `${lesson.reaction}`);
});

test("who lifts late, or never, tries again until the foot is quick", () => {
  const lesson = new Lesson("gold", () => 0);
  Object.assign(lesson, { stage: "adrift", target: -1 });
  const go = (s, pedal) => {
    for (let t = 0; t < s; t += 0.05) lesson.step({ pedal, move: [0, 0, 0] }, 0.05);
  };
  go(6.1, true);
  assert.deepEqual([lesson.stage, lesson.reaction, lesson.tries], ["quiet", null, 1]);
  go(1.3, true);
  assert.equal(lesson.stage, "adrift");
  go(1.2, true);
  go(0.01, false);
  assert.deepEqual([lesson.stage, lesson.tries, lesson.tip[0]], ["quiet", 2, 0], "1.2 s are too many");
  go(1.3, false);
  assert.equal(lesson.stage, "quiet", "nothing moves by itself while the foot is up");
  go(1.2, true);
  go(0.01, false);
  assert.deepEqual([lesson.stage, lesson.tries], ["done", 3]);
});

import assert from "node:assert/strict";
import test from "node:test";

import { load, run } from "../../../browser_scripts.mjs";

const { WORDS, clock, levelWords } = await load("ravenjax/train/page/static/panels.js");
const { fitted, niced } = await load("ravenjax/train/page/static/plots.js");
const { reached } = await load("ravenjax/train/page/static/pads.js");
const { Probe } = await load("ravenjax/train/page/static/probe.js");
const { Scope } = await load("ravenjax/train/page/static/scope.js");

test("the clock shows minutes, seconds and tenths", () => {
  assert.deepEqual([0, 9940, 59960, 65300, 600000].map(clock), ["0:00.0", "0:09.9", "1:00.0", "1:05.3", "10:00.0"]);
});

test("events are told in words", () => {
  assert.equal(WORDS.unintended_motion({ arm: "gold", mm: 3.1478 }), "unintended motion: gold arm, 3.1 mm");
  assert.equal(WORDS.loss_of_motion({ halted_ms: 250 }), "loss of motion: out of pedal-down for 250 ms");
  assert.equal(WORDS.loss_of_motion({ arm: "green", mm: "4" }), "loss of motion: green arm, 4.0 mm");
  assert.equal(WORDS.response({ what: "release", ok: false }), "response: release, not the right one");
  assert.equal(WORDS.cue({ number: -1 }), "cue without a hazard");
  assert.equal(WORDS.console({ alive: true, source: "itp" }), "console alive (itp)");
});

test("a level is told with what it asks and how the round before went", () => {
  const level = { level: 2, of: 3, title: "Be exact", within_s: 16, in_a_row: 0, needs: 2, took_ms: null, within: false };
  assert.equal(levelWords(level), "Level 2 of 3 · Be exact · a round within 16 s · 0 of 2 in a row");
  const slow = { ...level, title: "", took_ms: 18240 };
  assert.equal(levelWords(slow), "Level 2 of 3 · a round within 16 s · last round 18.2 s, too slow · 0 of 2 in a row");
  assert.equal(WORDS.level({ ...slow, within: true, in_a_row: 1 }), "Level 2 of 3 · a round within 16 s · last round 18.2 s, in time · 1 of 2 in a row");
  assert.equal(WORDS.refused({ why: "" }), "");
});

test("an axis ends at a round number that nothing drawn exceeds", () => {
  assert.deepEqual([0.9, 1, 1.2, 3.6, 5.5, 7, 9, 0.05, 42].map(niced), [1, 1, 2, 4, 6, 8, 10, 0.05, 50]);
});

test("a canvas is as sharp as the screen", () => {
  globalThis.devicePixelRatio = 1.5;
  const canvas = { clientWidth: 101, clientHeight: 40, width: 0, height: 0 };
  const turns = [];
  assert.deepEqual(fitted(canvas, { setTransform: (...numbers) => turns.push(numbers) }), [101, 40]);
  assert.deepEqual([canvas.width, canvas.height, turns], [152, 60, [[1.5, 0, 0, 1.5, 0, 0]]]);
});

test("a hand is at full speed where the pad ends", () => {
  assert.deepEqual([0, 21, -42, 90].map((px) => reached(px, 42)), [0, 0.5, -1, 1]);
});

test("a place of an arm is turned and moved into the world", () => {
  const bases = { gold: { origin: [1, 2, 3], turn: [[0, -1, 0], [1, 0, 0], [0, 0, 1]] } };
  const scope = new Scope({ getContext: () => null }, ["gold"], bases, {}, null);
  assert.deepEqual(scope.world("gold", [10, 20, 30]), [1 - 20, 2 + 10, 3 + 30]);
});

/** A frame of one arm whose tip is so far to the right. */
const frame = (x, stamp) => ({
  arms: ["gold"],
  arrived: stamp,
  number: () => 0,
  get: () => [x, 0, 0],
  aim: () => [x, 0, 0],
  peaks: () => ({ force: 0 }),
});

test("a press is timed to the first frame in which something moved, and medians are told", () => {
  const probe = new Probe();
  probe.pressed(0);
  assert.equal(probe.waiting, null, "nothing to compare with yet");
  for (const late of [30, 10, 50, 20, 40]) {
    const stamp = performance.now();
    probe.arrived(frame(0, stamp));
    probe.pressed(stamp);
    probe.arrived(frame(0, stamp + 5));
    probe.arrived(frame(1, stamp + late));
    probe.drawn();
  }
  const { count, hand, tip, samples } = probe.latency();
  assert.deepEqual([count, Math.round(hand), Math.round(tip), samples.length], [5, 30, 30, 5]);
});

/** What early.js makes of an address; kept: what the tab has remembered so far; card: who draws, as the browser says. */
function arrived(search, kept = {}, card = "ANGLE (NVIDIA RTX 2070)") {
  const shown = [];
  const window = { addEventListener: () => {}, stop: () => {} };
  const pen = card && { getExtension: (name) => (name.includes("debug") ? { UNMASKED_RENDERER_WEBGL: 1 } : null), getParameter: () => card };
  const document = { createElement: () => ({ getContext: () => pen }) };
  const history = { replaceState: (_, __, where) => shown.push(where) };
  const location = { search, origin: "http://127.0.0.1:8080", replace: (where) => (window.anew = where) };
  const crypto = { getRandomValues: (bytes) => bytes.fill(171) };
  const sessionStorage = { getItem: (name) => kept[name] ?? null, setItem: (name, text) => (kept[name] = text) };
  run("ravenjax/train/page/static/early.js", { window, history, location, document, crypto, sessionStorage, EventTarget, Element: class {}, CustomEvent });
  if (window.anew) return window;
  history.replaceState();
  return { ...window.ravenjax, full: new URLSearchParams(shown[0]), plain: shown[1] };
}

test("a window has a name and one of two roles, and its address can be sent on", () => {
  const visit = arrived("?role=instructor&quality=low&token=secret");
  assert.deepEqual([visit.role, visit.window], ["instructor", "ab".repeat(12)]);
  assert.equal(visit.full.get("websocket"), `ws://127.0.0.1:8080/scene/${"ab".repeat(12)}`);
  assert.equal(visit.full.get("fixedDpr"), "0.5");
  assert.equal(visit.plain, "?role=instructor&quality=low");
  assert.equal(arrived("?role=admin").role, "operator");
});

test("what makes an instructor stays in the tab, and is in no address", () => {
  const kept = {};
  const first = arrived("?role=instructor&instructor_token=key", kept);
  assert.deepEqual([first.token, first.plain], ["key", "?role=instructor"]);
  assert.equal(arrived("?role=instructor", kept).token, "key");
  assert.equal(arrived("?role=operator", kept).token, "");
  assert.equal(arrived("?role=instructor").token, "");
});

test("without a graphics card the 2D view comes by itself, and what is asked for counts", () => {
  for (const card of [null, "ANGLE (Google, Vulkan 1.3.0 (SwiftShader Device))", "llvmpipe (LLVM 15.0)", "Microsoft Basic Render Driver"]) {
    assert.equal(arrived("?role=operator", {}, card).anew, "?role=operator&scene=off&flat=1");
    assert.equal(arrived("?role=operator&scene=on", {}, card).plain, "?role=operator&scene=on");
  }
  assert.equal(arrived("?role=operator&scene=off").plain, "?role=operator&scene=off", "it stays when the tab is loaded anew");
  assert.equal(new URLSearchParams(arrived("?inset=second", {}, null).full).get("websocket"), `ws://127.0.0.1:8080/scene/${"ab".repeat(12)}.second`);
});

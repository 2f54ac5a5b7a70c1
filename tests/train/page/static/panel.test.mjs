import assert from "node:assert/strict";
import test from "node:test";

import { load, run } from "../../../browser_scripts.mjs";

const { Plan } = await load("ravenjax/train/page/static/hazards.js");
const { Probe } = await load("ravenjax/train/page/static/probe.js");

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

test("a plan arms one hazard after another, each at its time and none beside another", () => {
  const plan = new Plan();
  plan.add(20, 1);
  plan.add(10, 0);
  assert.equal(plan.due(9.9, true), null);
  assert.equal(plan.due(10, false), null);
  assert.equal(plan.due(12, true), 0);
  assert.equal(plan.due(25, true), 1);
  assert.equal(plan.due(99, true), null);
  plan.add(5, 7);
  plan.remove(plan.entries[0]);
  assert.equal(plan.due(99, true), null);
});

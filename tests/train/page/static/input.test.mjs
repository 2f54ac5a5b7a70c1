import assert from "node:assert/strict";
import test from "node:test";

import { element, load } from "../../../browser_scripts.mjs";

Object.assign(globalThis, { document: element({ hidden: false, hasFocus: () => true }), addEventListener: () => {}, setInterval: () => 0 });
let pad = null;
Object.defineProperty(globalThis, "navigator", { value: { getGamepads: () => [null, pad] }, configurable: true });
const { Input } = await load("ravenjax/train/page/static/input.js");

const key = (code, more = {}) => ({ code, timeStamp: 5, preventDefault: () => {}, ...more });

function made(arms = ["gold", "green"]) {
  const heard = { sent: [], pressed: [], commands: [] };
  const input = new Input(new EventTarget(), {
    send: (message) => heard.sent.push(message),
    pressed: (stamp) => heard.pressed.push(stamp),
    command: (name) => heard.commands.push(name),
  });
  Object.assign(input, { arms, enabled: true });
  pad = null;
  return { input, ...heard };
}

test("keys move each arm along its axes, and shift makes them slow", () => {
  const { input, sent, pressed } = made();
  for (const code of ["Space", "KeyD", "ArrowUp", "KeyG", "BracketRight"]) input.down(key(code));
  assert.deepEqual(sent.at(-1), {
    type: "input",
    source: "keyboard",
    pedal: true,
    arms: { gold: { move: [1, 0, 0], turn: [0, 0, 0], grasp: 1 }, green: { move: [0, 0, -1], turn: [0, -1, 0], grasp: 0 } },
  });
  assert.deepEqual(pressed, [5, 5, 5, 5], "of the pedal no answer is awaited");
  input.down(key("ShiftLeft"));
  assert.deepEqual(sent.at(-1).arms.gold, { move: [0.3, 0, 0], turn: [0, 0, 0], grasp: 1 });
  input.up(key("Space"));
  assert.equal(sent.at(-1).pedal, false);
});

test("opposite keys cancel, equal ones do not add up beyond full speed", () => {
  const { input } = made();
  for (const code of ["KeyD", "KeyA", "ArrowRight", "KeyL"]) input.down(key(code));
  assert.deepEqual([input.now().arms.gold.move, input.now().arms.green.move], [[0, 0, 0], [1, 0, 0]]);
});

test("repeats, chords of the browser and other keys say nothing; stop and restart are always heard", () => {
  const { input, sent, commands } = made();
  input.enabled = false;
  for (const one of [key("KeyD"), key("Escape"), key("Escape", { repeat: true }), key("Backspace"), key("KeyB")]) input.down(one);
  input.enabled = true;
  for (const one of [key("KeyD", { ctrlKey: true }), key("KeyD", { repeat: true }), key("F5")]) input.down(one);
  assert.deepEqual([sent, commands], [[], ["estop", "restart", "rehearse"]]);
});

test("a pad holds the pedal as long as it is held, if asked to", () => {
  const { input } = made();
  const hand = { move: [0, 0, 0], turn: [0, 0, 0], grasp: 0 };
  input.pad("gold", hand, false);
  assert.equal(input.pedal, false);
  input.pad("gold", hand, true);
  assert.equal(input.pedal, true);
  input.pad("gold", null, true);
  assert.equal(input.pedal, false);
});

test("a gamepad has a dead zone, two sticks, triggers for the jaws and shoulders for the pedal", () => {
  const { input, commands } = made();
  const button = (value) => ({ pressed: value > 0.5, value });
  const buttons = Array.from({ length: 17 }, () => button(0));
  for (const [i, value] of [[5, 1], [6, 0.75], [1, 1], [12, 1], [8, 1]]) buttons[i] = button(value);
  pad = { connected: true, mapping: "standard", axes: [-1.5, 0.1, 0.5, 0], buttons };
  const { pedal, source, arms } = input.now();
  assert.deepEqual([pedal, arms.gold], [true, { move: [-1, 1, 0], turn: [0, 0, 0], grasp: 0.75 }]);
  assert.deepEqual(arms.green, { move: [0.5, 0, 0], turn: [0, 0, 0], grasp: -1 });
  assert.equal(source, "gamepad");
  input.now();
  assert.deepEqual(commands, ["rehearse"], "once for each press");
  pad = { ...pad, mapping: "" };
  assert.equal(input.now().pedal, false, "an unknown layout drives nothing");
});

test("a drill takes the hands: the session hears that they rest, and gets them back", () => {
  const { input, sent } = made();
  input.down(key("Space"));
  input.mute(true);
  input.down(key("Space"));
  input.down(key("KeyD"));
  assert.deepEqual([sent.at(-1).pedal, sent.at(-1).arms.gold.move], [false, [0, 0, 0]]);
  assert.deepEqual([input.now().pedal, input.now().arms.gold.move], [true, [1, 0, 0]]);
  input.mute(false);
  assert.equal(sent.at(-1).pedal, false, "what was held in the drill drives nothing");
  input.down(key("Space"));
  assert.equal(sent.at(-1).pedal, true);
});

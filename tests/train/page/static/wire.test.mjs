import assert from "node:assert/strict";
import test from "node:test";

import { load } from "../../../browser_scripts.mjs";

class Socket {
  static OPEN = 1;
  static all = [];
  constructor(address) {
    Object.assign(this, { address, readyState: 1, bufferedAmount: 0, sent: [] });
    Socket.all.push(this);
  }
  send(text) {
    this.sent.push(JSON.parse(text));
  }
}
const timers = [];
Object.assign(globalThis, { location: { origin: "https://robot.example:8080" }, WebSocket: Socket, setTimeout: (again, ms) => timers.push([again, ms]) });
const { Wire } = await load("ravenjax/train/page/static/wire.js");

function made(token = "") {
  const heard = [];
  const names = ["welcome", "frame", "event", "seat", "refused", "link"];
  const wire = new Wire("operator", "abc", token, Object.fromEntries(names.map((name) => [name, (told) => heard.push([name, told])])));
  return { wire, heard, socket: Socket.all.at(-1) };
}
const WELCOME = { type: "welcome", arms: ["gold", "green"], layout: { tick: [0, 1], "gold/tip": [1, 3], runlevel: [4, 1] } };

test("a frame is five numbers an arm and then the row, by the names of the welcome", () => {
  const { wire, heard, socket } = made();
  socket.onmessage({ data: new Float32Array(15).buffer });
  assert.equal(wire.frames, 0, "nothing is known of a frame before the welcome");
  socket.onmessage({ data: JSON.stringify(WELCOME) });
  socket.onmessage({ data: Float32Array.from([1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 100, 0.5, 0.25, 0.125, 3]).buffer });
  assert.deepEqual(heard.map(([name]) => name), ["link", "welcome", "frame"]);
  const frame = heard.at(-1)[1];
  assert.deepEqual([frame.number("tick"), frame.number("runlevel"), [...frame.get("gold/tip")]], [100, 3, [0.5, 0.25, 0.125]]);
  assert.deepEqual([frame.peaks("gold"), frame.peaks("green")], [{ error: 1, force: 2 }, { error: 6, force: 7 }]);
  assert.deepEqual([[...frame.aim("gold")], [...frame.aim("green")]], [[3, 4, 5], [8, 9, 10]]);
});

test("nothing is sent to a socket that is not open, and only commands to one that does not keep up", () => {
  const { wire, socket } = made();
  wire.send({ type: "input", do: 0 });
  socket.bufferedAmount = 16384;
  wire.send({ type: "operator", do: 1 });
  wire.send({ type: "input", do: 2 });
  Object.assign(socket, { bufferedAmount: 0, readyState: 0 });
  wire.send({ do: 3 });
  assert.deepEqual(socket.sent, [{ type: "input", do: 0 }, { type: "operator", do: 1 }]);
});

test("a lost socket comes back, each time later, and soon again after it was there", () => {
  const { wire, heard, socket } = made();
  timers.length = 0;
  for (let k = 0; k < 6; k += 1) wire.socket.onclose();
  assert.deepEqual(timers.map(([, ms]) => ms), [250, 500, 1000, 2000, 4000, 4000]);
  assert.deepEqual(heard.at(-1), ["link", false]);
  timers[0][0]();
  assert.notEqual(wire.socket, socket);
  wire.socket.onopen();
  wire.socket.onclose();
  assert.equal(timers.at(-1)[1], 250);
});

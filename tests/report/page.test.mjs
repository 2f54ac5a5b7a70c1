import assert from "node:assert/strict";
import test from "node:test";

import { element, run } from "../browser_scripts.mjs";

const tip = [[0, 0, 0], [1, 2, 3], [4, 5, 6], [7, 8, 9]];
const course = { time: [0, 100, 200, 300], off: [0, 1.234, 2, 3], tip, model: tip };

/** A player of a path of four points with one view, and the mark that moves in it. */
function played() {
  const [button, slider, said] = [element(), element({ value: "0" }), element()];
  const made = [];
  const axes = { x: { low: 0, high: 10 }, y: { low: 0, high: 20 } };
  const drawing = element({
    append: (mark) => made.push(mark),
    querySelector: () => ({ getBBox: () => ({ x: 10, y: 50, width: 200, height: 100 }) }),
  });
  const inside = { svg: drawing, script: { textContent: JSON.stringify(axes) } };
  const view = element({ dataset: { sides: "0 2" }, querySelector: (what) => inside[what] });
  const player = element({ dataset: { path: "path-0" }, children: [button, slider, said] });
  const document = element({
    createElementNS: () => element({ dataset: {} }),
    getElementById: (id) => ({ textContent: id === "path-0-course" ? JSON.stringify(course) : "" }),
    querySelectorAll: (what) => (what === ".player" ? [player] : what.startsWith("[data-views='path-0']") ? [view] : []),
  });
  const waiting = [];
  const performance = { now: () => 1000 };
  run("ravenjax/report/templates/page.js", { document, performance, requestAnimationFrame: (step) => waiting.push(step) });
  return { button, slider, said, mark: made.find((mark) => mark.dataset.of === "tip"), waiting };
}

test("the mark stands where the path is at the slider, in the view's own scale", () => {
  const { slider, said, mark } = played();
  slider.value = "1";
  slider.listeners.input();
  assert.equal(said.textContent, "100 ms, 1.23 mm off the model");
  assert.deepEqual([mark.attributes.cx, mark.attributes.cy], [10 + 200 * (1 / 10), 50 + 100 * ((20 - 3) / 20)]);
});

test("it plays at a third of the speed, to the end, and begins anew from there", () => {
  const { button, slider, waiting } = played();
  button.listeners.click();
  assert.equal(button.textContent, "stop");
  waiting.shift()(1000 + 3 * 150);
  assert.equal(slider.value, 2);
  waiting.shift()(1000 + 3 * 1000);
  assert.deepEqual([slider.value, button.textContent, waiting.length], [3, "play", 0]);
  button.listeners.click();
  waiting.shift()(1000);
  assert.equal(slider.value, 0);
});

test("a second click stops it, and what was asked of the screen does nothing any more", () => {
  const { button, slider, waiting } = played();
  button.listeners.click();
  button.listeners.click();
  waiting.shift()(1e6);
  assert.deepEqual([button.textContent, slider.value], ["play", 0]);
});

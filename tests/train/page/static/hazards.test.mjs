import assert from "node:assert/strict";
import test from "node:test";

import { load } from "../../../browser_scripts.mjs";

const { Plan, fits, grouped } = await load("ravenjax/train/page/static/hazards.js");

const ONE = { number: 0, hazard: "B11", title: "Motor command random", layer: "USB boards", right_response: ["stop"] };
const OTHER = { number: 1, hazard: "K22", title: "Faulty gain", layer: "control", right_response: ["release"] };

test("every word that is looked for must be there, wherever it stands", () => {
  assert.ok(fits(ONE, "") && fits(ONE, "b11") && fits(ONE, "USB random") && fits(ONE, "stop motor"));
  assert.ok(!fits(ONE, "gain") && !fits(ONE, "random release"));
});

test("groups are those of the layers, in order", () => {
  const own = { number: 2, hazard: "fault", title: "pushed", layer: "" };
  assert.deepEqual(grouped([ONE, OTHER, { ...ONE, number: 3 }, own]).map(([name, all]) => [name, all.map((one) => one.number)]), [["USB boards", [0, 3]], ["control", [1]], ["others", [2]]]);
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

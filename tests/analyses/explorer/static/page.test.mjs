import assert from "node:assert/strict";
import test from "node:test";

import { load } from "../../../browser_scripts.mjs";

const scripts = "ravenjax/analyses/explorer/static/";
const { levels } = await load(`${scripts}field.js`);
const { read, toml, written } = await load(`${scripts}address.js`);
const { smallest } = await load(`${scripts}smallest.js`);
const { answer, classOf, count, length, told } = await load(`${scripts}verdicts.js`);
const { axisOf, nearest, words: faultWords } = await load(`${scripts}axes.js`);
const { Table, shares } = await load(`${scripts}table.js`);
const { chain, events } = await load(`${scripts}course.js`);
const { csv } = await load(`${scripts}saving.js`);

const campaign = {
  duration_ms: 3000,
  tick_ms: 1,
  toml: '[campaign]\nname = "x"\n',
  varied: ["operator.scale"],
  cues: { threshold_mm: [3, 2], kp_per_mm: [0.0045, 0.0045], kd_per_mm_s: [9e-5, 9e-5], cap: [0.05, 0.05] },
  effects: { overwrite: { value: "number", words: "replaced by" }, stuck: { value: "", words: "stuck" } },
  values: { "usb_out/overwrite": [-20_000, 20_000] },
  sites: [{ site: "usb_out", words: "the motor command", channels: [{ name: "elbow", unit: "counts", whole: true, bits: 16, low: -32_768, high: 32_767, usual: [-900, 1300] }] }],
};
const fault = { site: "usb_out", arm: "gold", channel: "elbow", effect: "overwrite", value: -9000, start_ms: 900, duration_ms: "end" };

test("a map asks each of its points once, and 441 of 1681 before the finest", () => {
  const all = levels(41, 41);
  const points = all.flatMap(({ points: own }) => own.map(([i, j]) => 41 * j + i));
  assert.equal(points.length, 1681);
  assert.equal(new Set(points).size, 1681);
  assert.deepEqual(all.map(({ points: own }) => own.length), [36, 85, 320, 1240]);
  assert.equal(levels(7, 41)[0].points.length, 7 * 6, "an axis of few values has no coarse level");
});

test("an address says what the page shows", () => {
  const state = { fault, across: "value", up: "start_ms", motion: "circle", changes: { "operator.scale": 0.2, "haptics.cues.0.threshold_m": 0.002 }, open: true, ms: 917 };
  assert.deepEqual(read(written(state)), state);
  assert.equal(read(""), null);
});

test("a campaign file holds the fault, changed cues as lists, and what the campaign varies", () => {
  const text = toml(campaign, { fault, changes: { "haptics.cues.1.threshold_m": 0.0025, "plant.mass_scale": 2 } }, true, { "operator.scale": 0.1 });
  assert.match(text, /threshold_mm = \[3, 2\.5\]/);
  assert.match(text, /\[group\.parameters\]\noperator\.scale = 0\.1\nplant\.mass_scale = 2\n/);
  assert.match(text, /site = "usb_out"\narm = "gold"\nchannel = "elbow"\neffect = "overwrite"\nvalue = -9000\nstart_ms = 900\nduration_ms = "end"\n$/);
  assert.doesNotMatch(toml(campaign, { fault: { ...fault, effect: "stuck" }, changes: {} }, false, {}), /value/);
});

test("a campaign file has the motion that was chosen", () => {
  const own = { ...campaign, toml: '[campaign]\nname = "x"\n[operator]\nmotion = "suture"\nseed = 1\n' };
  assert.match(toml(own, { fault, motion: "circle", changes: {} }, true, {}), /\[operator\]\nmotion = "circle"\nseed = 1\n/);
  assert.match(toml(own, { fault, motion: null, changes: {} }, true, {}), /\[operator\]\nmotion = "suture"\nseed = 1\n/);
});

test("a folder's share has an interval only where its faults were drawn", () => {
  const some = { k: 53, n: 300, value: 53 / 300, low: 0.137, high: 0.224 };
  assert.equal(shares(some), "Of 300 distinct faults, 53 evade every safety check and do harm: 18 % (95 % interval 14 % to 22 %). ");
  assert.match(shares({ ...some, low: null, high: null }), /chosen, not drawn/);
  assert.equal(shares({ ...some, n: 0 }), "");
});

test("what happened is told in words, with its time", () => {
  const checks = { estop: { meaning: "run level 0 entered", does: "stops the robot" } };
  const outcome = { tripped: [{ name: "estop", first_ms: 950 }], cue0_first_ms: 930, unintended_first_ms: 940, loss_first_ms: -1, false_report_first_ms: -1 };
  const happened = events(outcome, { ...fault, duration_ms: 64 }, 3000, checks);
  assert.deepEqual(happened.map(({ lane, from }) => [lane, from]), [["Fault", 900], ["Checks", 950], ["Cue", 930], ["Harm", 940]]);
  assert.equal(happened[0].words, "the fault begins; it lasts until 964 ms");
  assert.equal(happened[1].words, "run level 0 entered (stops the robot)");
});

test("the smallest harmful value is found to its last whole number, on both sides, or not at all", async () => {
  for (const [to, edge] of [
    [20_000, 4711],
    [-20_000, -613],
  ]) {
    const ask = (values) => Promise.resolve(values.map((value) => ({ harm: Math.abs(value) >= Math.abs(edge) })));
    const found = await smallest(ask, 0, to, true, ({ harm }) => harm);
    assert.equal(found.value, edge);
    assert.equal(found.safe, edge - Math.sign(edge));
    assert.ok(found.runs < 25);
  }
  assert.equal(await smallest((values) => Promise.resolve(values.map(() => ({}))), 0, 10, true, ({ harm }) => harm), null);
});

test("classes are those of a report, and the answer counts them", () => {
  const outcome = (response, hazard, cue, failed = "") => ({ response, hazard, cue, failed, cue0_first_ms: 5, unintended_first_ms: 7, evades: hazard === "unintended motion" && ["silent", "limited"].includes(response) });
  const all = [
    [outcome("stopped", "unintended motion", true), "stopped"],
    [outcome("limited", "unintended motion", true), "felt"],
    [outcome("silent", "unintended motion", false), "unseen"],
    [outcome("silent", "loss of motion", true), "lost"],
    [outcome("silent", "none", true), "phantom"],
    [outcome("limited", "none", false), "limited"],
    [outcome("silent", "none", false, "tip not finite"), "failed"],
  ];
  for (const [one, name] of all) assert.equal(classOf(one), name);
  const counted = count(all.map(([one]) => one));
  assert.deepEqual([counted.all, counted.evading], [7, 2]);
  const said = "Of 7 faults like this, 2 evade every safety check and move the instrument more than 3 mm; the surgeon feels a cue in 1";
  assert.equal(answer(counted, 3, 2).join(""), `${said}, always before the 3 mm.`);
  assert.equal(answer(counted, 3, 3).join(""), `${said}.`);
});

test("a cue that the run without a fault has as well is said to warn of none", () => {
  const harm = { response: "silent", hazard: "unintended motion", evades: true, cue: false, cue0_first_ms: 679, unintended_first_ms: 738 };
  const always = answer(count([{ ...harm, golden_cue0_first_ms: 679 }]), 3, 2)[2];
  assert.match(always, /the cue comes without a fault, too, at 679 ms, so it warns of none\.$/);
  assert.match(answer(count([{ ...harm, cue0_first_ms: -1, golden_cue0_first_ms: -1 }]), 3, 2)[2], /the surgeon feels no cue\.$/);
});

test("axes hold their range, and the nearest of a growing axis is by ratio", () => {
  const size = axisOf(campaign, fault, "value", []);
  assert.deepEqual([size.values.length, size.values[0], size.values[20], size.values[40]], [41, -20_000, 0, 20_000]);
  const lasts = axisOf(campaign, fault, "duration_ms", []);
  assert.deepEqual([lasts.values[0], lasts.values.at(-1)], [1, 1024]);
  assert.deepEqual(axisOf({ ...campaign, tick_ms: 300 }, fault, "duration_ms", []).values, [300, 600, 900]);
  assert.equal(nearest({ values: [1, 10, 100], log: true }, 40), 2);
  assert.equal(nearest({ values: [1, 10, 100] }, 40), 1);
  for (const last of ["end", Infinity]) assert.equal(nearest({ values: [1, 10, 100], log: true }, last), 2);
});

test("a fault's words name the arm where there are two", () => {
  const two = { ...campaign, arms: ["gold", "green"], sites: campaign.sites.map((site) => ({ ...site, per_arm: true })) };
  assert.match(faultWords(two, fault), /^the motor command, gold arm: replaced by/);
  assert.match(faultWords({ ...two, arms: ["gold"] }, fault), /^the motor command: replaced by/);
});

test("a map has the runs of its own arm, those to the end on its last row", () => {
  const columns = { run_id: ["a", "b", "c"], index: [0, 1, 2], group: ["x", "x", "x"], verdict: ["silent/none/cue", "silent/none/cue", "silent/none/cue"], cue_ms: [1, 1, 1] };
  Object.assign(columns, { site: ["usb_out", "usb_out", "hand"], arm: ["gold", "green", ""], channel: ["elbow", "elbow", "x"], effect: ["overwrite", "overwrite", "offset"] });
  Object.assign(columns, { value: [-20_000, 0, 0], start_ms: [900, 900, 900], duration_ms: [-1, 5, 5] });
  const table = new Table(campaign, { folder: "f", cue: 0, runs: 3, rows: 3, columns }, () => {});
  const axes = { across: axisOf(campaign, fault, "value", []), up: axisOf(campaign, fault, "duration_ms", []) };
  const places = (one) => table.dots(one, axes).map(({ index, i, j }) => [index, i, j]);
  assert.deepEqual(places(fault), [[0, 0, axes.up.values.length - 1]]);
  assert.deepEqual(places({ ...fault, arm: "green" }).map(([index]) => index), [1]);
  assert.deepEqual(places({ site: "hand", channel: "x", effect: "offset" }).map(([index]) => index), [2]);
});

test("a check that limits is not passed over in silence", () => {
  const run = { failed: "", response: "limited", hazard: "loss of motion", cue: false, evades: false, unintended_mm: 0, unintended_first_ms: -1, first_active_ms: 5 };
  assert.match(told(run, 3)[0], /^A check limits a command or drops a packet/);
  assert.match(told({ ...run, response: "silent" }, 3)[0], /^No check reacts/);
});

test("a harm of one's own is named, and the limit is not", () => {
  const run = { failed: "", response: "silent", hazard: "unintended motion", cue: true, cue0_first_ms: 6, evades: true, unintended_mm: 1, unintended_first_ms: 7, first_active_ms: 5 };
  const said = [...told(run, 3, "harm fast"), ...answer(count([run]), 3, 3, "harm fast")].join(" ");
  assert.match(said, /there is harm fast\. .* has harm fast; the surgeon feels a cue in 1, always before the harm\./);
  assert.doesNotMatch(said, /3 mm|unintended/);
});

test("a cue of the same millisecond as the harm does not come before it", () => {
  const run = { failed: "", response: "silent", hazard: "unintended motion", cue: true, evades: true, unintended_mm: 4, unintended_first_ms: 7, first_active_ms: 5 };
  const said = (ms) => told({ ...run, cue0_first_ms: ms }, 3).at(-1).split(", ")[1];
  assert.deepEqual([6, 7, 9].map(said), ["1 ms before the harm.", "in the same millisecond as the harm.", "2 ms too late."]);
  const counted = count([{ ...run, cue0_first_ms: 7 }]);
  assert.deepEqual([counted.classes.felt, counted.ahead], [1, 0]);
});

test("a chain begins with what differed first, of one tick in the robot's order", () => {
  const golden = { brakes: Float32Array.of(0, 0, 0, 0), "gold/tip": new Float32Array(12), "gold/dac_cnt": new Float32Array(28) };
  const faulty = structuredClone(golden);
  faulty["gold/tip"][8] = 1;
  faulty["gold/dac_cnt"][16] = 5;
  faulty.brakes[1] = 1;
  assert.deepEqual(chain({ golden, faulty }, ["gold"], 4).map(({ ms, words }) => [ms, words.split(" ")[0]]), [
    [1, "brakes"],
    [2, "motor"],
    [2, "true"],
  ]);
});

test("a table's cells are quoted where they need it", () => {
  assert.equal(csv(["a", "b"], [{ a: 'x "y", z', b: 1 }]), 'a,b\n"x ""y"", z",1\n');
});

test("a length beside a limit has the digits that tell the two apart", () => {
  assert.deepEqual([length(3.004, 3), length(2.9996, 3), length(4.62, 3), length(3, 3), length(3.004)], ["3.004 mm", "2.9996 mm", "4.6 mm", "3 mm", "3 mm"]);
});

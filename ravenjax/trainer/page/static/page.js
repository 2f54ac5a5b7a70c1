// The session's page: puts wire, hands, plots and panels together.

import { Haptics } from "./haptics.js";
import { HazardPanel } from "./hazards.js";
import { Input } from "./input.js";
import { NextSession } from "./next.js";
import * as pads from "./pads.js";
import { Panels } from "./panels.js";
import { COLOURS, Plot } from "./plots.js";
import { Probe } from "./probe.js";
import { Scope } from "./scope.js";
import { TraineeCard } from "./trainee.js";
import { Wire } from "./wire.js";

const CAP = 0.05;
const SLOW_FPS = 20;
const $ = (id) => document.getElementById(id);
const root = $("rj");
const own = window.ravenjax;
const probe = new Probe();
const haptics = new Haptics();
let [latest, shown, plots, scope, blind] = [null, null, null, null, false];

const send = (message) => wire.send(message);
const panels = new Panels(root, send);
const hazards = new HazardPanel($("hazard-card"), $("hazards"), send);
const next = new NextSession($("next"), send, own.token);
const trainee = new TraineeCard($("trainee"));
const input = new Input(own.keys, {
  send,
  pressed: (stamp) => probe.pressed(stamp),
  command: (name) => (name === "estop" || panels.role === "operator") && send({ type: "operator", do: name }),
});
const wire = new Wire(own.role, own.window, own.token, {
  link: (up) => {
    input.enabled = up && panels.role === "operator";
    panels.link(up);
  },
  welcome,
  frame: take,
  event: (event) => {
    happened(event);
    if (event.kind === "object" && scope) scope.object = event.at;
    if (event.kind === "end") setTimeout(debrief, 500);
  },
  seat: (free) => panels.seat(free),
  refused: (why) => console.debug(`refused: ${why}`),
});

function welcome(welcomed) {
  panels.welcome(welcomed);
  input.arms = welcomed.arms;
  input.enabled = welcomed.role === "operator";
  blind = Boolean(welcomed.header.blinded) && welcomed.role !== "instructor";
  const lines = welcomed.arms.map((arm) => ({ name: arm, colour: COLOURS[arm] }));
  const limit = welcomed.header.cue_threshold_mm ?? null; // no line where the session does not name it
  plots = {
    error: new Plot($("error"), lines, { floor: 1.2 * (limit ?? 1), limit, unit: "mm", digits: 1 }),
    force: new Plot($("force"), lines, { floor: CAP, limit: null, unit: "", digits: 3 }),
  };
  scope = new Scope($("scope"), welcomed.arms, welcomed.bases, welcomed.tissue, welcomed.header.task);
  next.welcome(welcomed.header);
  hazards.welcome(welcomed.header.hazards ?? []);
  trainee.welcome(welcomed.arms);
  for (const event of welcomed.events) happened(event);
  if (welcomed.events.some((event) => event.kind === "end")) debrief();
  setTimeout(looks, 1500); // once the scene's own socket is known
}

/** An event, to everything that shows it. */
function happened(event) {
  panels.event(event);
  if (panels.role !== "instructor") return;
  hazards.event(event);
  trainee.event(event);
}

function take(frame) {
  latest = frame;
  probe.arrived(frame);
  const peaks = frame.arms.map((arm) => frame.peaks(arm));
  plots.error.add(frame.number("session_tick"), peaks.map((one) => one.error));
  plots.force.add(frame.number("session_tick"), peaks.map((one) => one.force));
  if (panels.role === "operator") haptics.feel(Math.max(...peaks.map((one) => one.force)));
}

// --- the loop's rate, as ticks that went by on the clock of this window ---

const RATE_MS = 4000;
let [marks, rate] = [[], 0]; // [tick, time], one a second at most
function measured(frame) {
  const [tick, time] = [frame.number("tick"), frame.arrived];
  if (marks.length && tick < marks.at(-1)[0]) marks = [];
  if (marks.length && time - marks.at(-1)[1] < 1000) return rate;
  marks = [...marks.filter((mark) => time - mark[1] <= RATE_MS), [tick, time]];
  if (marks.length > 1) rate = Math.round((1000 * (tick - marks[0][0])) / (time - marks[0][1]));
  return rate;
}

function draw() {
  requestAnimationFrame(draw);
  input.tell(); // gamepads have no events
  counted();
  if (!latest || latest === shown || !plots) return;
  shown = latest;
  panels.frame(latest, measured(latest), input.pedal);
  if (panels.role === "instructor") {
    hazards.frame(latest, panels.state.phase);
    next.frame(panels.state.phase);
    trainee.frame(latest, latest.arms);
  }
  if (!blind) {
    for (const [name, unit, digits] of [["error", "mm", 2], ["force", "", 4]]) {
      plots[name].draw();
      const now = $(`${name}-now`);
      now.replaceChildren(
        ...latest.arms.map((arm) => {
          const value = document.createElement("em");
          value.className = arm;
          value.textContent = `${latest.peaks(arm)[name].toFixed(digits)} ${unit}`;
          return value;
        }),
      );
    }
  }
  scope.draw(latest, blind);
  const goal = scope.goal(latest.number("target"));
  $("distance").textContent = (goal?.distance ?? null) === null ? "" : `${(1000 * goal.distance).toFixed(1)} mm away`;
  $("target").dataset.arm = goal?.arm ?? "";
  probe.drawn();
}
requestAnimationFrame(draw);

// --- a machine without a graphics card: fewer shadows ---

let [frames, since, slow] = [0, performance.now(), 0];
function counted() {
  frames += 1;
  const now = performance.now();
  if (now - since < 2000) return;
  slow = (1000 * frames) / (now - since) < SLOW_FPS && !document.hidden ? slow + 1 : 0;
  [frames, since] = [0, now];
  const box = document.querySelector("[data-layer=shadows]");
  if (slow === 3 && box.checked) {
    box.checked = false;
    looks();
  }
}

// --- buttons ---

const layers = () => document.querySelectorAll("[data-layer]");
function looks() {
  for (const box of layers()) if (!box.checked || box.dataset.told) layer(box);
}
function layer(box) {
  box.dataset.told = "1";
  send({ type: "page", do: "layer", name: box.dataset.layer, on: box.checked });
}
for (const box of layers()) box.addEventListener("change", () => layer(box));
for (const button of document.querySelectorAll("[data-camera]"))
  button.addEventListener("click", () => send({ type: "page", do: "camera", name: button.dataset.camera }));
for (const button of document.querySelectorAll("[data-operator]"))
  button.addEventListener("click", () => send({ type: "operator", do: button.dataset.operator }));
$("convert").addEventListener("click", () => send({ type: "operator", do: "note", text: "convert" }));
$("note").addEventListener("change", () => {
  if ($("note").value.trim()) send({ type: "operator", do: "note", text: $("note").value.trim() });
  $("note").value = "";
});
for (const button of document.querySelectorAll("[data-give]"))
  button.addEventListener("click", () => send({ type: "seat", do: "give", to: button.dataset.give }));
$("take").addEventListener("click", () => send({ type: "seat", do: "take" }));
for (const button of document.querySelectorAll("[data-instructor]"))
  button.addEventListener("click", () => sure(button) && send({ type: "instructor", do: button.dataset.instructor }));
$("cue").addEventListener("change", () => send({ type: "instructor", do: "cue", on: $("cue").checked }));
$("estop").addEventListener("pointerdown", () => send({ type: "operator", do: "estop" }));
$("estop").addEventListener("click", (event) => event.detail === 0 && send({ type: "operator", do: "estop" })); // by keyboard
$("help-open").addEventListener("click", () => ($("help").open ? $("help").close() : $("help").show()));
$("debrief-close").addEventListener("click", () => ($("debrief").hidden = true));
pads.build(input);
if (!document.getElementById("root")) root.classList.add("flat");
if (new URLSearchParams(location.search).get("quality") === "low") document.querySelector("[data-layer=shadows]").checked = false;

/** The end is final: it wants a second click within three seconds. */
function sure(button) {
  if (button.dataset.instructor !== "end" || button.dataset.asked) return true;
  button.dataset.asked = "1";
  button.textContent = "Really end?";
  setTimeout(() => {
    delete button.dataset.asked;
    button.textContent = "End";
  }, 3000);
  return false;
}

/** Shows the debrief as soon as it is written. */
async function debrief() {
  for (let tries = 0; tries < 120; tries += 1) {
    const answer = await fetch("/debrief.json").then((told) => told.json(), () => ({ ready: false }));
    if (answer.ready) {
      $("debrief").querySelector("iframe").src = "/debrief.html";
      panels.debrief = () => ($("debrief").hidden = false);
      panels.debrief();
      return;
    }
    await new Promise((resolve) => setTimeout(resolve, 500));
  }
}

own.latency = () => probe.latency();
own.state = () => ({ frames: wire.frames, role: panels.role, rate, latest, strength: haptics.strength });

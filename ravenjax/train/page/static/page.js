// The main module of the session's page: connects the websocket, the hands, the plots and the panels.

import { Alarms } from "./alarms.js";
import { Coach } from "./coach.js";
import { Drill } from "./drill.js";
import { Haptics } from "./haptics.js";
import { HazardPanel } from "./hazards.js";
import { Input } from "./input.js";
import { NextSession } from "./next.js";
import * as pads from "./pads.js";
import { Panels } from "./panels.js";
import { COLOURS, LETTERS, Plot } from "./plots.js";
import { Probe } from "./probe.js";
import { Scope, TOUCH_MM } from "./scope.js";
import { CueSign, seen } from "./sign.js";
import { TraineeCard } from "./trainee.js";
import { Views } from "./views.js";
import { Why } from "./why.js";
import { Wire } from "./wire.js";

const CAP = 0.05;
const SLOW_FPS = 20;
const TEST_MS = 1200;
const UNANSWERED = 6; // requests in a row after which the server is gone
/** The element of an id; the page's HTML decides its kind. @type {(id: string) => any} */
const $ = (id) => document.getElementById(id);
const root = $("rj");
const own = window.ravenjax;
const probe = new Probe();
const haptics = new Haptics(own.keys);
const sign = new CueSign($("cue-sign"), $("field"));
const alarms = new Alarms($("alarm-words"));
const coach = new Coach($("coach"));
let [latest, shown, plots, scope, blind] = [null, null, null, null, false];
let latestWay = [0, 1, 0]; // last direction of the cue in view axes: a peak between two frames has no direction

const send = (message) => wire.send(message);
const panels = new Panels(root, send);
const hazards = new HazardPanel($("hazard-card"), $("hazards"), send);
const next = new NextSession($("next"), send, own.token);
const trainee = new TraineeCard($("trainee"));
const input = new Input(own.keys, {
  send,
  pressed: (stamp) => probe.pressed(stamp),
  command: (name) => {
    if (name === "view") views.next();
    else if (name === "estop" || panels.role === "operator") send({ type: "operator", do: name });
  },
});
const why = new Why($("why"), input);
const drill = new Drill($("drill"), input, haptics, sign);
const views = new Views(root, send);
const wire = new Wire(own.role, own.window, own.token, {
  link: (up) => {
    input.enabled = up && panels.role === "operator";
    panels.link(up);
  },
  welcome,
  frame: take,
  event: (event) => {
    happened(event);
    if (event.kind === "alarm" || event.kind === "alarm_count") alarms.tell(event);
    if (event.kind === "phase" && event.phase === "ready") alarms.forget();
    if (event.kind === "end") debrief();
  },
  seat: (free) => panels.seat(free),
  refused: (cause) => {
    console.debug(`refused: ${cause}`);
    next.refused(cause);
  },
});

function welcome(welcomed) {
  panels.welcome(welcomed);
  input.arms = welcomed.arms;
  input.enabled = welcomed.role === "operator";
  blind = Boolean(welcomed.header.blinded) && welcomed.role !== "instructor";
  const lines = welcomed.arms.map((arm) => ({ name: arm, colour: COLOURS[arm] }));
  const limit = welcomed.header.cue_threshold_mm ?? null; // no line if the session does not have it
  plots = {
    error: new Plot($("error"), lines, { floor: 1.2 * (limit ?? 1), limit, unit: "mm", digits: 1 }),
    force: new Plot($("force"), lines, { floor: CAP, limit: null, unit: "", digits: 3 }),
  };
  scope = new Scope($("scope"), welcomed.arms, welcomed.bases, welcomed.tissue, welcomed.header.task);
  for (const one of /** @type {NodeListOf<HTMLElement>} */ (document.querySelectorAll("#help [data-arm]"))) one.hidden = !welcomed.arms.includes(one.dataset.arm);
  coach.welcome(welcomed.arms, Boolean(welcomed.header.task?.object) || (welcomed.header.contact_units_per_n ?? null) !== null);
  next.welcome(welcomed.header);
  hazards.welcome(welcomed.header.hazards ?? []);
  trainee.welcome(welcomed.arms);
  for (const event of welcomed.events) happened(event);
  if (welcomed.events.some((event) => event.kind === "end")) debrief();
}

/** Passes an event to everything that shows it. */
function happened(event) {
  panels.event(event);
  why.event(event);
  if (event.kind === "object") scope?.moved(event);
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
  if (panels.role === "operator" && !drill.on) cue(frame, peaks);
}

/** Presents the stronger of the arms' cues by sound, vibration and a sign. */
function cue(frame, peaks) {
  const strongest = peaks.reduce((best, one, i) => (one.force > peaks[best].force ? i : best), 0);
  const arm = frame.arms[strongest];
  const force = frame.get(`${arm}/force`);
  const way = seen(scope.bases[arm].turn.map((row) => row[0] * force[0] + row[1] * force[1] + row[2] * force[2]));
  const length = Math.hypot(...way);
  if (length > 0) latestWay = way.map((part) => part / length);
  const pull = peaks[strongest].force;
  sign.show(arm, latestWay, Math.min(1, pull / CAP));
  const touched = touch(frame); // the stronger of the two is played, so that contact never drowns the cue
  haptics.feel(Math.max(pull, touched.force), pull >= touched.force ? latestWay : null);
}

/** Shows what the instruments press on, in words and newtons. Returns the strongest contact in device units. */
function touch(frame) {
  const gain = panels.header?.contact_units_per_n ?? null;
  if (gain === null) return { force: 0 };
  const each = frame.arms.map((arm) => {
    const [all, vessel, between] = ["contact", "vessel_n", "between_n"].map((name) => Math.hypot(...frame.get(`${arm}/${name}`)));
    const what = between > 0.05 ? "the other instrument" : vessel > 0.05 ? "the VESSEL" : "tissue";
    return { arm, all, words: `${LETTERS[arm]} presses on ${what}: ${all.toFixed(1)} N` };
  });
  const firm = each.filter((one) => one.all > 0.05);
  $("pressing").hidden = !firm.length;
  $("pressing").textContent = firm.map((one) => one.words).join(" · ");
  return { force: gain * Math.max(...each.map((one) => one.all)) };
}

// --- the loop's rate: ticks over time on this window's clock ---

const RATE_MS = 4000;
let [marks, rate] = [[], 0]; // [tick, time], at most one a second
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
  panels.frame(latest, measured(latest), input.pedal && !drill.on, scope.goal(latest.number("target"))?.arm);
  if (drill.on) panels.foot(input.pedal, "practice");
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
  const goal = scope.goal();
  $("distance").textContent = (goal?.distance ?? null) === null ? "" : `${(1000 * goal.distance).toFixed(1)} mm away`;
  $("target").dataset.arm = goal?.arm ?? "";
  $("goal-chip").firstElementChild.textContent = $("target").textContent;
  $("goal-chip").lastElementChild.textContent = $("distance").textContent;
  const { phase, owner } = panels.state;
  alarms.age(phase === "stopped");
  const apart = scope.apart();
  $("touching").hidden = !(apart < TOUCH_MM);
  if ((panels.header?.contact_units_per_n ?? null) !== null) $("touching").textContent = "The instruments push each other: move them apart.";
  const mine = panels.role === "operator" && (owner === "page" || owner === "nobody");
  const warned = !$("cue-sign").hidden || !$("alarm-words").hidden; // then hide the words about the goal
  const blocked = !mine || warned || drill.on || $("help").open || $("cue-check").open;
  const down = latest.number("pedal") === 1;
  coach.frame({ phase, started: panels.started, down, blocked }, scope);
  if (panels.role !== "operator" || drill.on) $("why").hidden = true;
  else why.frame({ ...panels.state, warned, link: root.dataset.link, level: latest.number("runlevel"), live: latest.number("live") === 1, pressed: input.pedal, down });
  if (panels.shown && (panels.shown !== "stopped" || (!$("alarm-words").hidden && !why.again))) $("why").hidden = true; // the banner or the alarm says it
  probe.drawn();
}
requestAnimationFrame(draw);
addEventListener("resize", () => (shown = null)); // also when no more frames arrive

// --- if the machine is too slow for the scene: fewer shadows, then the 2D view ---

let [frames, since, slow] = [0, performance.now(), 0];
function counted() {
  frames += 1;
  const now = performance.now();
  if (now - since < 2000) return;
  slow = (1000 * frames) / (now - since) < SLOW_FPS && !document.hidden ? slow + 1 : 0;
  [frames, since] = [0, now];
  const box = $("shadows");
  if (slow === 3) box.checked = false; // `scene.js` looks at it
  if (slow >= 6 && !input.pedal) views.flatten();
}

// --- buttons ---

// While a finger holds the pedal or a pad, browsers give no click for the tap of another finger.
addEventListener("pointerup", ({ isPrimary, target, clientX, clientY }) => {
  const button = !isPrimary && target instanceof Element && target.closest("#rj button:not(#estop)");
  if (button instanceof HTMLElement && button.contains(document.elementFromPoint(clientX, clientY))) button.click();
});

for (const button of /** @type {NodeListOf<HTMLButtonElement>} */ (document.querySelectorAll("[data-operator]")))
  button.addEventListener("click", () => {
    send({ type: "operator", do: button.dataset.operator });
    if (root.classList.contains("all")) $("more").click(); // it covers the pedal, which comes next
  });
$("convert").addEventListener("click", () => {
  send({ type: "operator", do: "note", text: "convert" });
  if (root.dataset.link === "up") panels.converted();
});
$("note").addEventListener("change", () => {
  if ($("note").value.trim()) send({ type: "operator", do: "note", text: $("note").value.trim() });
  $("note").value = "";
});
for (const button of /** @type {NodeListOf<HTMLButtonElement>} */ (document.querySelectorAll("[data-give]")))
  button.addEventListener("click", () => send({ type: "seat", do: "give", to: button.dataset.give }));
$("take").addEventListener("click", () => send({ type: "seat", do: "take" }));
for (const button of /** @type {NodeListOf<HTMLButtonElement>} */ (document.querySelectorAll("[data-instructor]")))
  button.addEventListener("click", () => sure(button) && send({ type: "instructor", do: button.dataset.instructor }));
$("cue").addEventListener("change", () => send({ type: "instructor", do: "cue", on: $("cue").checked }));
$("estop").addEventListener("pointerdown", () => send({ type: "operator", do: "estop" }));
$("estop").addEventListener("click", (event) => event.detail === 0 && send({ type: "operator", do: "estop" })); // by keyboard
const help = () => ($("help").open ? $("help").close() : $("help").show());
$("help-open").addEventListener("click", help);
$("more").addEventListener("click", () => $("more").setAttribute("aria-expanded", String(root.classList.toggle("all"))));
$("practise").addEventListener("click", () => drill.open(input.arms[0]));
for (const button of /** @type {NodeListOf<HTMLButtonElement>} */ (document.querySelectorAll(".cue-test")))
  button.addEventListener("click", () => {
    $("motors").textContent = haptics.motors();
    $("cue-check").showModal();
  });
for (const button of /** @type {NodeListOf<HTMLButtonElement>} */ (document.querySelectorAll("[data-cue]")))
  button.addEventListener("click", () => {
    const strength = Number(button.dataset.cue);
    const way = [[1, 0, 0], [0, 1, 0], [-0.6, -0.8, 0]][Math.round(2 * strength) % 3];
    haptics.voice();
    const until = performance.now() + TEST_MS;
    const play = (now) => {
      const on = now < until && $("cue-check").open;
      haptics.feel(on ? 0.05 * strength : 0, way);
      sign.show(input.arms[0] ?? "gold", way, on ? strength : 0, now);
      if (on) requestAnimationFrame(play);
    };
    requestAnimationFrame(play);
  });
own.keys.addEventListener("keydown", ({ detail }) => {
  if (detail.ctrlKey || detail.metaKey || detail.altKey || detail.repeat) return;
  if (detail.code === "Slash") help();
  if (/^Digit[1-7]$/.test(detail.code)) views.press(Number(detail.code.at(-1)));
  if (detail.code === "Enter" && detail.target.matches?.("input[type=checkbox]")) detail.target.click(); // space is the pedal
});
$("debrief-close").addEventListener("click", () => {
  $("debrief").hidden = true;
  panels.banner(); // no more frames arrive
});
pads.build(input);
if (new URLSearchParams(location.search).get("quality") === "low") $("shadows").checked = false;

/** Ending is final, so it needs a second click within three seconds. */
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

/** Shows the debrief as soon as it is written, and until then what is being done. It waits as long as the server lives. */
async function debrief() {
  const began = performance.now();
  for (let unanswered = 0; unanswered < UNANSWERED; ) {
    const answer = await fetch("/debrief.json").then((told) => told.json(), () => null);
    unanswered = answer ? 0 : unanswered + 1;
    const step = answer?.table ? "The charts are being drawn" : "The recording is being closed";
    panels.writing(`${step}: ${Math.round((performance.now() - began) / 1000)} s so far.`);
    if (answer?.ready) {
      $("debrief").querySelector("iframe").src = "/debrief.html";
      panels.debrief = () => {
        $("debrief").hidden = false;
        panels.banner();
      };
      panels.debrief();
      return;
    }
    await new Promise((resolve) => setTimeout(resolve, 500));
  }
  panels.writing("The server has ended. `ravenjax log debrief FOLDER` writes the debrief.");
}

own.latency = () => probe.latency();
own.state = () => ({ frames: wire.frames, role: panels.role, rate, latest, strength: haptics.strength, loudness: haptics.loudness ?? 0 });

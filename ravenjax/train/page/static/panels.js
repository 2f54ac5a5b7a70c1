// Fills the panel beside the plots: lamps, figures, lists, banners.

import { coarse } from "./coach.js";
import { LETTERS } from "./plots.js";

/** The element of an id; the page's HTML decides its kind. @type {(id: string) => any} */
const $ = (id) => document.getElementById(id);
/** Words for each kind of event. name: of the event's hazard. */
export const WORDS = {
  hazard_armed: (e, name) => `armed: ${name}`,
  hazard_struck: (e, name) => `became active: ${name}`,
  knowable: (e) => `first sign: ${e.by}`,
  cue: (e) => (e.number < 0 ? "cue without a hazard" : `cue on ${e.arm}`),
  stopped: (e) => `stopped by the check ${e.check}`,
  flagged: (e) => `flagged by the check ${e.check}`,
  limited: (e) => `limited by the check ${e.check}, without an alarm`,
  unintended_motion: (e) => `unintended motion: ${e.arm} arm, ${Number(e.mm).toFixed(1)} mm`,
  loss_of_motion: (e) =>
    e.halted_ms ? `loss of motion: out of pedal-down for ${lasting(e.halted_ms)}` : `loss of motion: ${e.arm} arm, ${Number(e.mm).toFixed(1)} mm`,
  false_report: (e) => `false report: ${e.arm} arm, ${Number(e.mm).toFixed(1)} mm`,
  response: (e) => `response: ${e.what}${e.ok ? "" : ", not the right one"}`,
  hazard_over: (e, name) => `${e.outcome}: ${name}`,
  alarm: (e) => `alarm${e.virtual ? " of the virtual robot" : ""}: ${e.check}`,
  phase: (e) => e.phase,
  view: (e) => `view: ${e.view}`,
  pedal: (e) => `pedal ${e.down ? "down" : "up"}`,
  owner: (e) => `${DRIVERS[e.console] ?? e.console} drives (${e.by})`,
  refused: (e) => (e.why ? `refused: ${e.why}` : ""), // empty: the reason no longer holds
  rearm: (e) => `pedal must be lifted first: ${e.why}`,
  started: (e) => `time runs: ${e.by}`,
  interrupted: (e, name) => `interrupted by ${e.by}, not scored: ${name}`,
  console: (e) => `console ${e.alive ? `alive${e.source ? ` (${e.source})` : ""}` : "silent"}`,
  runlevel: (e) => `runlevel ${e.runlevel}`,
  note: (e) => `“${e.text}”`,
  overrun: (e) => `late ticks so far: ${e.late_ticks}`,
  trouble: (e) => e.text,
  level: (e) => levelWords(e),
  task_done: () => "task done",
  end: (e) => `ended: ${e.reason}`,
};
const DRIVERS = { nobody: "nobody", page: "the page", itp: "the ITP console", script: "a script", crtk: "a console over ROS" };
const MOST_GOALS = 20; // a larger number of goals is an unlimited supply, so it is not shown
const BANNERS = {
  down: ["bad", "No connection", "The session does not answer. The pedal counts as up, so the robot holds still."],
  stopped: ["bad", "Robot stopped", "The brakes hold the robot. Find the cause, then restart.", "Restart"],
  paused: ["wait", "Paused", "The instructor has paused the session."],
  lost: ["bad", "Link to the robot lost", "No reports of the robot arrive, so its state is unknown. After a time-out the robot treats the pedal as up. The page continues when reports arrive again."],
  watcher: ["wait", "View only", "Another window holds the console."],
  scripted: ["wait", "View only", "A script drives this session."],
  keyless: ["bad", "Not an instructor", "This address has no instructor's token. Open the address that the terminal printed."],
  second: ["wait", "Another instructor is active", "You see what a watcher sees.", "Instruct too"],
  other: ["wait", "The ITP console drives", "This page watches. The E-STOP works here too.", "Take over"],
  ros: ["wait", "A console over ROS drives", "This page watches. The E-STOP works here too.", "Take over"],
  free: ["wait", "The console is free", "Nobody drives.", "Take it"],
  writing: ["wait", "Session over, writing the debrief", ""],
  over: ["wait", "Session over.", "The debrief is ready.", "Open the debrief"],
  virtual: ["virtual", "Virtual robot", ""],
  replay: ["virtual", "Repeat", ""],
};
/** A banner's text without keys, for a touch screen. */
const touched = (text) => text.replace("N:", "“more”, Re-engage:").replace("M:", "“more”, Discard:");

/** What to do in a trial ("virtual") and while the robot repeats the trial ("replay"). lift: the pedal is held but must be lifted first; done_ms of of_ms are repeated. */
export function trialWords(view, { lift, down, done_ms = 0, of_ms = 0 }) {
  const again = "Let go of the pedal, then hold it again.";
  if (view === "virtual") {
    if (lift) return `Virtual robot ready. ${again}`;
    if (!down) return "Virtual robot ready. Hold the pedal to move it; the real robot rests. N: repeat it. M: discard it.";
    return "The real robot rests; the virtual robot follows your hands. N: repeat it. M: discard it.";
  }
  const [done, of] = [done_ms, of_ms].map((ms) => Math.round(ms / 1000));
  const progress = of_ms ? `: ${Math.min(done, of)} of ${of} s` : "";
  if (lift) return `Ready to repeat your motion${progress}. ${again}`;
  if (!down) return `Ready to repeat your motion${progress}. Hold the pedal. M: discard it.`;
  return `Repeating your motion${progress}. Keep the pedal down.`;
}

/** A duration in words. */
export const lasting = (ms) => (ms < 1000 ? `${Math.round(ms)} ms` : ms < 10_000 ? `${(ms / 1000).toFixed(1)} s` : `${Math.round(ms / 1000)} s`);

/** Why the operator's buttons cannot be pressed now, by their names; "": they can. */
export function refusals({ view, phase, robot = "virtual" }) {
  const trial = view === "virtual";
  const begin = { ready: "press the pedal once", paused: "wait for the end of the pause", stopped: "restart the robot first" }[phase] ?? "start a session first";
  return {
    rehearse: robot !== "virtual" ? "use a robot on this machine; a robot elsewhere has no virtual copy" : view !== "real" ? "end this trial first" : phase === "running" ? "" : begin,
    reengage: trial ? "" : "try a motion first",
    discard: view === "real" ? "nothing was tried" : "",
    restart: phase === "stopped" ? "" : "the robot is not stopped",
  };
}

/** The level, its requirements, and the result of the last round. */
export function levelWords({ level, of, title, within_s, in_a_row, needs, took_ms, within }) {
  const row = `${in_a_row} of ${needs} in a row`;
  const before = took_ms === null ? "" : ` · last round ${(took_ms / 1000).toFixed(1)} s, ${within ? "in time" : "too slow"}`;
  return `Level ${level} of ${of}${title ? ` · ${title}` : ""} · a round within ${within_s} s${before} · ${row}`;
}

export class Panels {
  constructor(root, send) {
    this.root = root;
    this.send = send;
    this.shown = "";
    this.said = "";
    this.free = false;
    this.titles = new Map(); // of buttons, while they can be pressed
    this.late = null; // the log's line about late ticks
    this.debrief = null; // opens the debrief once it exists
    $("banner").querySelector("button").addEventListener("click", () => this.act());
  }

  welcome({ role, instructs, header, arms, run_levels, phases, views, consoles }) {
    this.role = role;
    this.instructs = instructs;
    this.header = header;
    this.arms = arms;
    this.phases = phases;
    this.views = views;
    this.consoles = consoles;
    this.started = false;
    this.zero = 0; // tick at which the session's time began
    this.before = null; // view and tick of the last frame
    this.driven = { virtual: 0, replay: 0 }; // ms with the pedal down in the last trial and its repetition
    set("convert-note", "");
    this.left = Infinity;
    this.whole = 1000 * (header.scenario?.duration_s ?? 0);
    this.ran = 0;
    set("left-word", "left, waits");
    set("level-words", "");
    $("console-card").hidden = (header.consoles ?? []).length < 2;
    this.root.dataset.role = role;
    $("role").textContent = role === "watcher" ? "view only" : role;
    $("title").textContent = header.title || header.name || "";
    $("about").textContent = header.description ?? "";
    $("task-kind").textContent = (header.task?.kind ?? "").replaceAll("_", " ");
    $("who").textContent = header.participant ?? "";
    $("blinded").hidden = !header.blinded;
    $("cue-box").hidden = Boolean(header.blinded);
    const hidden = Boolean(header.blinded) && role !== "instructor";
    for (const id of ["error-card", "force-card"]) $(id).hidden = hidden;
    for (const pad of /** @type {NodeListOf<HTMLButtonElement>} */ (document.querySelectorAll("#hands .pad"))) pad.hidden = !arms.includes(pad.dataset.arm);
    for (const id of ["runlevel", "alarms", "log"]) $(id).replaceChildren();
    for (const [level, name] of run_levels.entries()) {
      const lamp = element("li", "", name);
      lamp.dataset.level = level;
      $("runlevel").append(lamp);
    }
    $("alarms").append(element("li", "none", "no alarm"));
    this.alarms = new Map();
  }

  event(event) {
    if (event.kind === "started") this.start(event.tick);
    if (event.kind === "alarm" || event.kind === "alarm_count") this.alarm(event);
    if (event.kind === "refused") set("console-note", event.why);
    if (event.kind === "level") set("level-words", levelWords(event));
    if (event.kind === "owner") set("console-note", "");
    if (!$("log") || this.role !== "instructor") return;
    const hazard = this.header.hazards?.find(({ number }) => number === event.number);
    const said = WORDS[event.kind]?.(event, hazard?.title || hazard?.hazard || "the hazard");
    if (said) {
      const item = element("li", "", this.time(event.tick), element("span", "", said));
      if (event.kind === "overrun") {
        this.late?.remove(); // one line for all
        this.late = item;
      }
      $("log").prepend(item);
      while ($("log").children.length > 200) $("log").lastChild.remove();
    }
  }

  /** Notes that the session's time runs since this tick. */
  start(tick) {
    this.started = true;
    this.zero = tick;
    set("left-word", "left");
  }

  /** The session's time of a tick; "–": before the time ran. */
  time(tick) {
    return element("time", "", this.started && tick >= this.zero ? clock(tick - this.zero) : "–");
  }

  /** Lists each check once, with its number of trips; a trip counts once a millisecond and arm. */
  alarm({ tick, check: name, count: told, virtual }) {
    const check = virtual ? `virtual robot: ${name}` : name;
    const known = this.alarms.get(check);
    known?.item.remove();
    const count = told ?? (known?.count ?? 0) + 1;
    const item = element("li", "alarm", this.time(tick), element("span", "", String(check).replaceAll("_", " ") + (count > 1 ? ` ×${count}` : "")));
    item.title = `${count} trips, at most one per millisecond and arm`;
    this.alarms.set(check, { item, count });
    $("alarms").querySelector(".none")?.remove();
    $("alarms").prepend(item);
  }

  /** turn: the arm whose turn it is, "" if either may act. */
  frame(frame, rate, pressed, turn = "") {
    const phase = this.phases[frame.number("phase")] ?? "";
    const view = this.views[frame.number("view")] ?? "real";
    this.root.dataset.phase = phase;
    set("phase", phase);
    const level = frame.number("link") === 1 && phase !== "over" ? String(frame.number("runlevel")) : ""; // the run level of a lost robot is unknown
    for (const lamp of $("runlevel").children) lamp.classList.toggle("on", lamp.dataset.level === level);
    const left = frame.number("left_ms");
    this.whole = Math.max(this.whole, left);
    const tick = frame.number("session_tick");
    if (!this.started && left < this.left && this.left < Infinity) this.start(tick - this.whole + left); // it began before this page was open
    if (phase !== "over") this.ran = this.started ? tick - this.zero : 0;
    set("clock", clock(this.ran));
    this.left = left;
    set("left", clock(left));
    set("rate", `${rate} Hz`);
    set("compute", `${frame.number("compute_us").toFixed(0)} µs`);
    set("lateness", `${frame.number("lateness_us").toFixed(0)} µs`);
    const late = frame.number("late_ticks");
    set("late", String(late));
    $("late-box").classList.toggle("bad", late > 0);
    const target = frame.number("target");
    set("target", this.goal(target) + (turn ? `, ${LETTERS[turn]} ${turn}` : ""));
    set("percent", `${(100 * frame.number("progress")).toFixed(0)} %`);
    $("progress").style.width = `${100 * frame.number("progress")}%`;
    const over = phase === "over";
    const down = frame.number("pedal") === 1 && !over;
    const owner = this.consoles?.[frame.number("console")] ?? "nobody";
    const mine = owner === "page" || owner === "nobody";
    this.lift = pressed && !down && mine && ["ready", "running"].includes(phase); // a held pedal that does not count
    this.follow(view, frame.number("session_tick"), down);
    this.foot(down, down ? (frame.number("live") === 1 ? "down, driving" : "down") : this.lift ? "lift it first" : over ? "session over" : "up");
    $("pedal").classList.toggle("rearm", this.lift);
    this.seated(owner, frame.number("pedal") === 1, phase);
    set("view-name", view === "real" ? "real field" : view === "virtual" ? "virtual field" : "robot follows");
    const not = refusals({ view, phase, robot: this.header.robot });
    for (const button of /** @type {NodeListOf<HTMLButtonElement>} */ (document.querySelectorAll("[data-operator]"))) {
      const reason = not[button.dataset.operator];
      this.titles.set(button, this.titles.get(button) ?? button.title);
      button.disabled = Boolean(reason);
      button.title = reason ? `Not now: ${reason}.` : this.titles.get(button);
    }
    const waits = phase === "ready" && !this.started;
    $("convert").disabled = over || waits;
    $("convert").title = !waits ? "stop using the robot and convert to open surgery" : "Not now: start the session with the pedal.";
    const hidden = this.root.classList.contains("all") && phase === "ready"; // "more" covers the pedal
    set("virtual-note", not.rehearse && view === "real" && !over ? `To rehearse: ${hidden ? `close “more”, ${not.rehearse}, then come back` : not.rehearse}.` : "");
    if (this.role === "instructor") this.instructor(frame, phase);
    this.state = { phase, view, owner, down };
    this.banner();
  }

  /** Counts the time with the pedal down in a trial and in its repetition. */
  follow(view, tick, down) {
    if (view === "virtual" && this.before?.view !== "virtual") this.driven = { virtual: 0, replay: 0 };
    if (view in this.driven && this.before?.view === view && this.before.down && down) this.driven[view] += Math.max(0, tick - this.before.tick);
    this.before = { view, tick, down };
  }

  /** Shows that the conversion to open surgery is in the record. */
  converted() {
    set("convert-note", `Recorded at ${clock(this.ran).slice(0, -2)}: convert`);
  }

  /** The text on the pedal. */
  foot(down, text) {
    $("pedal").classList.toggle("down", down);
    set("pedal-state", text);
  }

  /** Shows who drives, and the changes that are possible now. */
  seated(owner, down, phase) {
    set("owner", DRIVERS[owner] ?? owner);
    const [instructor, over] = [this.role === "instructor", phase === "over"];
    $("take").hidden = this.role !== "operator";
    $("take").disabled = owner === "page" || down || over;
    for (const button of /** @type {NodeListOf<HTMLButtonElement>} */ (document.querySelectorAll("[data-give]"))) {
      const { give } = button.dataset;
      button.hidden = this.role === "watcher" || (give === "page" && !instructor);
      button.disabled = owner === give || over || (!instructor && owner !== "page" && owner !== "nobody");
    }
  }

  goal(target) {
    const { object, pegs = [], targets = [] } = this.header.task ?? {};
    if (target < 0) return "no goal now";
    if (object?.number === target) return "fetch the object";
    if (pegs.length) return `to peg ${target + 1}`;
    return `goal ${target + 1}${targets.length && targets.length <= MOST_GOALS ? ` of ${targets.length}` : ""}`;
  }

  instructor(frame, phase) {
    const on = frame.number("hazard");
    const can = { start: !this.started && phase !== "over", pause: phase !== "paused" && phase !== "over", resume: phase === "paused", reset: phase !== "over", end: phase !== "over", disarm: on >= 0 && phase !== "over" };
    for (const button of /** @type {NodeListOf<HTMLButtonElement>} */ (document.querySelectorAll("[data-instructor]"))) button.disabled = !can[button.dataset.instructor];
    if (document.activeElement !== $("cue")) $("cue").checked = frame.number("cue_on") === 1;
  }

  link(up) {
    this.root.dataset.link = up ? "up" : "down";
    if (!up) set("phase", "no connection");
    this.banner();
  }

  seat(free) {
    this.free = free;
    this.banner();
  }

  banner() {
    const { phase, view, owner, down } = this.state ?? {};
    const over = phase === "over";
    let kind = "";
    if (over) kind = !this.debrief ? "writing" : document.getElementById("debrief").hidden ? "over" : "";
    else if (this.root.dataset.link === "down") kind = "down";
    else if (this.role === "watcher") kind = this.watching();
    else if (phase === "lost") kind = "lost";
    else if (phase === "stopped") kind = "stopped";
    else if (phase === "paused") kind = "paused";
    else if (view === "virtual" || view === "replay") kind = view;
    else if (this.role === "operator" && owner === "itp") kind = "other";
    else if (this.role === "operator" && owner === "crtk") kind = "ros";
    const banner = $("banner");
    const [look, head, usual, act] = BANNERS[kind] ?? ["", "", ""];
    const trial = { lift: this.lift, down, done_ms: this.driven?.replay, of_ms: this.driven?.virtual };
    const told = kind === "writing" ? (this.progress ?? "") : kind === "virtual" || kind === "replay" ? trialWords(kind, trial) : usual;
    const text = coarse() ? touched(told) : told;
    if (kind === this.shown && text === this.said) return;
    [this.shown, this.said] = [kind, text];
    banner.hidden = !kind;
    if (!kind) return;
    banner.dataset.kind = look;
    banner.querySelector("b").textContent = head;
    banner.querySelector("span").textContent = text;
    const button = banner.querySelector("button");
    button.hidden = !act || (kind === "stopped" && this.role === "instructor");
    button.textContent = act ?? "";
  }

  /** Shows the progress of the debrief. */
  writing(text) {
    this.progress = text;
    this.banner();
  }

  watching() {
    if (window.ravenjax.role === "instructor") return this.instructs ? "second" : "keyless";
    if ((this.header?.consoles ?? []).includes("script")) return "scripted";
    return this.free ? "free" : "watcher";
  }

  act() {
    if (this.shown === "second") this.send({ type: "page", do: "instruct" });
    if (this.shown === "other") this.send({ type: "seat", do: "take" });
    if (this.shown === "free") this.send({ type: "page", do: "take" });
    if (this.shown === "over") this.debrief();
    if (this.shown === "stopped") this.send({ type: "operator", do: "restart" });
  }
}

function set(id, text) {
  const place = $(id);
  if (place.textContent !== text) place.textContent = text;
}

function element(tag, kind, ...parts) {
  const made = document.createElement(tag);
  if (kind) made.className = kind;
  made.append(...parts);
  return made;
}

export const clock = (ms) => {
  const tenths = Math.round(ms / 100);
  return `${Math.floor(tenths / 600)}:${((tenths % 600) / 10).toFixed(1).padStart(4, "0")}`;
};

// Shows one run in detail: the robot in three dimensions, its time line, its signals, and a second run to compare.

import { chain, column, deadlines, ends, events, lanes, signal } from "./course.js";
import { length, millis, told } from "./verdicts.js";
import { View } from "./view.js";

/** The element of an id; the page's HTML decides its kind. @type {(id: string) => any} */
const $ = (id) => document.getElementById(id);
const MOST_LINKS = 12;

/** An item of a list: when, and what in words. */
function line(ms, words) {
  const item = document.createElement("li");
  item.innerHTML = `<time>${millis(ms)}</time><span></span>`;
  item.lastChild.textContent = words;
  return item;
}

export class Run {
  /** figure(): JSON text of `describe_figure`, or "null"; heard: {moved(ms), dragged(start_ms)}. */
  constructor(campaign, figure, heard) {
    this.campaign = campaign;
    this.heard = heard;
    this.description = figure;
    this.replay = null;
    this.acting = { marks: [], never: "" };
    this.kept = null;
    this.ms = 0;
    this.playing = false;
    $("time").max = campaign.duration_ms - 1;
    $("time").addEventListener("input", () => this.go(Number($("time").value)));
    $("play").addEventListener("click", () => this.play(!this.playing));
    $("to-fault").addEventListener("click", () => this.go(Math.max(0, this.fault.start_ms - 20)));
    this.draggable();
  }

  /** Shows a run part by part, so that the page stays responsive. A newer run ends it. */
  async show(replay, fault, ms) {
    this.replay = replay;
    this.fault = fault;
    this.acting = { marks: [], never: "" };
    this.lanes();
    this.go(ms > 0 ? ms : this.interesting());
    for (const part of ["stand", "signals", "chain", "numbers"]) {
      await new Promise((resolve) => setTimeout(resolve));
      if (this.replay !== replay) return;
      this[part]();
    }
  }

  /** Shows until when each action prevents the harm of a run; found: of `Engine.deadlines`. */
  actBy(replay, found) {
    if (this.replay !== replay) return;
    this.acting = deadlines(found);
    this.lanes();
  }

  /** Draws the robot once the first run is shown. */
  stand() {
    if (this.figure !== undefined) return;
    const description = this.description();
    const shown = (there) => (/** @type {HTMLElement} */ (document.querySelector(".stage")).hidden = !there);
    this.figure = description === "null" ? null : new View($("figure"), description, shown);
    if (this.figure) this.go(this.ms);
    else shown(false);
  }

  /** Draws the events over time. The bar that the user drags stays the same element. */
  lanes() {
    const { duration_ms: duration, checks } = this.campaign;
    const place = $("lanes");
    const happened = [...events(this.replay.outcome, this.fault, duration, checks, this.campaign.harm), ...this.acting.marks];
    $("never").textContent = this.acting.never;
    const html = lanes(happened, duration);
    $("events").replaceChildren(...[...happened].sort((a, b) => a.from - b.from).map(({ from, words }) => line(from, words)));
    if (!this.dragging) {
      place.innerHTML = html;
      return;
    }
    const fresh = document.createElement("div");
    fresh.innerHTML = html;
    for (const lane of ["Checks", "Cue", "Harm"]) place.querySelector(`[data-lane=${lane}]`).replaceWith(fresh.querySelector(`[data-lane=${lane}]`));
  }

  /** The first time to show, ms: the first harm, or shortly after the start of the fault. */
  interesting() {
    const { outcome } = this.replay;
    const harm = [outcome.unintended_first_ms, outcome.loss_first_ms, outcome.false_report_first_ms].filter((ms) => ms >= 0);
    return harm.length ? Math.min(...harm) : Math.min(this.campaign.duration_ms - 1, this.fault.start_ms + 50);
  }

  go(ms) {
    this.ms = Math.max(0, Math.min(this.campaign.duration_ms - 1, Math.round(ms)));
    $("time").value = this.ms;
    const arm = this.campaign.arms[0];
    const apart = this.replay.faulty[`${arm}/deviation_mm`]?.[this.ms];
    const far = `unintended motion so far ${length(this.replay.faulty.unintended_mm[this.ms], this.campaign.limit_mm)}`;
    $("now").textContent = `${millis(this.ms)} · ${far}`;
    $("time").setAttribute("aria-valuetext", `${this.ms} ms, ${far}`);
    $("run").style.setProperty("--now", this.ms / this.campaign.duration_ms);
    this.figure?.show(this.positions(this.replay.faulty), this.positions(this.replay.golden), apart);
    this.heard.moved(this.ms);
  }

  positions(series) {
    return Object.fromEntries(
      this.campaign.arms.map((arm) => {
        const all = series[`${arm}/link_jpos`] ?? series[`${arm}/jpos`];
        const width = this.campaign.joints.length;
        return [arm, all.subarray(this.ms * width, (this.ms + 1) * width)];
      }),
    );
  }

  play(on) {
    this.playing = on;
    $("play").textContent = on ? "Pause" : "Play";
    $("play").setAttribute("aria-pressed", on);
    if (!on) return;
    if (this.ms >= this.campaign.duration_ms - 1) this.go(0);
    let [last, at] = [performance.now(), this.ms];
    const step = (now) => {
      if (!this.playing) return;
      at = (Math.abs(at - this.ms) > 1 ? this.ms : at) + (now - last) * Number($("speed").value);
      last = now;
      this.go(at);
      if (at >= this.campaign.duration_ms - 1) this.play(false);
      else requestAnimationFrame(step);
    };
    requestAnimationFrame(step);
  }

  /** Draws the signals of the faulty arm and joint, with those of the golden run and of the run to compare. */
  signals() {
    const { campaign, fault, replay, kept } = this;
    const acts = [fault.start_ms, ends(fault, campaign.duration_ms)].map((ms) => ms / campaign.duration_ms);
    const arm = fault.arm ?? campaign.arms[0];
    const joint = Math.max(0, campaign.joints.indexOf(fault.channel));
    const named = campaign.joints[joint].replaceAll("_", " ");
    const width = campaign.joints.length;
    const of = (name, k, n) => (series) => (n === 1 ? series[name] : column(series[name], k, n));
    const wanted = [
      { title: "Unintended motion so far", unit: "mm", name: "unintended_mm", n: 1, limit: campaign.limit_mm },
      { title: `Motor command, ${named}`, unit: "counts", name: `${arm}/dac_cnt`, k: joint, n: width },
      { title: `True joint position, ${named}`, unit: campaign.linear.includes(campaign.joints[joint]) ? "m" : "rad", name: `${arm}/link_jpos`, k: joint, n: width },
      { title: "Force of the cue", unit: "device units", name: `${arm}/cue_force`, k: campaign.cue, n: campaign.cues.cap.length },
      { title: "What the cue measures", unit: "mm", name: `${arm}/tip_error_mm`, n: 1, limit: campaign.cues.threshold_mm[campaign.cue] },
    ].filter(({ name }) => name in replay.faulty);
    $("signals").innerHTML = wanted
      .map(({ title, unit, name, k = 0, n, limit }) => {
        const take = of(name, k, n);
        const curves = [{ values: take(replay.golden), look: "golden" }, { values: take(replay.faulty), look: "own" }];
        if (kept) curves.splice(1, 0, { values: take(kept.faulty), look: "kept" });
        return signal({ title, unit, curves, limit, acts });
      })
      .join("");
    $("after-stop").hidden = replay.outcome.response !== "stopped";
  }

  chain() {
    const links = chain(this.replay, this.campaign.arms, this.campaign.duration_ms);
    const none = document.createElement("li");
    none.textContent = "No signal differs: the fault has no effect.";
    $("chain").replaceChildren(...(links.length ? links.slice(0, MOST_LINKS).map(({ ms, words }) => line(ms, words)) : [none]));
  }

  numbers() {
    const rows = Object.entries(this.replay.outcome).filter(([, value]) => typeof value !== "object");
    $("numbers-of-run").tBodies[0].innerHTML = rows.map(([name, value]) => `<tr><th scope="row">${name}</th><td>${typeof value === "number" ? Number(value.toPrecision(6)) : value}</td></tr>`).join("");
  }

  /** Stores this run to compare other runs with it, or forgets the stored run. */
  keep() {
    this.kept = this.kept ? null : this.replay;
    $("pin").textContent = this.kept ? "Stop comparing" : "Compare with this run";
    $("pinned-key").hidden = $("pinned").hidden = !this.kept;
    if (this.kept) $("pinned").textContent = `Compared with this run: ${told(this.kept.outcome, this.campaign.limit_mm, this.campaign.harm).join(" ")}`;
    this.signals();
  }

  draggable() {
    let from = null;
    $("lanes").addEventListener("pointerdown", (event) => {
      if (!event.target.classList.contains("fault")) return;
      from = { x: event.clientX, start: this.fault.start_ms, bar: event.target, width: event.target.parentElement.clientWidth };
      this.dragging = true;
      event.target.setPointerCapture(event.pointerId);
    });
    $("lanes").addEventListener("pointermove", (event) => {
      if (!from) return;
      const { duration_ms: duration } = this.campaign;
      const start = Math.max(0, Math.min(duration - 1, Math.round(from.start + ((event.clientX - from.x) / from.width) * duration)));
      from.bar.style.left = `${(100 * start) / duration}%`;
      if (start !== this.fault.start_ms) this.heard.dragged(start);
    });
    $("lanes").addEventListener("pointerup", () => {
      from = null;
      this.dragging = false;
      this.lanes();
    });
  }
}

// The controls of a fault and of the robot, with units, ranges and normal ranges.

import { AXES, channelOf, siteOf, spanOf, unitOf } from "./axes.js";
import { text } from "./verdicts.js";

/** The element of an id; the page's HTML decides its kind. @type {(id: string) => any} */
const $ = (id) => document.getElementById(id);
const option = (value, words, chosen) => `<option value="${value}"${value === chosen ? " selected" : ""}>${words}</option>`;

/** Parameters with a slider: path, words, factor from the parameter's unit to the shown unit, range, steps. */
const plainly = (cue) => [
  { path: "operator.scale", words: "Motion scaling, tip per hand", low: 0.02, high: 0.4, step: 0.01 },
  { path: `haptics.cues.${cue}.threshold_m`, words: "The cue begins at", unit: "mm", factor: 1000, low: 0.5, high: 8, step: 0.1 },
  { path: `haptics.cues.${cue}.kp`, words: "Strength of the cue", low: 0, high: 20, step: 0.1 },
  { path: "control.overdrive.policy", words: "Check of motor commands", choices: ["off", "limits commands that are too large", "limits commands, then stops the robot"] },
  { path: "control.overdrive.max_inst_dac", words: "A command stops the robot above", unit: "counts", low: 0, high: 32768, step: 100 },
  { path: "plc.watchdog_ticks", words: "The watchdog waits", unit: "ms", low: 10, high: 500, step: 1 },
  { path: "plant.friction_scale", words: "Friction of motors and joints", unit: "×", low: 0.2, high: 4, step: 0.05 },
  { path: "plant.mass_scale", words: "Mass of the links", unit: "×", low: 0.3, high: 3, step: 0.05 },
  { path: "plant.cable_stiffness_scale", words: "Stiffness of the cables", unit: "×", low: 0.2, high: 4, step: 0.05 },
  { path: "plant.motor_constant_scale", words: "Strength of the motors", unit: "×", low: 0.3, high: 3, step: 0.05 },
];
const trimmed = (value) => Number(value.toPrecision(6));

/** A slider and a number field that show the same value. */
function slider({ id, words, unit = "", low, high, step, hint = "" }) {
  const box = document.createElement("div");
  box.className = "slider";
  box.innerHTML =
    `<div class="line"><label for="${id}"><b>${words}</b></label><span><input type="number" id="${id}-number" aria-label="${words}${unit ? `, ${unit}` : ""}" step="any"> ${unit}</span></div>` +
    `<input type="range" id="${id}" min="${low}" max="${high}" step="${step}">${hint ? `<small>${hint}</small>` : ""}`;
  return box;
}

export class Controls {
  /** heard: {fault(changes), set(path, value), motion(name), axis(which, name)}. */
  constructor(campaign, description, able, heard) {
    this.campaign = campaign;
    this.description = description;
    this.able = able;
    this.heard = heard;
    this.key = "";
    this.known = Object.fromEntries(description.parameters.map((one) => [one.path, one]));
    this.sites();
    $("site").addEventListener("change", () => heard.fault({ site: $("site").value }));
    $("channel").addEventListener("change", () => heard.fault({ channel: $("channel").value.split("/").pop(), arm: $("channel").value.split("/")[0] || undefined }));
    $("effect").addEventListener("change", () => heard.fault({ effect: $("effect").value, value: NaN }));
    for (const which of ["across", "up"]) $(which).addEventListener("change", () => heard.axis(which, $(which).value));
    this.situation();
  }

  sites() {
    const layers = new Map();
    for (const site of this.campaign.sites)
      if (site.site in this.able) layers.set(site.layer, [...(layers.get(site.layer) ?? []), site]);
    $("site").innerHTML = [...layers].map(([layer, sites]) => `<optgroup label="${layer}">${sites.map(({ site, words }) => option(site, words)).join("")}</optgroup>`).join("");
  }

  situation() {
    const offered = plainly(this.campaign.cue).filter(({ path }) => path in this.known);
    this.inputs = new Map();
    this.hands();
    for (const one of offered) $("changes").append(this.parameter(one));
    const rest = $("numbers").parentElement;
    rest.addEventListener("toggle", () => this.numbers(), { once: true }); // there are hundreds, which few users need
  }

  /** Every parameter that has no separate control. */
  numbers() {
    for (const { path, unit, low, high, whole, meaning, value } of this.description.parameters) {
      if (this.inputs.has(path)) continue;
      const box = document.createElement("div");
      box.className = "slider";
      const name = path.replace(/^haptics\.cues\.(\d+)\.(\w+)$/, (_, k, what) => `cue ${Number(k) + 1}: ${what}`).replace(/^control\.|^plant\./, "");
      box.innerHTML = `<div class="line"><label for="n-${path}" title="${meaning ?? ""}">${name}</label><span><input type="number" id="n-${path}" min="${low ?? ""}" max="${high ?? ""}" step="${whole ? 1 : "any"}"> ${unit}</span></div>`;
      const input = box.querySelector("input");
      input.addEventListener("change", () => this.heard.set(path, input.value === "" || Number(input.value) === value ? undefined : Number(input.value)));
      this.inputs.set(path, { box, show: (now) => (input.value = String(trimmed(now))) });
      $("numbers").append(box);
    }
    this.changed(this.state);
  }

  /** The choice of the hands' motion, if the page has several. */
  hands() {
    const { motion: own, motions } = this.description;
    const names = Object.keys(motions);
    if (names.length < 2) return;
    const box = document.createElement("label");
    box.className = "field";
    const say = (name) => `${name.replaceAll("_", " ")}${name === own ? " (campaign)" : ""}`;
    box.innerHTML = `What the surgeon's hands do<select id="motion">${names.map((name) => option(name, say(name))).join("")}</select>`;
    this.motion = box.querySelector("select");
    this.motion.addEventListener("change", () => this.heard.motion(this.motion.value === own ? null : this.motion.value));
    $("changes").append(box);
  }

  parameter(/** @type {any} */ { path, words, unit = "", factor = 1, low, high, step, choices = null }) {
    const { value: own } = this.known[path];
    const heard = (value) => this.heard.set(path, Math.abs(value - own) < 1e-9 ? undefined : value);
    if (choices) {
      const box = document.createElement("label");
      box.className = "field";
      box.innerHTML = `${words}<select>${choices.map((one, k) => option(k, one)).join("")}</select>`;
      const input = box.querySelector("select");
      input.addEventListener("change", () => heard(Number(input.value)));
      this.inputs.set(path, { box, show: (now) => (input.value = String(now)) });
      return box;
    }
    const box = slider({ id: `p-${path}`, words, unit, low, high, step, hint: `campaign: ${text(own * factor)} ${unit}` });
    const [number, range] = box.querySelectorAll("input");
    range.addEventListener("input", () => heard(trimmed(Number(range.value) / factor)));
    number.addEventListener("change", () => heard(trimmed(Number(number.value) / factor)));
    this.inputs.set(path, {
      box,
      show: (now) => {
        range.value = String(now * factor);
        number.value = String(trimmed(now * factor));
      },
    });
    return box;
  }

  show(state, possible) {
    const { campaign } = this;
    const { fault } = state;
    const channels = this.able[fault.site];
    $("site").value = fault.site;
    const site = siteOf(campaign, fault);
    const arms = site.per_arm ? campaign.arms : [""];
    const names = arms.flatMap((arm) => Object.keys(channels).map((name) => [`${arm}/${name}`, `${arms.length > 1 ? `${arm} arm, ` : ""}${name.replaceAll("_", " ")}`]));
    $("channel").innerHTML = names.map(([value, words]) => option(value, words, `${fault.arm ?? ""}/${fault.channel}`)).join("");
    $("channel-field").hidden = names.length < 2;
    $("effect").innerHTML = channels[fault.channel].map((name) => option(name, `${campaign.effects[name].words.replace(/:$/, "")}${campaign.effects[name].value ? " …" : ""}`, fault.effect)).join("");
    for (const which of ["across", "up"]) $(which).innerHTML = possible.map((name) => option(name, AXES[name], state[which])).join("");
    const key = JSON.stringify([fault.site, fault.channel, fault.effect]);
    if (key !== this.key) this.sliders(fault);
    this.key = key;
    for (const [name, { box, show }] of Object.entries(this.own)) {
      show(fault[name]);
      box.classList.toggle("on-map", name === state.across || name === state.up);
    }
    if (this.motion) this.motion.value = state.motion ?? this.description.motion;
    this.state = state;
    this.changed(state);
  }

  changed(state) {
    for (const [path, { box, show }] of this.inputs) {
      show(state.changes[path] ?? this.known[path].value);
      box.classList.toggle("changed", path in state.changes);
    }
  }

  sliders(fault) {
    const { campaign } = this;
    const span = spanOf(campaign, fault);
    const { usual, unit: plain } = channelOf(campaign, fault);
    const hint = usual && campaign.effects[fault.effect].value !== "bit" ? `without a fault ${text(usual[0])} to ${text(usual[1])} ${plain}` : "";
    const most = campaign.duration_ms;
    const all = [
      span && { name: "value", words: campaign.effects[fault.effect].value === "bit" ? "Which bit" : "Size", unit: unitOf(campaign, fault), ...span, step: span.whole ? 1 : (span.high - span.low) / 400, hint },
      { name: "start_ms", words: "Begins", unit: "ms", low: 0, high: most - 1, step: 1 },
      { name: "duration_ms", words: "Lasts", unit: "ms", low: 0, high: 100, step: 1, log: Math.min(1024, most), whole: true },
    ].filter(Boolean);
    $("sliders").replaceChildren();
    this.own = {};
    for (const one of all) {
      const box = slider({ id: `f-${one.name}`, ...one });
      const [number, range] = box.querySelectorAll("input");
      const into = (value) => (one.log ? Math.round(one.log ** (value / 100)) : one.whole || one.step === 1 ? Math.round(value) : trimmed(value));
      range.addEventListener("input", () => this.heard.fault({ [one.name]: into(Number(range.value)) }));
      number.addEventListener("change", () => {
        const [least, greatest] = one.log ? [1, most] : [one.low, one.high];
        const value = Math.min(greatest, Math.max(least, Number(number.value)));
        this.heard.fault({ [one.name]: one.step === 1 ? Math.round(value) : value });
      });
      this.own[one.name] = {
        box,
        show: (value) => {
          const now = value === "end" ? most : value;
          range.value = one.log ? (100 * Math.log(Math.max(1, now))) / Math.log(one.log) : now;
          number.value = String(trimmed(now));
        },
      };
      $("sliders").append(box);
    }
  }
}

// The axes of a map: which properties of a fault vary, in which range and in which steps.

import { text } from "./verdicts.js";

const STEPS = globalThis.innerWidth <= 640 ? 8 : 40; // a finger needs squares of 24 px
const EARLIEST_MS = 500;
const LONGEST_MS = 1024;
const WIDER = 5; // range of a slider in multiples of the normal range, if the campaign gives no values

export const AXES = { value: "size", duration_ms: "duration", start_ms: "start", channel: "channel" };

export const siteOf = (campaign, fault) => campaign.sites.find((one) => one.site === fault.site);
export const channelOf = (campaign, fault) =>
  siteOf(campaign, fault).channels.find((one) => one.name === fault.channel) ?? siteOf(campaign, fault).channels[0];

/** Unit of a fault's value. */
export function unitOf(campaign, fault) {
  const kind = campaign.effects[fault.effect].value;
  if (kind === "factor") return "times";
  if (kind === "bit") return "";
  if (kind === "packets") return "packets";
  return channelOf(campaign, fault).unit;
}

/** Least and greatest value of a control, and whether values are whole numbers; null if the effect has no value. */
export function spanOf(campaign, fault) {
  const kind = campaign.effects[fault.effect].value;
  const channel = channelOf(campaign, fault);
  const own = campaign.values[`${fault.site}/${fault.effect}`];
  if (kind === "") return null;
  if (kind === "bit") return { low: 0, high: channel.bits - 1, whole: true };
  if (kind === "packets") return { low: 1, high: 400, whole: true };
  if (kind === "factor") return { low: -2, high: 5, whole: false };
  const whole = kind !== "amount" && channel.whole;
  if (own && own[1] > own[0]) return { low: own[0], high: own[1], whole };
  const [least, most] = channel.usual ?? [-1, 1];
  const reach = WIDER * Math.max(Math.abs(least), Math.abs(most)) || 1;
  const low = Math.max(-reach, channel.low ?? -Infinity);
  const high = Math.min(reach, channel.high ?? Infinity);
  return high - low > 1 || !whole ? { low, high, whole } : { low: channel.low ?? 0, high: channel.high ?? 1, whole };
}

/** The nearest time of whole ticks, ms, at least `least`. */
export const onTick = (campaign, ms, least = 0) => Math.max(least, Math.round(ms / campaign.tick_ms)) * campaign.tick_ms;

const rounded = (value, whole) => (whole ? Math.round(value) : Number(value.toPrecision(6)));
const distinct = (values) => [...new Set(values)];
const even = (low, high, whole) => distinct(Array.from({ length: STEPS + 1 }, (_, k) => rounded(low + ((high - low) * k) / STEPS, whole)));

/** Axis of a map: name, title, values (in order) and whether its steps grow. */
export function axisOf(campaign, fault, name, channels) {
  if (name === "value") {
    const span = spanOf(campaign, fault);
    const unit = unitOf(campaign, fault);
    const what = campaign.effects[fault.effect].value === "bit" ? "which bit" : "size";
    return span && { name, title: unit ? `${what}, ${unit}` : what, values: even(span.low, span.high, span.whole) };
  }
  if (name === "duration_ms") {
    const most = Math.min(LONGEST_MS, campaign.duration_ms);
    const values = Array.from({ length: STEPS + 1 }, (_, k) => onTick(campaign, most ** (k / STEPS), 1));
    return { name, title: "lasts, ms", values: distinct(values), log: true };
  }
  if (name === "start_ms") {
    const first = Math.min(EARLIEST_MS, Math.floor(campaign.duration_ms / 6));
    return { name, title: "begins, ms into the operation", values: distinct(even(first, campaign.duration_ms - first, true).map((ms) => onTick(campaign, ms))) };
  }
  return { name, title: "channel", values: channels };
}

/** The text of a value on an axis. */
export const label = (axis, value) => (typeof value === "number" ? text(value) : String(value).replaceAll("_", " "));

/** Index of the nearest value on an axis. */
export function nearest(axis, value) {
  if (value === "end" || value === Infinity) return axis.values.length - 1;
  if (typeof value !== "number") return Math.max(0, axis.values.indexOf(value));
  const apart = axis.values.map((one) => Math.abs(axis.log ? Math.log(one / Math.max(value, 0.5)) : one - value));
  return apart.indexOf(Math.min(...apart));
}

/** Describes the fault in words for readers who do not know the software. */
export function words(campaign, fault, spans = {}) {
  const site = siteOf(campaign, fault);
  const effect = campaign.effects[fault.effect];
  const unit = unitOf(campaign, fault);
  const range = (name, value) => (spans[name] ? `${text(spans[name][0])} to ${text(spans[name].at(-1))}` : text(value));
  const several = site.channels.length > 1;
  const arm = site.per_arm && campaign.arms.length > 1 ? `, ${fault.arm} arm` : "";
  const where = arm + (several ? `, ${spans.channel ? "any" : fault.channel.replaceAll("_", " ")}` : "");
  const size = effect.value ? ` ${range("value", fault.value)}${unit ? ` ${unit}` : ""}` : "";
  const lasts = fault.duration_ms === "end" && !spans.duration_ms ? "to the end" : `for ${range("duration_ms", fault.duration_ms)} ms`;
  return `${site.words}${where}: ${effect.words}${size}, ${lasts}, from ${range("start_ms", fault.start_ms)} ms into the operation`;
}

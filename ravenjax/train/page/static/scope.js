// Draws the field in two dimensions, from the front and from the right. It is beside the scene, and replaces it without
// a graphics card. Units are metres of the world; x to the right, y away from the operator, z upward.

import { COLOURS, LETTERS, fitted } from "./plots.js";

const HALF = [0.03, 0.06]; // least and greatest visible distance to each side of the middle, m
const MARGIN = 0.008; // m around the visible content
const TRAIL = 160;
const { goal: GOAL, done: DONE } = COLOURS;
const REACHED = 5; // number of targets before the goal that are still drawn
const AHEAD_M = 0.01; // m of a path that are highlighted
const GAP = 6; // px between the two views
const ENDS = 0.72; // share of the height at which the ends are labelled
const HALF_WORD = 34; // px, half the width of "L · 12 mm"
const CROWDED = 24; // px between two tips whose letters would overlap
const CLEAR = 30; // px between the goal's label and a mark or the mark's label
export const TOUCH_MM = 9; // shafts nearer than their thickness touch

/** Two views of the world: the horizontal axis, and the names of its ends. */
const LOOKS = [
  { name: "front", across: 0, ends: ["left", "right"] },
  { name: "from the right", across: 1, ends: ["toward you", "away"] },
];

export class Scope {
  /** bases: {origin, turn} of each arm's frame 0; tissue: {top, sag: [x, y], half: [x, y]}; task: its geometry. */
  constructor(canvas, arms, bases, tissue, task) {
    this.canvas = canvas;
    this.arms = arms;
    this.bases = bases;
    this.tissue = tissue;
    this.task = task ?? {};
    this.pen = canvas.getContext("2d");
    this.trails = Object.fromEntries(arms.map((arm) => [arm, []]));
    /** @type {{ middle: number[], half: number } | null} */
    this.box = null;
    this.virtual = false; // whether the virtual robot follows the hand
    /** Tips of the real robot, which rests meanwhile. @type {Record<string, number[]>} */
    this.resting = {};
    this.held = "";
    this.progress = 0;
    this.target = -1;
  }

  world(arm, place) {
    const { origin, turn } = this.bases[arm];
    return origin.map((o, i) => o + turn[i][0] * place[0] + turn[i][1] * place[1] + turn[i][2] * place[2]);
  }

  /** Takes an event of kind "object". */
  moved({ held, at }) {
    this.held = held ?? "";
    this.object = at;
  }

  /** Takes the tips and the goal from a frame. */
  take(frame) {
    this.target = frame.number("target");
    this.progress = frame.number("progress");
    this.virtual = frame.number("view") === 1;
    for (const arm of this.arms) {
      const trail = this.trails[arm];
      if (this.virtual) this.resting[arm] = this.world(arm, frame.get(`${arm}/tip`));
      trail.push(this.world(arm, frame.get(this.virtual ? `${arm}/virtual_tip` : `${arm}/tip`)));
      if (trail.length > TRAIL) trail.shift();
    }
    this.box ??= this.extent();
  }

  tip(arm) {
    return this.trails[arm]?.at(-1) ?? null;
  }

  draw(frame, blinded) {
    this.take(frame);
    const { pen } = this;
    const [width, height] = fitted(this.canvas, pen);
    if (!width || !height) return;
    pen.clearRect(0, 0, width, height);
    const [wide, high] = [(width - GAP) / 2, (height - GAP) / 2];
    const beside = Math.min(wide, height) >= Math.min(width, high);
    LOOKS.forEach((look, i) => {
      pen.save();
      if (beside) pen.translate(i * (wide + GAP), 0);
      else pen.translate(0, i * (high + GAP));
      this.look(look, frame, blinded, beside ? [wide, height] : [width, high], beside && i ? "right" : "left");
      pen.restore();
    });
  }

  /** The middle of the visible content, and its extent to each side, m. */
  extent() {
    const { path, pegs = [], targets = [], object } = this.task;
    const places = [...targets.map(({ at }) => at), ...pegs.map(({ at }) => at), ...(path?.points ?? []), ...(object ? [object.at] : [])];
    for (const arm of this.arms) if (this.tip(arm)) places.push(this.tip(arm));
    if (!places.length) return { middle: [0, 0, 0.2], half: HALF[1] };
    const ends = [0, 1, 2].map((k) => [Math.min(...places.map((at) => at[k])), Math.max(...places.map((at) => at[k]))]);
    const half = Math.max(...ends.map(([low, high]) => (high - low) / 2)) + MARGIN;
    return { middle: ends.map(([low, high]) => (low + high) / 2), half: Math.min(HALF[1], Math.max(HALF[0], half)) };
  }

  /** side: place of its name, away from the words in the middle of the field. The ends are labelled above its foot. */
  look({ name, across, ends }, frame, blinded, [width, height], side) {
    const { pen } = this;
    const { middle, half } = this.box;
    const scale = Math.min(width, height) / 2 / half;
    /** @type {any} */
    const see = { across, width, height, scale, x: (at) => width / 2 + (at[across] - middle[across]) * scale, y: (at) => height / 2 - (at[2] - middle[2]) * scale };
    pen.beginPath();
    pen.rect(0, 0, width, height);
    pen.clip();
    pen.fillStyle = "#151c24";
    pen.fillRect(0, 0, width, height);
    this.ground(see);
    this.goals(see);
    if (this.virtual) for (const arm of this.arms) this.rest(see, arm);
    pen.globalAlpha = this.virtual ? 0.6 : 1; // pale
    for (const arm of this.arms) this.instrument(see, arm);
    const tips = this.arms.map((arm) => this.tip(arm)).filter(Boolean);
    see.crowded = tips.length > 1 && Math.hypot(see.x(tips[0]) - see.x(tips[1]), see.y(tips[0]) - see.y(tips[1])) < CROWDED;
    for (const arm of this.arms) {
      if (!blinded) ring(pen, see, this.world(arm, frame.get(`${arm}/model_tip`)), COLOURS.model);
      this.mark(see, arm);
      if (!blinded && frame.number("view") === 0) crosshair(pen, see, this.world(arm, frame.aim(arm)));
    }
    pen.globalAlpha = 1;
    const named = side === "left" ? 8 : width - 8; // away from the middle, where the field's messages are
    words(pen, name, named, 14, "#e8edf3", side, 600);
    words(pen, `← ${ends[0]}`, 8, ENDS * height, "#aab7c5", "left");
    words(pen, `${ends[1]} →`, width - 8, ENDS * height, "#aab7c5", "right");
    words(pen, "10 mm", named, 32, "#aab7c5", side);
    pen.fillStyle = "#aab7c5";
    pen.fillRect(named - (side === "left" ? 0 : 0.01 * scale), 37, 0.01 * scale, 2);
  }

  ground({ across, height, x, y }) {
    const { pen } = this;
    const { top, sag, half } = this.tissue;
    const at = (share) => [0, 1, 2].map((k) => (k === across ? half[across] * share : k === 2 ? top - sag[across] * (half[across] * share) ** 2 : 0));
    pen.beginPath();
    pen.moveTo(x(at(-1)), height);
    for (let i = -20; i <= 20; i += 1) pen.lineTo(x(at(i / 20)), y(at(i / 20)));
    pen.lineTo(x(at(1)), height);
    pen.fillStyle = "rgba(226,132,118,0.30)";
    pen.fill();
    pen.strokeStyle = "rgba(244,170,158,0.7)";
    pen.lineWidth = 1.5;
    pen.stroke();
  }

  /** Height of the tissue under a point, m; null beside the tissue. */
  surface([x, y]) {
    const { top, sag, half } = this.tissue;
    return Math.abs(x) > half[0] || Math.abs(y) > half[1] ? null : top - sag[0] * x * x - sag[1] * y * y;
  }

  /** Draws the shaft from the remote centre to the tip, the trail, and the plumb line to the tissue. */
  instrument(see, arm) {
    const { pen } = this;
    const { x, y } = see;
    const [tip, colour, striped] = [this.tip(arm), this.virtual ? COLOURS.model : COLOURS[arm], arm === "green"];
    if (!tip) return;
    pen.lineCap = "butt";
    pen.strokeStyle = "rgba(200,210,220,0.28)";
    pen.lineWidth = 5;
    pen.setLineDash(this.virtual ? [3, 4] : striped ? [9, 5] : []);
    pen.beginPath();
    const { remote, origin } = this.bases[arm];
    pen.moveTo(x(remote ?? origin), y(remote ?? origin));
    pen.lineTo(x(tip), y(tip));
    pen.stroke();
    pen.lineWidth = 1.6;
    pen.strokeStyle = `${colour}a0`;
    pen.setLineDash(striped ? [4, 3] : []);
    pen.beginPath();
    for (const place of this.trails[arm]) pen.lineTo(x(place), y(place));
    pen.stroke();
    const below = this.surface(tip);
    if (below === null) return;
    const foot = [tip[0], tip[1], below];
    pen.strokeStyle = "rgba(255,255,255,0.65)";
    pen.lineWidth = 1;
    pen.setLineDash([2, 3]);
    pen.beginPath();
    pen.moveTo(x(tip), y(tip));
    pen.lineTo(x(foot), y(foot));
    pen.stroke();
    pen.setLineDash([]);
    pen.beginPath();
    pen.ellipse(x(foot), y(foot), 7, 2.5, 0, 0, 7);
    pen.fillStyle = "rgba(0,0,0,0.55)";
    pen.fill();
  }

  /** Marks where the real robot rests while the virtual robot follows the hand. */
  rest({ x, y }, arm) {
    const [place, { remote, origin }] = [this.resting[arm], this.bases[arm]];
    const { pen } = this;
    pen.strokeStyle = "rgba(200,210,220,0.4)";
    pen.lineWidth = 5;
    pen.setLineDash([]);
    pen.beginPath();
    pen.moveTo(x(remote ?? origin), y(remote ?? origin));
    pen.lineTo(x(place), y(place));
    pen.stroke();
    dot(pen, x(place), y(place), 7, "#0d1116", COLOURS[arm], 3);
    words(pen, `real robot, ${LETTERS[arm]}`, x(place), y(place) + (arm === "green" ? 39 : 24), "#e8edf3", "center", 600);
  }

  /** Draws the tip: L is a disc, R a diamond; an arrow at the edge if it has left the view. crowded: the letters are beside them. */
  mark({ x, y, width, height, crowded }, arm) {
    const tip = this.tip(arm);
    if (!tip) return;
    const [across, up] = [x(tip), y(tip)];
    const [inside, above] = [Math.min(width - 14, Math.max(14, across)), Math.min(height - 26, Math.max(30, up))];
    const { pen } = this;
    const away = inside !== across || above !== up;
    pen.globalAlpha = this.virtual ? 0.6 : 1;
    pen.beginPath();
    if (arm === "green") {
      for (const [dx, dy] of [[0, -11], [11, 0], [0, 11], [-11, 0]]) pen.lineTo(inside + dx, above + dy);
      pen.closePath();
    } else pen.arc(inside, above, 9, 0, 7);
    pen.fillStyle = (this.virtual ? COLOURS.model : COLOURS[arm]) + (crowded ? "90" : "");
    pen.fill();
    pen.strokeStyle = away ? "#fff" : "#0d1116";
    pen.lineWidth = away ? 2.5 : 1.5;
    if (this.virtual) {
      pen.strokeStyle = "#fff";
      pen.setLineDash([3, 3]);
      pen.globalAlpha = 1; // readable
      words(pen, `${LETTERS[arm]} virtual`, Math.min(width - 32, Math.max(32, inside)), above - (crowded && arm === "green" ? 31 : 16), "#fff", "center", 700);
    }
    pen.stroke();
    pen.setLineDash([]);
    pen.globalAlpha = 1;
    const side = arm === "green" ? 22 : -22;
    if (crowded) words(pen, LETTERS[arm], inside + side, above + 4, COLOURS[arm], "center", 800, 13);
    else words(pen, LETTERS[arm], inside, above + 4, "#0d1116", "center", 800);
    if (!away) return;
    const turn = Math.atan2(up - above, across - inside);
    pen.beginPath();
    for (const [far, aside] of [[14, 0.55], [21, 0], [14, -0.55]]) pen.lineTo(inside + far * Math.cos(turn + aside), above + far * Math.sin(turn + aside));
    pen.fillStyle = "#fff";
    pen.fill();
  }

  goals(see) {
    const { pen, target } = this;
    const { x, y, scale } = see;
    const { path, pegs = [], targets = [], object } = this.task;
    if (path) this.path(see, path);
    for (const one of targets) {
      const past = target - one.number;
      if (target >= 0 && (past > REACHED || past < -1)) continue; // all targets at once would hide the tip
      const [across, up, radius] = [x(one.at), y(one.at), Math.max(3, one.radius_m * scale)];
      if (past > 0 || target < 0) hook(pen, across, up);
      if (past === -1 && target >= 0) {
        dot(pen, across, up, Math.max(6, radius / 2), "", COLOURS[one.arm] ?? DONE, 1.5);
        const left = across < x(this.goal(target)?.at ?? one.at); // away from the present goal's words
        const beside = Math.max(6, radius / 2) + 4;
        words(pen, "next", left ? across - beside : across + beside, up + 4, "#aab7c5", left ? "right" : "left");
      }
    }
    const spots = pegs.map((one) => [one.number, one.at, one]);
    if (object) spots.push([object.number, this.thing(), object]);
    for (const [number, at, { radius_m: radius = 0.002, height_m: tall = 0, colour = DONE }] of spots) {
      if (tall) {
        pen.strokeStyle = colour;
        pen.lineWidth = Math.max(2, 2 * radius * scale);
        pen.beginPath();
        pen.moveTo(x(at), y(at));
        pen.lineTo(x(at), y(at) + tall * scale);
        pen.stroke();
      }
      if (number !== target) dot(pen, x(at), y(at), Math.max(3, radius * scale), tall ? "" : `${colour}cc`, colour);
    }
    this.aim(see);
  }

  /** Draws the goal, the line to the tip whose turn it is, and a ring with the tip's distance as its radius. */
  aim({ x, y, scale, width, height }) {
    const { pen } = this;
    const goal = this.goal(this.target);
    if (!goal) return;
    const [across, up, radius] = [x(goal.at), y(goal.at), Math.max(6, goal.radius * scale)];
    const tip = this.tip(goal.arm || this.nearest(goal.at));
    if (tip && goal.distance > goal.radius) {
      pen.strokeStyle = `${GOAL}b0`;
      pen.lineWidth = 1.5;
      pen.setLineDash([6, 5]);
      pen.beginPath();
      pen.moveTo(x(tip), y(tip));
      pen.lineTo(across, up);
      pen.stroke();
      pen.setLineDash([]);
    }
    dot(pen, across, up, radius, `${GOAL}50`, GOAL, 2.5);
    pen.strokeStyle = "#fff";
    pen.lineWidth = 1.5;
    pen.beginPath();
    for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
      pen.moveTo(across + dx * radius * 0.45, up + dy * radius * 0.45);
      pen.lineTo(across + dx * (radius + 4), up + dy * (radius + 4));
    }
    pen.stroke();
    if (goal.distance === null) return;
    const wide = Math.max(radius, goal.distance * scale);
    pen.setLineDash([5, 4]);
    if (wide < Math.hypot(width, height)) dot(pen, across, up, wide, "", GOAL, 1.5); // the tip's distance, including depth
    pen.setLineDash([]);
    const text = `${goal.arm ? `${LETTERS[goal.arm]} · ` : ""}${(1000 * goal.distance).toFixed(0)} mm`;
    const next = this.task.targets?.find(({ number }) => number === this.target + 1);
    const others = [tip, next?.at].filter(Boolean).map((at) => [x(at), y(at)]);
    const [beside, level, align] = free([across, up], radius, others, width);
    words(pen, text, beside, level, "#fff", align, 700, 13);
  }

  path({ x, y }, { points, colour = COLOURS.model }) {
    const { pen, target } = this;
    const line = (from, to, look, width) => {
      pen.strokeStyle = look;
      pen.lineWidth = width;
      pen.beginPath();
      for (let k = from; k <= to; k += 1) pen.lineTo(x(points[k % (points.length - 1)]), y(points[k % (points.length - 1)]));
      pen.stroke();
    };
    const count = points.length - 1; // the last point equals the first
    line(0, count, colour, 2);
    if (target < 0) return;
    line(0, target, DONE, 2);
    const spacing = Math.hypot(...points[1].map((c, i) => c - points[0][i]));
    line(target, target + Math.max(1, Math.round(AHEAD_M / spacing)), GOAL, 4);
  }

  /** Draws the object, at the tip that holds it. */
  thing() {
    return (this.held && this.tip(this.held)) || this.object || this.task.object.at;
  }

  nearest(at) {
    const ways = this.arms.map((arm) => [this.tip(arm) ? distance(this.tip(arm), at) : Infinity, arm]);
    return ways.sort((a, b) => a[0] - b[0])[0]?.[1] ?? "";
  }

  /** The arm whose turn it is, if the arms take turns. */
  turn() {
    const { arms = [], of = 1 } = this.task.turns ?? {};
    if (this.held) return this.held;
    return arms.length ? arms[Math.floor(this.progress * of + 1e-4) % arms.length] : "";
  }

  /** The present goal: its position, radius, arm, and the distance of that arm's tip, m; null without a goal. */
  goal(target = this.target) {
    const { targets = [], pegs = [], object, path } = this.task;
    if (target < 0) return null;
    let one = targets.find(({ number }) => number === target) ?? pegs.find(({ number }) => number === target);
    if (!one && object?.number === target) one = { ...object, at: this.thing() };
    if (!one && path) one = { at: path.points[target % (path.points.length - 1)], radius_m: path.radius_m };
    if (!one) return null;
    const { at } = one;
    const arm = one.arm ?? this.turn();
    const tips = (arm ? [arm] : this.arms).map((name) => this.tip(name)).filter(Boolean);
    return { at, radius: one.radius_m ?? 0.002, arm, distance: tips.length ? Math.min(...tips.map((tip) => distance(tip, at))) : null };
  }

  /** Distance of the two shafts, mm; Infinity with one arm. */
  apart() {
    if (this.arms.length < 2 || !this.arms.every((arm) => this.tip(arm))) return Infinity;
    const [a, b] = this.arms.map((arm) => [this.bases[arm].origin, this.tip(arm)]);
    return 1000 * between(a, b);
  }
}

const distance = (a, b) => Math.hypot(...a.map((c, i) => c - b[i]));

/** Least distance of two line segments. */
export function between([a, b], [c, d]) {
  const less = (p, q) => p.map((x, i) => x - q[i]);
  const dot3 = (p, q) => p[0] * q[0] + p[1] * q[1] + p[2] * q[2];
  const clip = (x) => Math.max(0, Math.min(1, x));
  const [u, v, w] = [less(b, a), less(d, c), less(a, c)];
  const [uu, uv, vv, uw, vw] = [dot3(u, u), dot3(u, v), dot3(v, v), dot3(u, w), dot3(v, w)];
  const cross = uu * vv - uv * uv;
  let s = cross > 1e-12 ? clip((uv * vw - vv * uw) / cross) : 0;
  const t = clip((uv * s + vw) / vv);
  s = clip((uv * t - uw) / uu);
  return Math.hypot(...w.map((x, i) => x + s * u[i] - t * v[i]));
}

/** Position of a goal's words, [x, y, align]: the first side that is free of the tip and the next goal. */
export function free([across, up], radius, others, width = Infinity) {
  const within = Math.max(HALF_WORD + 2, Math.min(width - HALF_WORD - 2, across)); // the words fit also at the edge
  const sides = [[within, up - radius - 8, "center"], [within, up + radius + 18, "center"], [across + radius + 8, up + 4, "left"], [across - radius - 8, up + 4, "right"]];
  const shift = { center: 0, left: HALF_WORD, right: -HALF_WORD };
  const room = (/** @type {any[]} */ [x, y, align]) => Math.min(Infinity, ...others.map(([ox, oy]) => Math.max(Math.abs(ox - x - shift[align]) - HALF_WORD, 2 * Math.abs(oy - y + 5))));
  return sides.find((side) => room(side) > CLEAR) ?? sides.sort((a, b) => room(b) - room(a))[0];
}

function words(pen, text, x, y, colour, align = "left", weight = 400, size = 11) {
  pen.font = `${weight} ${size}px system-ui, sans-serif`;
  pen.textAlign = align;
  pen.textBaseline = "alphabetic";
  pen.fillStyle = colour;
  pen.fillText(text, x, y);
}

function dot(pen, across, up, radius, fill, stroke, width = 1) {
  pen.beginPath();
  pen.arc(across, up, radius, 0, 7);
  if (fill) {
    pen.fillStyle = fill;
    pen.fill();
  }
  if (stroke) {
    pen.lineWidth = width;
    pen.strokeStyle = stroke;
    pen.stroke();
  }
}

/** Marks a target that was reached. */
function hook(pen, across, up) {
  pen.strokeStyle = DONE;
  pen.lineWidth = 2;
  pen.beginPath();
  pen.moveTo(across - 4, up);
  pen.lineTo(across - 1, up + 3);
  pen.lineTo(across + 4, up - 4);
  pen.stroke();
}

/** Marks the desired tip. */
function crosshair(pen, { x, y }, place) {
  const [across, up] = [x(place), y(place)];
  pen.strokeStyle = "#fff";
  pen.lineWidth = 1.5;
  pen.beginPath();
  for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
    pen.moveTo(across + 12 * dx, up + 12 * dy);
    pen.lineTo(across + 18 * dx, up + 18 * dy);
  }
  pen.stroke();
}

/** Marks the model's tip. */
function ring(pen, { x, y }, place, colour) {
  pen.strokeStyle = colour;
  pen.lineWidth = 2;
  pen.beginPath();
  pen.arc(x(place), y(place), 12, 0, 7);
  pen.stroke();
}

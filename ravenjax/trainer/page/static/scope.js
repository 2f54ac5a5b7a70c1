// The tips in two dimensions, seen from the front: a second look at the close-up, and the whole field where there is no
// 3D. Metres of the world; x to the right, z upward.

import { COLOURS, fitted } from "./plots.js";

const MIDDLE = [0, 0.2];
const HALF = 0.058; // m from the middle to the nearer edge
const TRAIL = 160;
const GOAL = "#ff4fd8"; // neither an arm's nor the model's
const REACHED = 5; // of those before the goal that are still drawn

export class Scope {
  /** bases: of each arm {origin, turn} of its frame 0; tissue: {top, sag, half}; task: the session's geometry. */
  constructor(canvas, arms, bases, tissue, task) {
    Object.assign(this, { canvas, arms, bases, tissue, task: task ?? {} });
    this.pen = canvas.getContext("2d");
    this.trails = Object.fromEntries(arms.map((arm) => [arm, []]));
  }

  world(arm, place) {
    const { origin, turn } = this.bases[arm];
    return origin.map((o, i) => o + turn[i][0] * place[0] + turn[i][1] * place[1] + turn[i][2] * place[2]);
  }

  draw(frame, blinded) {
    const { pen } = this;
    const [width, height] = fitted(this.canvas, pen);
    if (!width || !height) return;
    const scale = Math.min(width, height) / 2 / HALF;
    const x = (m) => width / 2 + (m - MIDDLE[0]) * scale;
    const y = (m) => height / 2 - (m - MIDDLE[1]) * scale;
    pen.clearRect(0, 0, width, height);
    this.ground(pen, x, y, width, height);
    for (const arm of this.arms) {
      const trail = this.trails[arm];
      trail.push(this.world(arm, frame.get(frame.number("view") === 1 ? `${arm}/virtual_tip` : `${arm}/tip`)));
      if (trail.length > TRAIL) trail.shift();
    }
    this.goals(pen, x, y, scale, frame.number("target"));
    for (const arm of this.arms) {
      const trail = this.trails[arm];
      const tip = trail.at(-1);
      pen.lineWidth = 1.2;
      pen.strokeStyle = `${COLOURS[arm]}80`;
      pen.beginPath();
      for (const place of trail) pen.lineTo(x(place[0]), y(place[2]));
      pen.stroke();
      if (!blinded) ring(pen, x, y, this.world(arm, frame.get(`${arm}/model_tip`)), COLOURS.model);
      pen.fillStyle = COLOURS[arm];
      pen.beginPath();
      pen.arc(x(tip[0]), y(tip[2]), 4, 0, 7);
      pen.fill();
      if (!blinded && frame.number("view") === 0) cross(pen, x, y, this.world(arm, frame.aim(arm)));
    }
  }

  ground(pen, x, y, width, height) {
    const { top, sag, half } = this.tissue;
    pen.beginPath();
    pen.moveTo(x(-half), height);
    for (let i = -20; i <= 20; i += 1) pen.lineTo(x((half * i) / 20), y(top - sag * ((half * i) / 20) ** 2));
    pen.lineTo(x(half), height);
    pen.fillStyle = "rgba(226,132,118,0.30)";
    pen.fill();
    pen.fillStyle = "#93a1b1";
    pen.font = "10px system-ui, sans-serif";
    pen.textAlign = "right";
    pen.fillText("10 mm", width - 6, 12);
    pen.fillRect(width - 6 - (x(0.01) - x(0)), 17, x(0.01) - x(0), 2);
  }

  goals(pen, x, y, scale, target) {
    const { path, pegs = [], targets = [], object } = this.task;
    if (path) {
      pen.strokeStyle = path.colour ?? COLOURS.model;
      pen.lineWidth = 1.5;
      pen.beginPath();
      for (const point of path.points) pen.lineTo(x(point[0]), y(point[2]));
      pen.stroke();
    }
    for (const one of targets) {
      const past = target - one.number;
      if (target >= 0 && (past > REACHED || past < -1)) continue; // all at once would hide the tip
      const [across, up, radius] = [x(one.at[0]), y(one.at[2]), Math.max(3, one.radius_m * scale)];
      if (past > 0 || target < 0) dot(pen, across, up, 2.5, "#8fa3b8", "");
      if (past === -1) dot(pen, across, up, Math.max(3, radius / 2), "", one.colour ?? "#8fa3b8");
    }
    const spots = pegs.map((one) => [one.number, one.top, one]);
    if (object) spots.push([object.number, this.object ?? object.at, object]);
    for (const [number, at, { radius_m: radius = 0.002, colour = "#8fa3b8" }] of spots)
      if (number !== target) dot(pen, x(at[0]), y(at[2]), Math.max(3, radius * scale), `${colour}33`, colour);
    const goal = this.goal(target);
    if (!goal) return;
    const [across, up] = [x(goal.at[0]), y(goal.at[2])];
    dot(pen, across, up, Math.max(4, goal.radius * scale), `${GOAL}55`, GOAL, 2);
    dot(pen, across, up, 2, "#fff", "");
    if (goal.distance === null) return;
    const wide = Math.min(goal.distance, HALF) * scale;
    pen.setLineDash([5, 4]);
    dot(pen, across, up, Math.max(wide, goal.radius * scale), "", GOAL, 1.5); // shrinks as the tip comes near, depth counted
    pen.setLineDash([]);
    pen.fillStyle = "#fff";
    pen.font = "600 12px system-ui, sans-serif";
    pen.textAlign = "center";
    pen.fillText(`${(1000 * goal.distance).toFixed(0)} mm`, across, up - Math.max(4, goal.radius * scale) - 6);
  }

  /** The present goal: where, how wide, whose turn, and how far that arm's tip is, m; null where there is none. */
  goal(target) {
    const { targets = [], pegs = [], object } = this.task;
    const one = targets.find(({ number }) => number === target) ?? pegs.find(({ number }) => number === target) ?? (object?.number === target ? object : null);
    if (!one) return null;
    const at = one === object ? (this.object ?? one.at) : (one.at ?? one.top);
    const arms = one.arm ? [one.arm] : this.arms;
    const ways = arms.map((arm) => this.trails[arm]?.at(-1)).filter(Boolean).map((tip) => Math.hypot(...tip.map((c, i) => c - at[i])));
    return { at, radius: one.radius_m ?? 0.002, arm: one.arm ?? "", distance: ways.length ? Math.min(...ways) : null };
  }
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

/** Where the hand leads. */
function cross(pen, x, y, place) {
  const [across, up] = [x(place[0]), y(place[2])];
  pen.strokeStyle = "#fff";
  pen.lineWidth = 1;
  pen.beginPath();
  for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
    pen.moveTo(across + 2 * dx, up + 2 * dy);
    pen.lineTo(across + 9 * dx, up + 9 * dy);
  }
  pen.stroke();
}

function ring(pen, x, y, place, colour) {
  pen.strokeStyle = colour;
  pen.lineWidth = 1.5;
  pen.beginPath();
  pen.arc(x(place[0]), y(place[2]), 6.5, 0, 7);
  pen.stroke();
}

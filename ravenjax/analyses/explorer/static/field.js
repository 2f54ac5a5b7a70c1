// The map of outcomes over two axes: the order of its points, and its drawing.

import { label } from "./axes.js";
import { CLASSES, LIGHT, classOf } from "./verdicts.js";

const COARSE = 8; // distance of the first computed points on an axis, in steps

/** Points of a grid from coarse to fine: lists of [i, j, stride]; each point once. */
export function levels(columns, rows) {
  const out = [];
  const done = new Set();
  for (let stride = COARSE; stride >= 1; stride /= 2) {
    const [across, up] = [columns, rows].map((n) => (n > 2 * COARSE ? stride : 1));
    const points = [];
    for (let j = 0; j < rows; j += up)
      for (let i = 0; i < columns; i += across) {
        const key = j * columns + i;
        if (!done.has(key)) points.push([i, j]);
        done.add(key);
      }
    if (points.length) out.push({ across, up, points });
  }
  return out;
}

const PAD = { left: 5.2, right: 0.9, top: 0.7, bottom: 3.9 }; // around the map, in heights of a letter

export class Field {
  /** choose(i, j): called when the user clicks or taps a cell. */
  constructor(canvas, choose) {
    this.canvas = canvas;
    this.pen = canvas.getContext("2d");
    this.cells = new Map();
    this.fresh = []; // cells that were computed since the last drawing
    this.whole = true;
    this.dots = [];
    this.at = null;
    /** @type {any} */
    this.across = null; // axes of the map, as from `axisOf`
    /** @type {any} */
    this.up = null;
    this.wanted = false;
    let finger = false; // a touch may also begin a scroll
    canvas.addEventListener("pointerdown", (event) => {
      finger = event.pointerType === "touch";
      if (!finger) this.touched(event, choose);
    });
    canvas.addEventListener("click", (event) => finger && this.touched(event, choose));
    canvas.addEventListener("pointermove", (event) => event.buttons && this.touched(event, choose));
    new ResizeObserver(() => this.ask()).observe(canvas);
  }

  /** Empties the map. dots: runs of a result folder to draw on the map. */
  reset(across, up, dots) {
    this.cells.clear();
    this.dot(across, up, dots);
  }

  dot(across, up, dots) {
    this.across = across;
    this.up = up;
    this.dots = dots;
    this.ask();
  }

  set(i, j, spread, outcome) {
    const cell = { i, j, spread, outcome };
    this.cells.set(j * this.across.values.length + i, cell);
    this.fresh.push(cell);
    this.ask(false);
  }

  /** Called when a level is complete: each known point now has the size of a cell of that level. */
  settle(spread) {
    for (const cell of this.cells.values()) cell.spread = spread;
    this.ask();
  }

  get(i, j) {
    return this.cells.get(j * this.across.values.length + i)?.outcome;
  }

  *outcomes() {
    for (const { outcome } of this.cells.values()) yield outcome;
  }

  mark(i, j) {
    this.at = [i, j];
    this.ask();
  }

  /** Requests a redraw. whole: of the whole map, not only of new points. */
  ask(whole = true) {
    this.whole ||= whole;
    if (this.wanted) return;
    this.wanted = true;
    requestAnimationFrame(() => {
      this.wanted = false;
      this.draw();
    });
  }

  /** Height of a letter, px. */
  get letter() {
    return Number.parseFloat(getComputedStyle(this.canvas).fontSize);
  }

  get box() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    const { left, right, top, bottom } = PAD;
    const em = this.letter;
    return { x: left * em, y: top * em, width: width - (left + right) * em, height: height - (top + bottom) * em };
  }

  touched(event, choose) {
    if (!this.across) return;
    const { x, y, width, height } = this.box;
    const [columns, rows] = [this.across.values.length, this.up.values.length];
    const i = Math.floor(((event.offsetX - x) / width) * columns);
    const j = rows - 1 - Math.floor(((event.offsetY - y) / height) * rows);
    if (i < 0 || j < 0 || i >= columns || j >= rows) return;
    event.preventDefault();
    choose(i, j);
  }

  draw() {
    const { canvas, pen } = this;
    const ratio = Math.min(3, window.devicePixelRatio || 1);
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    if (!width || !this.across) return;
    if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
      Object.assign(canvas, { width: Math.round(width * ratio), height: Math.round(height * ratio) });
      this.whole = true;
    }
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    const brush = new Brush(pen, canvas);
    if (this.whole) {
      pen.clearRect(0, 0, width, height);
      this.paint(brush);
    } else {
      // A new cell has the finest level so far, so it is drawn over all others.
      this.paintCells(brush, this.fresh);
      this.paintAbove(brush);
    }
    this.fresh = [];
    this.whole = false;
  }

  /** Draws the map with a brush, which paints on a canvas or writes SVG text. */
  paint(brush) {
    const { x, y, width, height, wide, high } = this.grid;
    brush.box(x, y, width, height, brush.colour("code"));
    const cells = [...this.cells.values()].sort((a, b) => b.spread.across * b.spread.up - a.spread.across * a.spread.up);
    this.paintCells(brush, cells);
    this.scales(brush, { x, y, width, height, wide, high });
    this.paintAbove(brush);
  }

  /** The rectangle of the map, the size of a cell, and the number of cells. */
  get grid() {
    const [columns, rows] = [this.across.values.length, this.up.values.length];
    const { box } = this;
    return { ...box, columns, rows, wide: box.width / columns, high: box.height / rows };
  }

  paintCells(brush, cells) {
    const { x, y, height, columns, rows, wide, high } = this.grid;
    for (const { i, j, spread, outcome } of cells) {
      const [before, below] = [Math.floor(spread.across / 2), Math.floor(spread.up / 2)];
      const [left, right] = [Math.max(0, i - before), Math.min(columns, i - before + spread.across)];
      const [low, top] = [Math.max(0, j - below), Math.min(rows, j - below + spread.up)];
      const name = classOf(outcome);
      const [px, py] = [x + left * wide, y + height - top * high];
      brush.box(px, py, (right - left) * wide + 0.4, (top - low) * high + 0.4, brush.colour(name));
      const size = Math.min((right - left) * wide, (top - low) * high);
      if (size >= 3.5) brush.mark(CLASSES[name].mark, px + ((right - left) * wide) / 2, py + ((top - low) * high) / 2, Math.min(4.5, size * 0.24), name);
    }
  }

  /** Draws the runs of a result folder, and the frame of the chosen cell. */
  paintAbove(brush) {
    const { x, y, height, wide, high } = this.grid;
    for (const dot of this.dots) brush.dot(x + (dot.i + 0.5) * wide, y + height - (dot.j + 0.5) * high, brush.colour(classOf(dot)));
    if (this.at) brush.frame(x + this.at[0] * wide, y + height - (this.at[1] + 1) * high, wide, high);
  }

  scales(brush, { x, y, width, height, wide, high }) {
    const ends = (axis, most) => {
      const n = axis.values.length;
      const step = Math.max(1, Math.ceil((n - 1) / most));
      const places = [];
      for (let k = 0; k < n; k += step) places.push(k);
      return places;
    };
    const em = this.letter;
    const letters = Math.max(...this.across.values.map((value) => label(this.across, value).length));
    const last = x + width + (PAD.right - 0.31 * letters) * em; // a label farther right would be cut
    for (const k of ends(this.across, Math.max(2, Math.floor(width / (em * (0.62 * letters + 1.5))))))
      brush.text(label(this.across, this.across.values[k]), Math.min(x + (k + 0.5) * wide, last), y + height + 1.35 * em, "center");
    for (const k of ends(this.up, Math.max(3, Math.floor(height / (3.7 * em)))))
      brush.text(label(this.up, this.up.values[k]), x - 0.6 * em, y + height - (k + 0.5) * high + 0.35 * em, "right");
    brush.text(this.across.title, x + width / 2, y + height + 3.2 * em, "center", true);
    brush.turned(this.up.title, 1.1 * em, y + height / 2);
  }

  svg() {
    const brush = new SvgBrush(this.canvas);
    this.paint(brush);
    return brush.done(this.canvas.clientWidth, this.canvas.clientHeight);
  }
}

const GRAVE = new Set(["unseen", "felt", "lost"]); // their marks are drawn strong

/** Colours of the page and shapes on a canvas. */
class Brush {
  constructor(pen, place) {
    this.pen = pen;
    this.style = getComputedStyle(place);
    this.colours = new Map();
  }

  colour(name) {
    if (!this.colours.has(name)) this.colours.set(name, this.style.getPropertyValue(`--${name}`).trim());
    return this.colours.get(name);
  }

  ink(name) {
    return LIGHT.has(name) ? "rgba(0,0,0,.5)" : `rgba(255,255,255,${GRAVE.has(name) ? 0.95 : 0.4})`;
  }

  box(x, y, width, height, colour) {
    this.pen.fillStyle = colour;
    this.pen.fillRect(x, y, width, height);
  }

  mark(shape, x, y, r, name) {
    if (!shape) return;
    const { pen } = this;
    pen.strokeStyle = pen.fillStyle = this.ink(name);
    pen.lineWidth = Math.max(1, r * 0.35);
    pen.beginPath();
    for (const [kind, ...at] of outline(shape, x, y, r)) pen[kind](...at);
    if (shape === "cross" || shape === "dash" || shape === "ring") pen.stroke();
    else pen.fill();
  }

  dot(x, y, colour) {
    const { pen } = this;
    pen.beginPath();
    pen.arc(x, y, 4.5, 0, 7);
    pen.fillStyle = colour;
    pen.fill();
    pen.lineWidth = 1.5;
    pen.strokeStyle = this.colour("ink");
    pen.stroke();
  }

  frame(x, y, width, height) {
    const { pen } = this;
    for (const [wide, colour] of [
      [4, this.colour("paper")],
      [2, this.colour("ink")],
    ]) {
      pen.lineWidth = wide;
      pen.strokeStyle = colour;
      pen.strokeRect(x - 2, y - 2, width + 4, height + 4);
    }
  }

  size(strong) {
    return Number.parseFloat(this.style.fontSize) * (strong ? 1.08 : 1);
  }

  text(words, x, y, align, strong = false) {
    const { pen } = this;
    pen.font = `${this.size(strong)}px ${this.style.fontFamily}`;
    pen.fillStyle = this.colour(strong ? "ink" : "soft");
    pen.textAlign = align;
    pen.fillText(words, x, y);
  }

  turned(words, x, y) {
    const { pen } = this;
    pen.save();
    pen.translate(x, y);
    pen.rotate(-Math.PI / 2);
    this.text(words, 0, 0, "center", true);
    pen.restore();
  }
}

/** Drawing steps of a mark, as calls of a canvas. */
export function outline(shape, x, y, r) {
  if (shape === "cross") return [["moveTo", x - r, y - r], ["lineTo", x + r, y + r], ["moveTo", x - r, y + r], ["lineTo", x + r, y - r]];
  if (shape === "dash") return [["moveTo", x - r, y], ["lineTo", x + r, y]];
  if (shape === "square") return [["moveTo", x - r, y - r], ["lineTo", x + r, y - r], ["lineTo", x + r, y + r], ["lineTo", x - r, y + r]];
  if (shape === "triangle") return [["moveTo", x, y - r], ["lineTo", x + r, y + r], ["lineTo", x - r, y + r]];
  return [["arc", x, y, shape === "speck" ? r * 0.5 : r, 0, 2 * Math.PI]];
}

export const escaped = (words) => words.replaceAll("&", "&amp;").replaceAll("<", "&lt;");

/** A brush that writes the text of an SVG file. */
class SvgBrush extends Brush {
  constructor(place) {
    super(null, place);
    this.parts = [];
  }

  box(x, y, width, height, colour) {
    this.parts.push(`<rect x="${x.toFixed(2)}" y="${y.toFixed(2)}" width="${width.toFixed(2)}" height="${height.toFixed(2)}" fill="${colour}"/>`);
  }

  mark(shape, x, y, r, name) {
    if (!shape) return;
    const steps = outline(shape, x, y, r);
    if (steps[0][0] === "arc") {
      const look = shape === "ring" ? `fill="none" stroke="${this.ink(name)}"` : `fill="${this.ink(name)}"`;
      this.parts.push(`<circle cx="${x.toFixed(2)}" cy="${y.toFixed(2)}" r="${steps[0][3].toFixed(2)}" ${look}/>`);
      return;
    }
    const path = steps.map(([kind, px, py]) => `${kind === "moveTo" ? "M" : "L"}${px.toFixed(2)} ${py.toFixed(2)}`).join("");
    const look = shape === "cross" || shape === "dash" ? `fill="none" stroke="${this.ink(name)}"` : `fill="${this.ink(name)}"`;
    this.parts.push(`<path d="${path}" ${look}/>`);
  }

  dot(x, y, colour) {
    this.parts.push(`<circle cx="${x.toFixed(2)}" cy="${y.toFixed(2)}" r="4.5" fill="${colour}" stroke="${this.colour("ink")}"/>`);
  }

  frame(x, y, width, height) {
    this.parts.push(`<rect x="${x - 2}" y="${y - 2}" width="${width + 4}" height="${height + 4}" fill="none" stroke="${this.colour("ink")}" stroke-width="2"/>`);
  }

  text(words, x, y, align, strong = false) {
    const anchor = { center: "middle", right: "end", left: "start" }[align];
    this.parts.push(`<text x="${x.toFixed(1)}" y="${y.toFixed(1)}" text-anchor="${anchor}" font-size="${this.size(strong)}" fill="${this.colour(strong ? "ink" : "soft")}">${escaped(words)}</text>`);
  }

  turned(words, x, y) {
    this.parts.push(`<text transform="translate(${x} ${y.toFixed(1)}) rotate(-90)" text-anchor="middle" font-size="${this.size(true)}" fill="${this.colour("ink")}">${escaped(words)}</text>`);
  }

  done(width, height) {
    return `<svg xmlns="http://www.w3.org/2000/svg" width="${width}" height="${height}" viewBox="0 0 ${width} ${height}" font-family="sans-serif"><rect width="100%" height="100%" fill="${this.colour("paper")}"/>${this.parts.join("")}</svg>\n`;
  }
}

// Draws live plots on canvas: the last ten seconds, with the threshold as a line.

const SPAN_MS = 10000;
const MOST = 1500; // points: ten seconds at 150 frames a second
// Colours differ in lightness, too, for people who do not see red or green. Besides the colour, each
// line and mark has a letter, a shape or a dash of its own.
export const COLOURS = { gold: "#ffc440", green: "#1fae84", model: "#9adcff", goal: "#f53df0", done: "#76879a" };
export const LETTERS = { gold: "L", green: "R" };

export class Plot {
  /** lines: names with their colours; floor: least height of the axis; limit: value of a dashed line, or null. */
  constructor(canvas, lines, { floor, limit, unit, digits }) {
    this.canvas = canvas;
    this.lines = lines;
    this.floor = floor;
    this.limit = limit;
    this.unit = unit;
    this.digits = digits;
    this.times = new Float64Array(MOST);
    this.values = lines.map(() => new Float32Array(MOST));
    this.count = 0;
    this.pen = canvas.getContext("2d");
  }

  add(time, values) {
    if (this.count && time < this.times[(this.count - 1) % MOST]) this.count = 0; // another session began
    const at = this.count % MOST;
    this.times[at] = time;
    values.forEach((value, i) => (this.values[i][at] = value));
    this.count += 1;
  }

  draw() {
    const { pen } = this;
    const [width, height] = fitted(this.canvas, pen);
    pen.clearRect(0, 0, width, height);
    const [left, right, top, bottom] = [38, width - 4, 6, height - 16];
    const first = Math.max(0, this.count - MOST);
    const now = this.count ? this.times[(this.count - 1) % MOST] : 0;
    let peak = this.floor;
    for (let k = first; k < this.count; k += 1)
      if (this.times[k % MOST] > now - SPAN_MS) for (const values of this.values) peak = Math.max(peak, values[k % MOST]);
    const most = niced(peak * 1.08);
    const y = (value) => bottom - (value / most) * (bottom - top);
    const x = (time) => right - ((now - time) / SPAN_MS) * (right - left);

    pen.font = "10px system-ui, sans-serif";
    pen.textBaseline = "middle";
    pen.lineWidth = 1;
    for (let i = 0; i <= 2; i += 1) {
      const value = (most * i) / 2;
      pen.strokeStyle = "rgba(148,170,196,0.14)";
      line(pen, left, y(value), right, y(value));
      pen.fillStyle = "#93a1b1";
      pen.textAlign = "right";
      pen.fillText(value.toFixed(this.digits), left - 5, y(value));
    }
    pen.textAlign = "center";
    for (const s of [10, 5, 0]) pen.fillText(s ? `−${s} s` : "now", Math.min(right - 10, Math.max(left + 10, x(now - 1000 * s))), height - 6);
    if (this.limit !== null && this.limit <= most) {
      pen.strokeStyle = "#f0484e";
      pen.setLineDash([5, 4]);
      line(pen, left, y(this.limit), right, y(this.limit));
      pen.setLineDash([]);
      pen.fillStyle = "#ff9a9d";
      pen.textAlign = "left";
      pen.fillText(`cue at ${this.limit} ${this.unit}`, left + 4, y(this.limit) - 7);
    }
    pen.lineWidth = 1.6;
    pen.lineJoin = "round";
    this.lines.forEach(({ name, colour }, i) => {
      pen.strokeStyle = colour;
      pen.setLineDash(name === "green" ? [6, 3] : []);
      pen.beginPath();
      for (let k = first; k < this.count; k += 1) {
        const time = this.times[k % MOST];
        if (time >= now - SPAN_MS) pen.lineTo(x(time), y(this.values[i][k % MOST]));
      }
      pen.stroke();
    });
    pen.setLineDash([]);
  }
}

/** How much larger than usual the page is: see the root's font size in page.css. */
export const scale = () => parseFloat(getComputedStyle(document.documentElement).fontSize) / 16;

/** Sets the canvas to the screen's resolution. Returns its size in the pen's units, sixteenths of a rem. */
export function fitted(canvas, pen) {
  const ratio = devicePixelRatio || 1;
  const large = scale();
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  pen.setTransform(ratio * large, 0, 0, ratio * large, 0, 0);
  return [width / large, height / large];
}

function line(pen, x0, y0, x1, y1) {
  pen.beginPath();
  pen.moveTo(x0, y0);
  pen.lineTo(x1, y1);
  pen.stroke();
}

export function niced(value) {
  const ten = 10 ** Math.floor(Math.log10(value));
  return ten * [1, 2, 4, 5, 6, 8, 10].find((step) => step * ten >= value * 0.999);
}

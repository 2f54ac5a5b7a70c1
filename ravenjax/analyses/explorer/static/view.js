// The picture of the robot on the page: starts the drawing, and handles the user's input.

const FARTHER = 1.15; // factor of the distance for one press of + or -

export class View {
  /** description: JSON text of `describe_figure`; shown(ready): called once with whether there is a picture. */
  constructor(canvas, description, shown) {
    this.canvas = canvas;
    this.description = description;
    this.shown = shown;
    this.saved = null;
    this.hands = new Map();
    this.start();
  }

  /** Draws in a worker, so that the page stays responsive, or on the page if the browser cannot do that. */
  start() {
    if (!this.canvas.transferControlToOffscreen) {
      this.here();
      return;
    }
    const worker = new Worker(import.meta.resolve("./figure.js"), { type: "module" });
    this.post = (message) => worker.postMessage(message, []);
    worker.addEventListener("message", ({ data }) => this.answered(data, () => this.here(worker)));
    worker.addEventListener("error", () => this.here(worker));
    const off = this.canvas.transferControlToOffscreen();
    worker.postMessage({ canvas: off, description: this.description }, [off]);
    this.watch();
  }

  async here(worker) {
    worker?.terminate();
    const fresh = this.canvas.cloneNode();
    this.canvas.replaceWith(fresh); // the worker owns the old canvas
    this.canvas = fresh;
    const { Figure } = await import("./figure.js");
    const figure = new Figure(fresh, JSON.parse(this.description), (message) => this.answered(message, () => this.shown(false)));
    this.post = (message) => figure.hear(message);
    this.watch();
    if (this.scene) this.post({ scene: this.scene });
  }

  answered({ ready, picture }, otherwise) {
    if (ready) this.shown(true);
    else if (ready === false) otherwise();
    if (picture) this.saved?.(picture);
  }

  watch() {
    const { canvas } = this;
    new ResizeObserver(() => {
      const ratio = Math.min(2, window.devicePixelRatio || 1);
      this.post({ extent: { width: Math.round(canvas.clientWidth * ratio), height: Math.round(canvas.clientHeight * ratio) } });
    }).observe(canvas);
    this.touchable();
  }

  /** Joint positions of robot and ghost by arm, and their distance, mm. */
  show(robot, ghost, apart) {
    this.scene = { robot, ghost, apart };
    this.post?.({ scene: this.scene });
  }

  /** The picture as a PNG. */
  picture() {
    return new Promise((resolve) => {
      this.saved = resolve;
      this.post({ picture: true });
    });
  }

  at({ offsetX, offsetY }) {
    return { x: offsetX / this.canvas.clientWidth, y: offsetY / this.canvas.clientHeight };
  }

  /** Drag and arrow keys turn the view under the hand; two fingers, the wheel with Ctrl, + and - bring it nearer. */
  touchable() {
    const { canvas, hands } = this;
    const apart = () => {
      const [a, b] = [...hands.values()];
      return Math.hypot(a.clientX - b.clientX, a.clientY - b.clientY);
    };
    canvas.addEventListener("pointerdown", (event) => {
      hands.set(event.pointerId, event);
      canvas.setPointerCapture(event.pointerId);
      if (hands.size === 1) this.held = this.at(event);
    });
    for (const over of ["pointerup", "pointercancel"]) canvas.addEventListener(over, ({ pointerId }) => hands.delete(pointerId));
    canvas.addEventListener("pointermove", (event) => {
      const before = hands.get(event.pointerId);
      if (!before) return;
      const was = hands.size === 2 ? apart() : 0;
      hands.set(event.pointerId, event);
      if (was) this.post({ nearer: { at: this.held, by: was / Math.max(1, apart()) } });
      else if (hands.size === 1) this.post({ turn: { at: this.held, dx: event.clientX - before.clientX, dy: event.clientY - before.clientY } });
    });
    canvas.addEventListener(
      "wheel",
      (event) => {
        if (!event.ctrlKey) return;
        event.preventDefault();
        this.post({ nearer: { at: this.at(event), by: Math.exp(0.002 * event.deltaY) } });
      },
      { passive: false },
    );
    canvas.addEventListener("keydown", (event) => {
      const [dx, dy] = { ArrowLeft: [12, 0], ArrowRight: [-12, 0], ArrowUp: [0, 12], ArrowDown: [0, -12] }[event.key] ?? [];
      const by = { "+": 1 / FARTHER, "-": FARTHER }[event.key];
      if (dx === undefined && !by) return;
      event.preventDefault();
      for (const at of [{ x: 0, y: 0 }, { x: 1, y: 1 }]) this.post(by ? { nearer: { at, by } } : { turn: { at, dx, dy } });
    });
  }
}

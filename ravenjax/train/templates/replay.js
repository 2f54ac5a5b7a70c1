// Replays the session: tips in three dimensions at the time of the slider. Lengths are tenths of a millimetre.
(() => {
  const told = JSON.parse(document.getElementById("replay-data").textContent);
  const place = document.getElementById("replay");
  /** @type {any[]} */
  const [canvas, slider, clock, play, speed] = ["canvas", "input", "output", ".play", "select"].map((name) => place.querySelector(name));
  const COLOURS = { gold: "#ffc440", green: "#1fae84", model: "#9adcff", goal: "#f53df0", done: "#76879a" };
  const LETTERS = { gold: "L", green: "R" };
  const VIEWS = { endoscope: [0, 0.6], front: [0, 0], side: [1.57, 0], above: [0, 1.5] }; // rotation about z, and elevation, rad
  const PER_M = 10000;
  const TRAIL_MS = 2000;
  const arms = Object.keys(told.arms);
  const { middle, half } = extent();
  let [turn, up] = VIEWS.endoscope;
  let now = told.ms[0];
  let last = 0;

  /** The visible content: its middle, and its extent to each side. */
  function extent() {
    const [low, high] = [Array(3).fill(Infinity), Array(3).fill(-Infinity)];
    const take = (at) => at.forEach((c, k) => ([low[k], high[k]] = [Math.min(low[k], c), Math.max(high[k], c)]));
    for (const arm of arms) for (const at of told.arms[arm].tip) take(at);
    for (const { at } of told.task.targets ?? []) take(at.map((c) => PER_M * c));
    return { middle: low.map((c, k) => (c + high[k]) / 2), half: Math.max(150, ...low.map((c, k) => (high[k] - c) / 2)) + 60 };
  }

  /** The picture shown at a time: the last one at or before it. */
  function picture(ms) {
    let [first, end] = [0, told.ms.length];
    while (end - first > 1) {
      const between = (first + end) >> 1;
      if (told.ms[between] <= ms) first = between;
      else end = between;
    }
    return first;
  }

  /** Position of a point on the canvas. In the world x is right, y away and z up. */
  function seen(at, width, height) {
    const [x, y, z] = at.map((c, k) => c - middle[k]);
    const [across, deep] = [x * Math.cos(turn) + y * Math.sin(turn), y * Math.cos(turn) - x * Math.sin(turn)];
    const high = z * Math.cos(up) + deep * Math.sin(up);
    const scale = Math.min(width, height) / 2 / half;
    return [width / 2 + across * scale, height / 2 - high * scale];
  }

  function draw() {
    const large = parseFloat(getComputedStyle(document.documentElement).fontSize) / 16; // the page grows with the screen
    const [width, height] = [canvas.clientWidth / large, canvas.clientHeight / large];
    if (!width) return;
    const sharp = (devicePixelRatio || 1) * large;
    [canvas.width, canvas.height] = [width * sharp, height * sharp];
    const pen = canvas.getContext("2d");
    pen.scale(sharp, sharp);
    const line = (points, colour, thick = 1, dashes = []) => {
      pen.beginPath();
      for (const at of points) pen.lineTo(...seen(at, width, height));
      Object.assign(pen, { strokeStyle: colour, lineWidth: thick });
      pen.setLineDash(dashes);
      pen.stroke();
      pen.setLineDash([]);
    };
    /** fill: "": none. */
    const ring = (at, radius, colour, fill = "", diamond = false) => {
      const [x, y] = seen(at, width, height);
      pen.beginPath();
      if (diamond) for (const [dx, dy] of [[0, -1], [1, 0], [0, 1], [-1, 0]]) pen.lineTo(x + 1.2 * radius * dx, y + 1.2 * radius * dy);
      else pen.arc(x, y, radius, 0, 7);
      pen.closePath();
      Object.assign(pen, { strokeStyle: colour, fillStyle: fill, lineWidth: 2 });
      if (fill) pen.fill();
      pen.stroke();
    };
    const shown = picture(now);
    tissue(line);
    goals(line, ring, told.target[shown]);
    for (const arm of arms) {
      const { remote, tip, model } = told.arms[arm];
      const from = picture(now - TRAIL_MS);
      line([remote, tip[shown]], "rgba(200,210,220,0.4)", 5, arm === "green" ? [9, 5] : []);
      line(tip.slice(from, shown + 1), COLOURS[arm], 1.5, arm === "green" ? [4, 3] : []);
      line([tip[shown], [tip[shown][0], tip[shown][1], surface(tip[shown])]], "rgba(255,255,255,0.6)", 1, [2, 3]);
      if (model) ring(model[shown], 12, COLOURS.model);
      ring(tip[shown], 9, "#0d1116", COLOURS[arm], arm === "green");
      Object.assign(pen, { fillStyle: "#0d1116", font: "800 12px system-ui, sans-serif", textAlign: "center" });
      const [x, y] = seen(tip[shown], width, height);
      pen.fillText(LETTERS[arm], x, y + 4);
    }
    Object.assign(pen, { fillStyle: "#e8edf3", font: "13px system-ui, sans-serif", textAlign: "left" });
    pen.fillText(told.pedal[shown] ? "pedal down" : "pedal up", 12, 20);
    const scale = Math.min(width, height) / 2 / half;
    pen.fillRect(width - 12 - 100 * scale, 24, 100 * scale, 2);
    pen.textAlign = "right";
    pen.fillText("10 mm", width - 12, 18);
    slider.value = String(now);
    clock.textContent = `${(now / 1000).toFixed(2)} s of ${(told.ms.at(-1) / 1000).toFixed(1)} s`;
  }

  /** Height of the tissue under a point. */
  function surface([x, y]) {
    const { top, sag } = told.tissue;
    return PER_M * (top - sag[0] * (x / PER_M) ** 2 - sag[1] * (y / PER_M) ** 2);
  }

  function tissue(line) {
    const wide = told.tissue.half.map((c) => PER_M * c);
    const steps = [...Array(13).keys()].map((k) => k / 6 - 1);
    const at = (x, y) => [x * wide[0], y * wide[1], surface([x * wide[0], y * wide[1]])];
    for (const k of steps) {
      line(steps.map((j) => at(k, j)), "rgba(244,170,158,0.28)");
      line(steps.map((j) => at(j, k)), "rgba(244,170,158,0.28)");
    }
  }

  function goals(line, ring, target) {
    const { targets = [] } = told.task;
    // Sessions recorded by earlier versions have the place of a peg under "top".
    const pegs = (told.task.pegs ?? []).map(({ number, at, top }) => ({ number, at: at ?? top }));
    const path = told.task.path?.points ?? [];
    const placed = (at) => at.map((c) => PER_M * c);
    if (path.length) line(path.map(placed), COLOURS.done, 1.5);
    for (const { number, at } of [...targets, ...pegs]) {
      if (number === target) ring(placed(at), 10, COLOURS.goal, `${COLOURS.goal}50`);
      else if (pegs.length || Math.abs(number - target) < 3) ring(placed(at), 3, COLOURS.done);
    }
    if (path.length && target >= 0) ring(placed(path[target % (path.length - 1)]), 8, COLOURS.goal, `${COLOURS.goal}50`);
  }

  function look(ms) {
    now = Math.max(told.ms[0], Math.min(told.ms.at(-1), ms));
    draw();
  }

  function run(on) {
    play.setAttribute("aria-pressed", String(on));
    play.textContent = on ? "Stop" : "Play";
    if (!on) return;
    if (now >= told.ms.at(-1)) now = told.ms[0];
    last = performance.now();
    requestAnimationFrame(step);
  }

  function step(at) {
    if (play.getAttribute("aria-pressed") !== "true") return;
    look(now + (at - last) * Number(speed.value));
    last = at;
    if (now >= told.ms.at(-1)) run(false);
    else requestAnimationFrame(step);
  }

  Object.assign(slider, { min: told.ms[0], max: told.ms.at(-1), step: 10 });
  slider.addEventListener("input", () => look(Number(slider.value)));
  play.addEventListener("click", () => run(play.getAttribute("aria-pressed") !== "true"));
  for (const button of /** @type {NodeListOf<HTMLButtonElement>} */ (place.querySelectorAll("[data-view]")))
    button.addEventListener("click", () => {
      [turn, up] = VIEWS[button.dataset.view];
      draw();
    });
  canvas.addEventListener("pointerdown", (event) => canvas.setPointerCapture(event.pointerId));
  canvas.addEventListener("pointermove", (event) => {
    if (!event.buttons) return;
    turn -= event.movementX / 150;
    up = Math.max(-1.57, Math.min(1.57, up + event.movementY / 150));
    draw();
  });
  canvas.addEventListener("keydown", (event) => {
    const way = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1] }[event.key];
    if (!way) return;
    event.preventDefault();
    [turn, up] = [turn + way[0], Math.max(-1.57, Math.min(1.57, up + way[1]))];
    draw();
  });
  for (const [kind, ms, text] of told.marks) {
    const button = document.createElement("button");
    Object.assign(button, { type: "button", className: kind, textContent: `${(ms / 1000).toFixed(1)} s ${text}` });
    button.addEventListener("click", () => look(kind === "strike" ? ms - 200 : ms));
    const item = document.createElement("li");
    item.append(button);
    place.querySelector(".moments").append(item);
  }
  addEventListener("resize", draw);
  draw();
})();

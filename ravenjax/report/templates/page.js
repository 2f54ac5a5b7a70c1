// The path of a traced run, played: two marks move in every view of it.
document.querySelectorAll(".player").forEach((player) => {
  const course = JSON.parse(document.getElementById(player.dataset.path + "-course").textContent);
  const views = [...document.querySelectorAll("[data-views='" + player.dataset.path + "'] [data-sides]")].map((view) => {
    const drawing = view.querySelector("svg");
    const { x, y } = JSON.parse(view.querySelector("script").textContent);
    const marks = Object.entries({ model: "same", tip: "cue" }).map(([of, colour]) => {
      const mark = document.createElementNS("http://www.w3.org/2000/svg", "circle");
      for (const [name, value] of Object.entries({ class: "now", r: 5, style: "--c:var(--" + colour + ")" })) mark.setAttribute(name, value);
      mark.dataset.of = of;
      drawing.append(mark);
      return mark;
    });
    const sides = view.dataset.sides.split(" ").map(Number);
    return { sides, x, y, marks, box: () => drawing.querySelector(".hit").getBBox() };
  });
  const [button, slider, said] = player.children;
  const last = course.time.length - 1;
  let begun = null;
  function show(point) {
    slider.value = point;
    said.textContent = course.time[point] + " ms, " + course.off[point].toFixed(2) + " mm off the model";
    for (const { sides: [across, up], x, y, marks, box } of views) {
      const { x: left, y: top, width, height } = box();
      for (const mark of marks) {
        const place = course[mark.dataset.of][point];
        mark.setAttribute("cx", left + width * (place[across] - x.low) / (x.high - x.low));
        mark.setAttribute("cy", top + height * (y.high - place[up]) / (y.high - y.low));
      }
    }
  }
  function stop() {
    begun = null;
    button.textContent = "play";
  }
  function step(now) {
    if (begun === null) return;
    const ms = (now - begun.at) / 3 + begun.from;  // at a third of its speed
    let point = course.time.findIndex((time) => time >= ms);
    if (point < 0) point = last;
    show(point);
    if (point === last) stop();
    else requestAnimationFrame(step);
  }
  button.addEventListener("click", () => {
    if (begun !== null) return stop();
    const from = Number(slider.value) >= last ? 0 : course.time[Number(slider.value)];
    begun = { at: performance.now(), from };
    button.textContent = "stop";
    requestAnimationFrame(step);
  });
  show(0);
  slider.addEventListener("input", () => { stop(); show(Number(slider.value)); });
});

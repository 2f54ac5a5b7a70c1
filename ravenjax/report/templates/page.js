// The path of a traced run, played: two marks move in every view of it.
document.querySelectorAll(".player").forEach((player) => {
  const course = JSON.parse(document.getElementById(player.dataset.path + "-course").textContent);
  const views = document.querySelectorAll("[data-views='" + player.dataset.path + "'] svg.view");
  const [button, slider, said] = player.children;
  const last = course.time.length - 1;
  let begun = null;
  function show(point) {
    slider.value = point;
    said.textContent = course.time[point] + " ms, " + course.off[point].toFixed(2) + " mm off the model";
    for (const view of views) {
      const [across, up] = view.dataset.sides.split(" ").map(Number);
      const [left, top] = view.dataset.origin.split(" ").map(Number);
      const scale = Number(view.dataset.scale);
      for (const mark of view.querySelectorAll(".now")) {
        const place = course[mark.dataset.of][point];
        mark.setAttribute("cx", left + place[across] * scale);
        mark.setAttribute("cy", top - place[up] * scale);
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
  slider.addEventListener("input", () => { stop(); show(Number(slider.value)); });
});

const dark = matchMedia("(prefers-color-scheme: dark)");
const colours = () => ({
  "font.color": dark.matches ? "#c9cdd2" : "#3a424c",
  "hoverlabel.bgcolor": dark.matches ? "#2b3138" : "#ffffff",
  "hoverlabel.font.color": dark.matches ? "#e8e6e1" : "#1b1f24",
});
const options = { responsive: true, displayModeBar: false, plotlyServerURL: "" };

function paint(place) {
  Plotly.relayout(place, colours());
}
function draw(place) {
  const figure = JSON.parse(document.getElementById(place.dataset.figure).textContent);
  Plotly.newPlot(place, figure.data, figure.layout, options).then(() => paint(place));
  place.dataset.drawn = "yes";
}
function drawWithin(root) {
  root.querySelectorAll(".figure:not([data-drawn])").forEach((place) => {
    const folded = place.closest("details:not([open])");
    if (!folded) draw(place);
  });
}
drawWithin(document);
document.querySelectorAll("details").forEach((part) => part.addEventListener("toggle", () => drawWithin(part)));
dark.addEventListener("change", () =>
  document.querySelectorAll(".figure[data-drawn]").forEach(paint));
addEventListener("beforeprint", () => {
  document.querySelectorAll("details").forEach((part) => { part.open = true; });
  drawWithin(document);
});
document.addEventListener("click", (event) => {
  const button = event.target.closest("button[data-copy]");
  if (!button) return;
  navigator.clipboard.writeText(button.dataset.copy).then(() => {
    button.textContent = "copied";
    setTimeout(() => { button.textContent = "copy"; }, 1500);
  });
});

const campaign = document.title.split(":")[0].replace(/[^\w.-]+/g, "_");
function save(text, kind, name) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([text], { type: kind }));
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}
document.addEventListener("click", (event) => {
  const table = event.target.closest("button[data-csv]");
  if (table) {
    const text = JSON.parse(document.getElementById("csv-" + table.dataset.csv).textContent);
    save(text, "text/csv", campaign + "_" + table.dataset.csv + ".csv");
  }
  const figure = event.target.closest("button[data-svg]");
  if (figure) {
    const place = document.querySelector('[data-figure="' + figure.dataset.svg + '"]');
    const size = { width: place.clientWidth, height: place.clientHeight };
    Plotly.toImage(place, { format: "svg", ...size }).then((url) => {
      const text = decodeURIComponent(url.slice(url.indexOf(",") + 1));
      save(text, "image/svg+xml", campaign + "_" + figure.dataset.svg + ".svg");
    });
  }
});

document.querySelectorAll(".player").forEach((player) => {
  const course = JSON.parse(document.getElementById(player.dataset.path + "-course").textContent);
  const place = document.querySelector('[data-figure="' + player.dataset.path + '"]');
  const [button, slider, said] = player.children;
  const last = course.time.length - 1;
  let begun = null;
  function show(point) {
    slider.value = point;
    said.textContent = course.time[point] + " ms, " + course.off[point].toFixed(2) + " mm off the model";
    if (!place.data) return;
    const at = [course.tip[point], course.model[point]];
    const moved = Object.fromEntries(["x", "y", "z"].map((axis, k) => [axis, at.map((place) => [place[k]])]));
    Plotly.restyle(place, moved, [place.data.length - 2, place.data.length - 1]);
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

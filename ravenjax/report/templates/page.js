const dark = matchMedia("(prefers-color-scheme: dark)");
const colours = () => ({
  "font.color": dark.matches ? "#c9cdd2" : "#3a424c",
  "hoverlabel.bgcolor": dark.matches ? "#2b3138" : "#ffffff",
  "hoverlabel.font.color": dark.matches ? "#e8e6e1" : "#1b1f24",
});
const options = { responsive: true, displayModeBar: false, plotlyServerURL: "" };

const darkScale = [[0, "#22272d"], [0.25, "#5c3a22"], [0.5, "#a65c24"], [0.75, "#e4903f"], [1, "#ffd79a"]];

function paint(place) {
  const maps = place.data.map((trace, i) => (trace.showscale ? i : -1)).filter((i) => i >= 0);
  place.lightScale ??= maps.length ? place.data[maps[0]].colorscale : null;
  if (maps.length) Plotly.restyle(place, { colorscale: [dark.matches ? darkScale : place.lightScale] }, maps);
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

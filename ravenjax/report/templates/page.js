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

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
document.querySelectorAll(".figure").forEach((place) => {
  const figure = JSON.parse(document.getElementById(place.dataset.figure).textContent);
  Plotly.newPlot(place, figure.data, figure.layout, options).then(() => paint(place));
});
dark.addEventListener("change", () => document.querySelectorAll(".figure").forEach(paint));
addEventListener("beforeprint", () => document.querySelectorAll("details").forEach((part) => { part.open = true; }));
function save(text, kind, name) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([text], { type: kind }));
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}
const stem = document.title.replace(/[^\w.-]+/g, "_");
document.addEventListener("click", (event) => {
  const table = event.target.closest("button[data-csv]");
  if (table) {
    const text = JSON.parse(document.getElementById("csv-" + table.dataset.csv).textContent);
    save(text, "text/csv", stem + "_" + table.dataset.csv + ".csv");
  }
  const figure = event.target.closest("button[data-svg]");
  if (figure) {
    const place = document.querySelector('[data-figure="' + figure.dataset.svg + '"]');
    Plotly.toImage(place, { format: "svg", width: place.clientWidth, height: place.clientHeight }).then((url) => {
      save(decodeURIComponent(url.slice(url.indexOf(",") + 1)), "image/svg+xml", stem + "_" + figure.dataset.svg + ".svg");
    });
  }
});

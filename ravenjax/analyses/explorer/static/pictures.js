// Exports the signals of a run: as SVG, PNG and CSV.

import { escaped } from "./field.js";

const LOOKS = { own: ["felt", ""], golden: ["stopped", "5 3"], kept: ["series2", "2 2"], limit: ["unseen", "2 3"] };
const MARGIN = 24;
const HIGH = 84;
const ROW = HIGH + 40;
const WIDE = 1000;

/** SVG text with all signals of the page below each other. duration: of a run, ms. */
export function sheet(title, figures, duration) {
  const style = getComputedStyle(document.documentElement);
  const colour = (name) => style.getPropertyValue(`--${name}`).trim();
  const looks = Object.entries(LOOKS).map(([name, [of, dashes]]) => `.${name}{stroke:${colour(of)};${dashes ? `stroke-dasharray:${dashes};` : ""}}`);
  const height = 2 * MARGIN + 20 + ROW * figures.length;
  const words = (x, y, text, anchor, ink) => `<text x="${x}" y="${y}" text-anchor="${anchor}" fill="${colour(ink)}">${escaped(text)}</text>`;
  const rows = figures.map((figure, k) => {
    const y = MARGIN + 20 + k * ROW;
    const [name, range] = figure.querySelector("figcaption").children;
    return (
      words(MARGIN, y + 18, name.textContent, "start", "ink") +
      words(MARGIN + WIDE, y + 18, range.textContent, "end", "soft") +
      `<svg x="${MARGIN}" y="${y + 26}" width="${WIDE}" height="${HIGH}" viewBox="0 0 ${WIDE} ${HIGH}" preserveAspectRatio="none"><rect width="${WIDE}" height="${HIGH}" fill="${colour("code")}"/>${figure.querySelector("svg").innerHTML}</svg>`
    );
  });
  return (
    `<svg xmlns="http://www.w3.org/2000/svg" width="${WIDE + 2 * MARGIN}" height="${height}" viewBox="0 0 ${WIDE + 2 * MARGIN} ${height}" font-family="sans-serif" font-size="14">` +
    `<style>path,line{fill:none;stroke-width:1.8}.acts{fill:${colour("felt")};opacity:.16}${looks.join("")}</style><rect width="100%" height="100%" fill="${colour("paper")}"/>` +
    `${words(MARGIN, MARGIN + 8, title, "start", "ink")}${rows.join("")}${words(MARGIN, height - MARGIN + 8, "0 ms", "start", "soft")}${words(MARGIN + WIDE, height - MARGIN + 8, `${duration} ms`, "end", "soft")}</svg>\n`
  );
}

/** Converts SVG text to a PNG, with `by` pixels for each CSS pixel. */
export async function png(svg, by = 2) {
  const url = URL.createObjectURL(new Blob([svg], { type: "image/svg+xml" }));
  try {
    const image = new Image();
    image.src = url;
    await image.decode();
    const canvas = document.createElement("canvas");
    Object.assign(canvas, { width: by * image.naturalWidth, height: by * image.naturalHeight });
    canvas.getContext("2d").drawImage(image, 0, 0, canvas.width, canvas.height);
    return await new Promise((resolve) => canvas.toBlob(resolve));
  } finally {
    URL.revokeObjectURL(url);
  }
}

/** CSV of a run's series, one row per millisecond: columns ms, NAME of the run, golden/NAME of its golden run. */
export function course({ golden, faulty }, ticks) {
  const columns = [];
  for (const [prefix, series] of [["", faulty], ["golden/", golden]])
    for (const [name, values] of Object.entries(series)) {
      const width = values.length / ticks;
      for (let k = 0; k < width; k += 1) columns.push([`${prefix}${name}${width > 1 ? `[${k}]` : ""}`, values, width, k]);
    }
  const names = ["ms", ...columns.map(([name]) => name)];
  const lines = [names.join(",")];
  for (let tick = 0; tick < ticks; tick += 1) lines.push([tick, ...columns.map(([, values, width, k]) => Number(values[tick * width + k].toPrecision(7)))].join(","));
  return `${lines.join("\n")}\n`;
}

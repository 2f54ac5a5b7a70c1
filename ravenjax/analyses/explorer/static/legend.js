// A colour and its mark, as a legend shows them.

import { LIGHT } from "./verdicts.js";

const SHAPES = {
  cross: '<path d="M4 4L12 12M12 4L4 12" fill="none" stroke-width="2"/>',
  dot: '<circle cx="8" cy="8" r="3.6" stroke="none"/>',
  ring: '<circle cx="8" cy="8" r="3.6" fill="none" stroke-width="1.6"/>',
  dash: '<path d="M4 8H12" fill="none" stroke-width="2"/>',
  triangle: '<path d="M8 4L12 12H4Z" stroke="none"/>',
  square: '<path d="M5 5H11V11H5Z" stroke="none"/>',
  speck: '<circle cx="8" cy="8" r="2" stroke="none"/>',
};

export function icon(name, mark) {
  const ink = LIGHT.has(name) ? "rgba(0,0,0,.6)" : "#fff";
  return `<svg width="16" height="16" viewBox="0 0 16 16" aria-hidden="true"><rect width="16" height="16" style="fill:var(--${name})"/><g fill="${ink}" stroke="${ink}">${SHAPES[mark] ?? ""}</g></svg>`;
}

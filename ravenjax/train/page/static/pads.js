// Pads for mouse and touch: a hand that springs back, a slider for height, jaws, and the pedal as a button.

import { scale } from "./plots.js";

const REACH = 42; // sixteenths of a rem from the pad's middle to full deflection
const LIFT = 30;

export function build(input) {
  /** @type {any} */
  const holds = document.getElementById("drag-pedal");
  for (const pad of /** @type {NodeListOf<HTMLButtonElement>} */ (document.querySelectorAll("#hands .pad"))) {
    const { arm } = pad.dataset;
    const knob = /** @type {HTMLElement} */ (pad.querySelector("i"));
    const lift = pad.querySelector(".lift");
    const hand = { move: [0, 0, 0], turn: [0, 0, 0], grasp: 0 };
    const held = new Set();
    const tell = () => {
      knob.style.transform = `translate(${(hand.move[0] * REACH) / 16}rem, ${(hand.move[2] * REACH * 0.8) / 16}rem)`;
      /** @type {HTMLElement} */ (lift.firstElementChild).style.transform = `translateY(${(-hand.move[1] * LIFT) / 16}rem)`;
      input.pad(arm, held.size ? { ...hand, move: [...hand.move] } : null, holds.checked);
    };
    drag(pad, held, (x, y) => {
      [hand.move[0], hand.move[2]] = [reached(x, REACH), reached(y, REACH)];
      tell();
    });
    drag(lift, held, (_, y) => {
      hand.move[1] = -reached(y, LIFT);
      tell();
    });
    for (const button of /** @type {NodeListOf<HTMLButtonElement>} */ (pad.querySelectorAll("[data-grasp]"))) {
      press(button, held, (down) => {
        hand.grasp = down ? Number(button.dataset.grasp) : 0;
        tell();
      });
    }
    addEventListener("blur", () => {
      held.clear();
      [hand.move, hand.grasp] = [[0, 0, 0], 0];
      tell();
    });
  }
  press(document.getElementById("pedal"), new Set(), (down) => input.foot(down));
}

export const reached = (way, reach) => Math.max(-1, Math.min(1, way / reach));

function drag(place, held, moved) {
  let from = null;
  place.addEventListener("pointerdown", (event) => {
    if (event.target !== place || event.button > 0) return;
    event.stopPropagation();
    place.setPointerCapture(event.pointerId);
    from = [event.clientX, event.clientY];
    held.add(place);
    moved(0, 0);
  });
  place.addEventListener("pointermove", (event) => from && moved((event.clientX - from[0]) / scale(), (event.clientY - from[1]) / scale()));
  const end = () => {
    if (!from) return;
    from = null;
    held.delete(place);
    moved(0, 0);
  };
  for (const kind of ["pointerup", "pointercancel", "lostpointercapture"]) place.addEventListener(kind, end);
}

function press(button, held, told) {
  button.addEventListener("pointerdown", (event) => {
    if (event.button > 0 || event.target.closest("label")) return;
    event.stopPropagation();
    button.setPointerCapture(event.pointerId);
    held.add(button);
    told(true);
  });
  const end = () => held.delete(button) && told(false);
  for (const kind of ["pointerup", "pointercancel", "lostpointercapture"]) button.addEventListener(kind, end);
}

// Runs before viser's client, whose page this is: names the window, and keeps the keys for the session.
"use strict";

(() => {
  const asked = new URLSearchParams(location.search);
  const name = [...crypto.getRandomValues(new Uint8Array(12))].map((x) => x.toString(16).padStart(2, "0")).join("");
  window.ravenjax = { window: name, role: asked.get("role") === "instructor" ? "instructor" : "operator" };
  // What makes an instructor stays in this tab, out of the address that can be sent on, and out of other tabs.
  if (asked.has("instructor_token")) sessionStorage.setItem("instructor_token", asked.get("instructor_token"));
  window.ravenjax.token = window.ravenjax.role === "instructor" ? (sessionStorage.getItem("instructor_token") ?? "") : "";

  // The scene's socket says whose it is, so that cameras and layers belong to one window. Viser reads its server, and
  // the resolution it draws at, from the address; the visitor keeps an address that can be sent on.
  const plain = new URLSearchParams({ role: window.ravenjax.role });
  if (asked.has("quality")) plain.set("quality", asked.get("quality"));
  const replace = history.replaceState.bind(history);
  const full = new URLSearchParams(plain);
  full.set("websocket", `${location.origin.replace(/^http/, "ws")}/scene/${name}`);
  if (asked.get("quality") === "low") full.set("fixedDpr", "0.5");
  replace(null, "", `?${full}`);
  history.replaceState = () => replace(null, "", `?${plain}`);

  // Keys drive arms, not viser's camera: what is not typed into a field never reaches the page below.
  const keys = new EventTarget();
  window.ravenjax.keys = keys;
  for (const kind of ["keydown", "keyup"]) {
    window.addEventListener(
      kind,
      (event) => {
        if (event.target instanceof Element && event.target.closest("input:not([type=checkbox]), textarea, select")) return;
        event.stopImmediatePropagation();
        const told = new CustomEvent(kind, { detail: event });
        keys.dispatchEvent(told);
      },
      { capture: true },
    );
  }
})();

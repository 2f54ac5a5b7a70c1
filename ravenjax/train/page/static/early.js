// Runs before viser's client, whose page this is: names the window, and keeps the keys for the session.
"use strict";

/** Whether a graphics card draws, and no software in its place. */
function drawable() {
  const pen = document.createElement("canvas").getContext("webgl2");
  if (!pen) return false;
  const card = pen.getExtension("WEBGL_debug_renderer_info");
  const name = card ? pen.getParameter(card.UNMASKED_RENDERER_WEBGL) : "";
  pen.getExtension("WEBGL_lose_context")?.loseContext();
  return !/swiftshader|llvmpipe|softpipe|software|basic render/i.test(name);
}

(() => {
  const asked = new URLSearchParams(location.search);
  // Without a graphics card the scene takes every core for a few pictures a second: the 2D view comes by itself.
  if (!asked.has("scene") && !asked.has("inset") && !drawable()) {
    asked.set("scene", "off");
    asked.set("flat", "1");
    window.stop(); // nothing of this page begins
    location.replace(`?${asked}`);
    return;
  }
  const name = [...crypto.getRandomValues(new Uint8Array(12))].map((x) => x.toString(16).padStart(2, "0")).join("");
  window.ravenjax = { window: name, role: asked.get("role") === "instructor" ? "instructor" : "operator" };
  // What makes an instructor stays in this tab, out of the address that can be sent on, and out of other tabs.
  if (asked.has("instructor_token")) sessionStorage.setItem("instructor_token", asked.get("instructor_token"));
  window.ravenjax.token = window.ravenjax.role === "instructor" ? (sessionStorage.getItem("instructor_token") ?? "") : "";

  // The scene's socket says whose it is, so that cameras and layers belong to one window. Viser reads its server, and
  // the resolution it draws at, from the address; the visitor keeps an address that can be sent on.
  const plain = new URLSearchParams({ role: window.ravenjax.role });
  for (const kept of ["scene", "flat"]) if (asked.has(kept)) plain.set(kept, asked.get(kept));
  if (asked.has("quality")) plain.set("quality", asked.get("quality"));
  const replace = history.replaceState.bind(history);
  const full = new URLSearchParams(plain);
  full.set("websocket", `${location.origin.replace(/^http/, "ws")}/scene/${name}${asked.has("inset") ? `.${asked.get("inset")}` : ""}`);
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
        const typed = event.code !== "Escape"; // it stops the robot wherever the cursor is
        if (typed && event.target instanceof Element && event.target.closest("input:not([type=checkbox]), textarea, select")) return;
        event.stopImmediatePropagation();
        const told = new CustomEvent(kind, { detail: event });
        keys.dispatchEvent(told);
      },
      { capture: true },
    );
  }
})();

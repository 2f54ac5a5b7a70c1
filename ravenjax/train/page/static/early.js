// Runs before viser's client on its page: names the window, and reserves the keys for the session.
"use strict";

/** Whether a graphics card draws, not a software renderer. */
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
  // Without a graphics card the scene needs every core for a few pictures a second, so the 2D view is chosen.
  if (!asked.has("scene") && !asked.has("inset") && !drawable()) {
    asked.set("scene", "off");
    asked.set("flat", "1");
    window.stop(); // stop loading this page
    location.replace(`?${asked}`);
    return;
  }
  const name = [...crypto.getRandomValues(new Uint8Array(12))].map((x) => x.toString(16).padStart(2, "0")).join("");
  window.ravenjax = { window: name, role: asked.get("role") === "instructor" ? "instructor" : "operator" };
  // The instructor's token stays in this tab. It is not in the address, which can be shared, nor in other tabs.
  if (asked.has("instructor_token")) sessionStorage.setItem("instructor_token", asked.get("instructor_token"));
  window.ravenjax.token = window.ravenjax.role === "instructor" ? (sessionStorage.getItem("instructor_token") ?? "") : "";

  // The scene's socket names its window, so that cameras and layers belong to one window. Viser reads its server and
  // resolution from the address. Afterwards the visitor's address is restored, so that it can be shared.
  const plain = new URLSearchParams({ role: window.ravenjax.role });
  for (const kept of ["scene", "flat"]) if (asked.has(kept)) plain.set(kept, asked.get(kept));
  if (asked.has("quality")) plain.set("quality", asked.get("quality"));
  const replace = history.replaceState.bind(history);
  const full = new URLSearchParams(plain);
  if (asked.get("scene") !== "off" || asked.has("inset")) full.set("websocket", `${location.origin.replace(/^http/, "ws")}/scene/${name}${asked.has("inset") ? `.${asked.get("inset")}` : ""}`);
  if (asked.get("quality") === "low") full.set("fixedDpr", "0.5");
  replace(null, "", `?${full}`);
  history.replaceState = () => replace(null, "", `?${plain}`);

  // Keys drive the arms, not viser's camera: a key that is not typed into a field never reaches the page below.
  const keys = new EventTarget();
  window.ravenjax.keys = keys;
  for (const kind of ["keydown", "keyup"]) {
    window.addEventListener(
      kind,
      (/** @type {KeyboardEvent} */ event) => {
        const typed = event.code !== "Escape"; // Escape stops the robot wherever the cursor is
        if (typed && event.target instanceof Element && event.target.closest("input:not([type=checkbox]), textarea, select")) return;
        event.stopImmediatePropagation();
        const told = new CustomEvent(kind, { detail: event });
        keys.dispatchEvent(told);
      },
      { capture: true },
    );
  }
})();

// Chooses this window's view of the field: the scene's cameras, a small second picture, or only the 2D view.

const HINT = "2D view, because the browser can use no graphics card. Add &scene=on to the address to try 3D.";

export class Views {
  constructor(root, send) {
    this.root = root;
    this.send = send;
    this.inset = "";
    this.buttons = [.../** @type {NodeListOf<HTMLButtonElement>} */ (document.querySelectorAll("[data-camera], [data-inset]"))];
    for (const button of this.buttons) button.addEventListener("click", () => (button.dataset.camera ? this.look(button.dataset.camera) : this.add(button.dataset.inset)));
    this.frame = document.createElement("iframe");
    Object.assign(this.frame, { id: "inset", title: "second view of the field", tabIndex: -1, hidden: true });
    document.getElementById("root")?.after(this.frame);
    root.dataset.camera = "endoscope";
    if (!document.getElementById("root")) this.flat();
  }

  /** Presses the button of a key from 1 to 7. */
  press(number) {
    if (!this.root.classList.contains("flat")) this.buttons[number - 1]?.click();
  }

  /** Switches to the next camera. */
  next() {
    const cameras = this.buttons.filter((one) => one.dataset.camera);
    const at = cameras.findIndex((one) => one.getAttribute("aria-pressed") === "true");
    if (!this.root.classList.contains("flat")) cameras[(at + 1) % cameras.length].click();
  }

  look(camera) {
    this.root.dataset.camera = camera;
    this.send({ type: "page", do: "camera", name: camera });
    this.mark();
  }

  /** Opens the second picture with a camera, or closes it if it is open already. */
  add(name) {
    this.inset = this.inset === name ? "" : name;
    document.body.dataset.inset = this.inset;
    if (this.inset === "stereo") this.look("endoscope_left");
    else if (this.root.dataset.camera === "endoscope_left") this.look("endoscope");
    const camera = { theatre: "theatre", second: "second", stereo: "endoscope_right" }[this.inset];
    this.frame.hidden = !camera;
    this.frame.src = camera ? `/?inset=${camera}` : "about:blank";
    this.mark();
    dispatchEvent(new Event("resize"));
  }

  mark() {
    const camera = this.root.dataset.camera.replace("_left", "");
    for (const button of this.buttons) {
      const { camera: look, inset } = button.dataset;
      button.setAttribute("aria-pressed", String(look ? look === camera : inset === this.inset));
    }
  }

  flat() {
    this.root.classList.add("flat");
    const note = document.getElementById("view-note");
    if (!new URLSearchParams(location.search).has("flat")) return;
    note.textContent = HINT;
    note.hidden = false;
  }

  /** Reloads the page without the scene, as `early.js` does without a graphics card. */
  flatten() {
    const asked = new URLSearchParams(location.search);
    if (this.root.classList.contains("flat") || asked.get("scene") === "on") return;
    asked.set("scene", "off");
    asked.set("flat", "1");
    location.search = `${asked}`;
  }
}

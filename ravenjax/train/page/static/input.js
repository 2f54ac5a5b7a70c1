// The operator's hands: keyboard, pads and gamepad make one message, which is sent on changes and as a heartbeat.
// A blurred window, a hidden tab or a closed socket releases the robot.

const HEARTBEAT_MS = 40;
const DEAD_ZONE = 0.12;
const SLOW = 0.3;

// [code, arm, axis, sign]; axes of the view: move 0 right, 1 up, 2 toward; turn likewise; grasp closes
const LEFT = "gold";
const RIGHT = "green";
const KEYS = new Map(
  [
    ["KeyD", LEFT, "move", 0, 1], ["KeyA", LEFT, "move", 0, -1], ["KeyR", LEFT, "move", 1, 1], ["KeyF", LEFT, "move", 1, -1],
    ["KeyS", LEFT, "move", 2, 1], ["KeyW", LEFT, "move", 2, -1], ["KeyQ", LEFT, "turn", 2, 1], ["KeyE", LEFT, "turn", 2, -1],
    ["KeyZ", LEFT, "turn", 0, 1], ["KeyX", LEFT, "turn", 0, -1], ["KeyC", LEFT, "turn", 1, 1], ["KeyV", LEFT, "turn", 1, -1],
    ["KeyG", LEFT, "grasp", 0, 1], ["KeyT", LEFT, "grasp", 0, -1],
    ["ArrowRight", RIGHT, "move", 0, 1], ["ArrowLeft", RIGHT, "move", 0, -1], ["PageUp", RIGHT, "move", 1, 1], ["PageDown", RIGHT, "move", 1, -1],
    ["ArrowDown", RIGHT, "move", 2, 1], ["ArrowUp", RIGHT, "move", 2, -1], ["KeyL", RIGHT, "move", 0, 1], ["KeyJ", RIGHT, "move", 0, -1],
    ["KeyY", RIGHT, "move", 1, 1], ["KeyH", RIGHT, "move", 1, -1], ["KeyK", RIGHT, "move", 2, 1], ["KeyI", RIGHT, "move", 2, -1],
    ["KeyU", RIGHT, "turn", 2, 1], ["KeyO", RIGHT, "turn", 2, -1], ["Comma", RIGHT, "turn", 0, 1], ["Period", RIGHT, "turn", 0, -1],
    ["BracketLeft", RIGHT, "turn", 1, 1], ["BracketRight", RIGHT, "turn", 1, -1],
    ["Semicolon", RIGHT, "grasp", 0, 1], ["KeyP", RIGHT, "grasp", 0, -1],
  ].map(([code, ...what]) => [code, what]),
);

const still = () => ({ move: [0, 0, 0], turn: [0, 0, 0], grasp: 0 });
/** Keys, and buttons of a gamepad, for commands. The E-stop and the restart work in every window. */
const COMMANDS = { Escape: "estop", Backspace: "restart", KeyB: "rehearse", KeyN: "reengage", KeyM: "discard" };
const BUTTONS = { 8: "rehearse", 9: "reengage", 10: "discard", 11: "view" };
const RATE_MS = 2000;
const clipped = (x) => Math.max(-1, Math.min(1, x));

export class Input {
  /** on: {send(message), pressed(stamp), command(name)}; keys: events that early.js withholds from the page below. */
  constructor(keys, on) {
    this.on = on;
    this.arms = [];
    this.enabled = false;
    this.held = new Set();
    this.pads = new Map(); // arm -> a hand like `still()`
    this.padPedal = false;
    this.buttonPedal = false;
    this.source = "keyboard";
    this.muted = false; // a drill uses the hands, and the session receives hands at rest
    this.last = "";
    this.sent = []; // times of the last messages
    this.buttons = new Set(); // buttons of the gamepad that are down and command something
    keys.addEventListener("keydown", ({ detail }) => this.down(detail));
    keys.addEventListener("keyup", ({ detail }) => this.up(detail));
    addEventListener("blur", () => this.release());
    addEventListener("pagehide", () => this.release());
    document.addEventListener("visibilitychange", () => document.hidden && this.release());
    setInterval(() => this.beat(), HEARTBEAT_MS);
  }

  down(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const { code } = event;
    if (code in COMMANDS) {
      event.preventDefault();
      if (!event.repeat) this.on.command(COMMANDS[code]);
      return;
    }
    if (!this.enabled || (code !== "Space" && !code.startsWith("Shift") && !KEYS.has(code))) return;
    event.preventDefault();
    if (event.repeat || this.held.has(code)) return;
    this.held.add(code);
    this.source = "keyboard";
    if (KEYS.has(code)) this.on.pressed(event.timeStamp);
    this.tell();
  }

  up(event) {
    if (this.held.delete(event.code)) {
      event.preventDefault();
      this.tell();
    }
  }

  /** A pad's hand, or null if it is released; pedal: whether the pad also holds the pedal. */
  pad(arm, hand, pedal) {
    if (hand) this.pads.set(arm, hand);
    else this.pads.delete(arm);
    this.padPedal = pedal && this.pads.size > 0;
    this.source = "mouse";
    if (hand) this.on.pressed(performance.now());
    this.tell();
  }

  foot(down) {
    this.buttonPedal = down;
    this.source = "mouse";
    this.tell();
  }

  release() {
    this.held.clear();
    this.pads.clear();
    this.padPedal = this.buttonPedal = false;
    this.tell(true);
  }

  mute(on) {
    this.release();
    this.muted = on;
    this.tell(true);
  }

  get pedal() {
    return this.held.has("Space") || this.padPedal || this.buttonPedal;
  }

  now() {
    const hands = new Map(this.arms.map((arm) => [arm, still()]));
    const add = (arm, hand) => {
      const to = hands.get(arm) ?? (this.arms.length === 1 ? hands.get(this.arms[0]) : null); // with one arm, both halves drive it
      if (!to) return;
      for (let i = 0; i < 3; i += 1) {
        to.move[i] = clipped(to.move[i] + hand.move[i]);
        to.turn[i] = clipped(to.turn[i] + hand.turn[i]);
      }
      to.grasp = clipped(to.grasp + hand.grasp);
    };
    const speed = this.held.has("ShiftLeft") || this.held.has("ShiftRight") ? SLOW : 1;
    for (const code of this.held) {
      if (!KEYS.has(code)) continue;
      /** @type {any[]} */
      const [arm, kind, axis, sign] = KEYS.get(code);
      const hand = still();
      if (kind === "grasp") hand.grasp = sign;
      else hand[kind][axis] = sign * speed;
      add(arm, hand);
    }
    for (const [arm, hand] of this.pads) add(arm, hand);
    const pad = this.gamepad();
    if (pad) {
      add(LEFT, pad.left);
      add(RIGHT, pad.right);
    }
    return { type: "input", source: this.source, pedal: this.pedal || Boolean(pad?.pedal), arms: Object.fromEntries(hands) };
  }

  gamepad() {
    if (!this.enabled || document.hidden || !document.hasFocus()) return null;
    const pad = [...(navigator.getGamepads?.() ?? [])].find((one) => one?.connected && one.mapping === "standard");
    if (!pad) return null;
    const stick = (i) => (Math.abs(pad.axes[i] ?? 0) < DEAD_ZONE ? 0 : clipped(pad.axes[i]));
    const on = (i) => (pad.buttons[i]?.pressed ? 1 : 0);
    const squeeze = (i) => ((pad.buttons[i]?.value ?? 0) < DEAD_ZONE ? 0 : pad.buttons[i].value);
    const left = still();
    const right = still();
    left.move = [stick(0), on(12) - on(13), stick(1)];
    right.move = [stick(2), on(3) - on(0), stick(3)];
    left.grasp = squeeze(6) || -on(2);
    right.grasp = squeeze(7) || -on(1);
    for (const [i, name] of Object.entries(BUTTONS)) {
      if (on(i) && !this.buttons.has(i)) this.on.command(name);
      this.buttons[on(i) ? "add" : "delete"](i);
    }
    const pedal = Boolean(on(4) || on(5));
    if (pedal || [...left.move, ...right.move, left.grasp, right.grasp].some((x) => x !== 0)) this.source = "gamepad";
    return { left, right, pedal };
  }

  /** Messages a second. */
  get rate() {
    const now = performance.now();
    return Math.round((1000 * this.sent.filter((at) => now - at < RATE_MS).length) / RATE_MS);
  }

  /** Sends the message if it has changed. */
  tell(always = false) {
    if (!this.enabled) return;
    const message = this.muted ? { type: "input", source: this.source, pedal: false, arms: Object.fromEntries(this.arms.map((arm) => [arm, still()])) } : this.now();
    const text = JSON.stringify(message);
    if (!always && text === this.last) return;
    this.last = text;
    this.on.send(message);
    const now = performance.now();
    this.sent = [...this.sent.filter((at) => now - at < RATE_MS), now];
  }

  beat() {
    if (document.hidden) return; // without heartbeats the session treats the console as gone
    this.tell(true);
  }
}

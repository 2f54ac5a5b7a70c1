// The session's websocket: receives frames and events, sends input and commands, and reconnects automatically.

const EXTRAS = 5; // numbers of each arm before the row

export class Wire {
  /** on: {welcome(w), frame(f), event(e), seat(free), refused(why), link(up)} */
  constructor(role, windowName, token, on) {
    const asked = new URLSearchParams({ role, window: windowName });
    if (token) asked.set("instructor_token", token);
    this.address = `${location.origin.replace(/^http/, "ws")}/session?${asked}`;
    this.on = on;
    this.wait = 250;
    this.frames = 0;
    this.open();
  }

  open() {
    const socket = new WebSocket(this.address);
    socket.binaryType = "arraybuffer";
    socket.onopen = () => (this.wait = 250);
    socket.onmessage = ({ data }) => this.take(data);
    socket.onclose = () => {
      this.on.link(false);
      setTimeout(() => this.open(), this.wait);
      this.wait = Math.min(4000, this.wait * 2);
    };
    this.socket = socket;
  }

  send(message) {
    const waits = this.socket.bufferedAmount >= 16384; // a newer message replaces the hands, and nothing replaces a command
    if (this.socket.readyState === WebSocket.OPEN && !(waits && message.type === "input")) this.socket.send(JSON.stringify(message));
  }

  take(data) {
    if (typeof data !== "string") {
      if (!this.layout) return;
      this.frames += 1;
      this.on.frame(new Frame(new Float32Array(data), this.layout, this.arms));
      return;
    }
    const told = JSON.parse(data);
    if (told.type === "welcome") {
      this.layout = told.layout;
      this.arms = told.arms;
      this.on.link(true);
      this.on.welcome(told);
    } else if (told.type === "event") this.on.event(told);
    else if (told.type === "seat") this.on.seat(told.free);
    else if (told.type === "refused") this.on.refused(told.why);
  }
}

/** One frame: five numbers for each arm, then the row. */
class Frame {
  constructor(numbers, layout, arms) {
    this.arrived = performance.now();
    this.numbers = numbers;
    this.layout = layout;
    this.first = EXTRAS * arms.length;
    this.arms = arms;
  }

  number(name) {
    return this.numbers[this.first + this.layout[name][0]];
  }

  get(name) {
    const [at, size] = this.layout[name];
    return this.numbers.subarray(this.first + at, this.first + at + size);
  }

  /** Greatest distance from the model, mm, and force since the last frame. */
  peaks(arm) {
    const at = EXTRAS * this.arms.indexOf(arm);
    return { error: this.numbers[at], force: this.numbers[at + 1] };
  }

  /** The tip that the control software wants, as the hand commands it. */
  aim(arm) {
    const at = EXTRAS * this.arms.indexOf(arm) + 2;
    return this.numbers.subarray(at, at + 3);
  }
}

// Presents the cue in a browser: a tone from the side to which the cue pulls, and vibration of phone and gamepad, as
// strong as the force. It is on by default, but browsers allow it only after the visitor's first gesture.

const CAP = 0.05; // device units, the largest force of the published cue
const PULSE_MS = 90;
const LOUDEST = 0.35;
const HZ = [330, 660]; // pitch of the weakest and the strongest cue, within the range of a phone's loudspeaker

export class Haptics {
  /** keys: events that early.js withholds from the page below. A key is a gesture, too. */
  constructor(keys) {
    /** @type {(id: string) => any} */
    const input = (id) => document.getElementById(id);
    this.sound = input("sound");
    this.vibration = input("vibration");
    this.volume = input("volume");
    this.pulsed = 0;
    this.strength = 0;
    this.sound.addEventListener("change", () => this.voice());
    const first = () => this.sound.checked && this.voice();
    addEventListener("pointerdown", first, { once: true });
    keys.addEventListener("keydown", first, { once: true });
  }

  voice() {
    if (this.audio) {
      this.audio.resume();
      return;
    }
    this.audio = new AudioContext();
    this.tone = this.audio.createOscillator();
    this.gain = this.audio.createGain();
    this.side = this.audio.createStereoPanner();
    this.tone.type = "triangle";
    this.gain.gain.value = 0;
    this.tone.connect(this.gain).connect(this.side).connect(this.audio.destination);
    this.tone.start();
  }

  /** force: device units, as the hand feels it, 0 with the cue off; way: its direction [right, up, toward], or null. */
  feel(force, way = null) {
    this.strength = Math.min(1, Math.max(0, force / CAP));
    if (this.audio) {
      const now = this.audio.currentTime;
      this.loudness = this.sound.checked && this.strength ? LOUDEST * (this.volume.value / 100) * (0.4 + 0.6 * this.strength) : 0;
      this.gain.gain.setTargetAtTime(this.loudness, now, 0.01);
      this.tone.frequency.setTargetAtTime(HZ[0] + (HZ[1] - HZ[0]) * this.strength, now, 0.01);
      if (way) this.side.pan.setTargetAtTime(0.8 * way[0], now, 0.02);
    }
    const now = performance.now();
    if (!this.strength || !this.vibration.checked || now - this.pulsed < PULSE_MS || !navigator.userActivation?.hasBeenActive) return;
    this.pulsed = now;
    navigator.vibrate?.(Math.round(PULSE_MS * this.strength));
    for (const pad of navigator.getGamepads?.() ?? [])
      pad?.vibrationActuator
        ?.playEffect?.("dual-rumble", { duration: PULSE_MS, strongMagnitude: this.strength, weakMagnitude: this.strength })
        .catch(() => {}); // the gamepad has no motors
  }

  /** The parts of this machine that can vibrate, in words. */
  motors() {
    const pad = [...(navigator.getGamepads?.() ?? [])].some((one) => one?.vibrationActuator);
    if (pad) return "The gamepad vibrates.";
    return matchMedia("(pointer: coarse)").matches && navigator.vibrate ? "This device vibrates if its settings allow it." : "No device of this machine vibrates: you hear and see the cue.";
  }
}

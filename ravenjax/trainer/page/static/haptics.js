// The cue where a browser can be felt or heard: a tone, the phone's and the gamepad's vibration, as strong as the force.
// Nothing before the visitor's first gesture: browsers forbid it, and rightly.

const CAP = 0.05; // device units, where the published cue ends
const PULSE_MS = 90;

export class Haptics {
  constructor() {
    this.sound = document.getElementById("sound");
    this.vibration = document.getElementById("vibration");
    this.pulsed = 0;
    this.strength = 0;
    this.sound.addEventListener("change", () => this.voice());
    addEventListener("pointerdown", () => this.sound.checked && this.voice(), { once: true });
  }

  voice() {
    if (this.audio) return;
    this.audio = new AudioContext();
    this.tone = this.audio.createOscillator();
    this.gain = this.audio.createGain();
    this.tone.type = "triangle";
    this.gain.gain.value = 0;
    this.tone.connect(this.gain).connect(this.audio.destination);
    this.tone.start();
  }

  /** force: in device units, as the hand feels it; 0 with the cue off. */
  feel(force) {
    this.strength = Math.min(1, Math.max(0, force / CAP));
    if (this.audio) {
      const now = this.audio.currentTime;
      this.gain.gain.setTargetAtTime(this.sound.checked ? 0.16 * this.strength : 0, now, 0.01);
      this.tone.frequency.setTargetAtTime(150 + 200 * this.strength, now, 0.01);
    }
    const now = performance.now();
    if (!this.strength || !this.vibration.checked || now - this.pulsed < PULSE_MS || !navigator.userActivation?.hasBeenActive) return;
    this.pulsed = now;
    navigator.vibrate?.(Math.round(PULSE_MS * this.strength));
    for (const pad of navigator.getGamepads?.() ?? [])
      pad?.vibrationActuator
        ?.playEffect?.("dual-rumble", { duration: PULSE_MS, strongMagnitude: this.strength, weakMagnitude: this.strength })
        .catch(() => {}); // a pad without motors
  }
}

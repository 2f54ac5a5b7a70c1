// The cue where a browser can be felt or heard: a tone from the side that it pulls to, and the phone's and the gamepad's
// vibration, as strong as the force. On by default, but nothing before the visitor's first gesture: browsers forbid it.

const CAP = 0.05; // device units, where the published cue ends
const PULSE_MS = 90;
const LOUDEST = 0.35;
const HZ = [330, 660]; // of the weakest and the strongest cue: what the loudspeaker of a phone can play

export class Haptics {
  /** keys: what early.js keeps from the page below; a key is a gesture too. */
  constructor(keys) {
    for (const id of ["sound", "vibration", "volume"]) this[id] = document.getElementById(id);
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

  /** force: in device units, as the hand feels it, 0 with the cue off; way: where it pulls, [right, up, toward], or null. */
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
        .catch(() => {}); // a pad without motors
  }

  /** What of this machine can vibrate, in words. */
  motors() {
    const pad = [...(navigator.getGamepads?.() ?? [])].some((one) => one?.vibrationActuator);
    if (pad) return "The gamepad vibrates.";
    return matchMedia("(pointer: coarse)").matches && navigator.vibrate ? "This device vibrates, where its settings allow it." : "Nothing here vibrates: the cue is heard and seen.";
  }
}

// After the end: the instructor's form for the next session, and the way to the list of all.

export class NextSession {
  constructor(form, send, token) {
    this.form = form;
    const [participant, scenario, seed] = form.querySelectorAll("input");
    Object.assign(this, { participant, scenario });
    form.querySelector("a").href = `/sessions?instructor_token=${encodeURIComponent(token ?? "")}`;
    form.addEventListener("submit", (event) => {
      event.preventDefault();
      const wish = { type: "instructor", do: "next", participant: participant.value.trim() };
      if (scenario.value.trim() && scenario.value.trim() !== this.present) wish.scenario = scenario.value.trim(); // the present one may be a file
      if (seed.value.trim()) wish.seed = Number(seed.value);
      send(wish);
      this.waits(true);
    });
  }

  waits(on, why = "") {
    this.waiting = on;
    this.form.querySelector("button").textContent = on ? "It is being prepared" : "Start the next session";
    this.form.querySelector(".note").textContent = why;
  }

  /** Why the wish was not taken. */
  refused(why) {
    if (this.waiting) this.waits(false, why);
  }

  /** A window that comes back to another session begins anew. */
  welcome(header) {
    if (this.name && this.name !== header.name) location.reload();
    this.name = header.name;
    this.form.hidden = true;
    this.participant.value = header.participant ?? "";
    this.present = header.scenario?.name ?? "";
    this.scenario.value = this.present;
  }

  frame(phase) {
    this.form.hidden = phase !== "over";
  }
}

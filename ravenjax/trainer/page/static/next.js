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
      if (scenario.value.trim()) wish.scenario = scenario.value.trim();
      if (seed.value.trim()) wish.seed = Number(seed.value);
      send(wish);
      form.querySelector("button").textContent = "It is being prepared";
    });
  }

  /** A window that comes back to another session begins anew. */
  welcome(header) {
    if (this.name && this.name !== header.name) location.reload();
    this.name = header.name;
    this.form.hidden = true;
    this.participant.value = header.participant ?? "";
    this.scenario.value = header.scenario?.name ?? "";
  }

  frame(phase) {
    this.form.hidden = phase !== "over";
  }
}

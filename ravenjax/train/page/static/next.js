// Shows the instructor's form for the next session after the end. It links to the list of sessions, which may fill it.

const CHANNEL = "ravenjax-next"; // messages to and from the list of sessions in another tab

export class NextSession {
  constructor(form, send, token) {
    this.form = form;
    const [participant, scenario, seed] = form.querySelectorAll("input");
    this.participant = participant;
    this.scenario = scenario;
    this.seed = seed;
    this.list = new BroadcastChannel(CHANNEL);
    this.list.addEventListener("message", ({ data }) => data.wish && this.asked(data.wish));
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

  tell(answer) {
    // oxlint-disable-next-line unicorn/require-post-message-target-origin -- a channel is of its own origin alone
    this.list.postMessage(answer);
  }

  /** Starts the session that the list requests, as if its values had been typed into the form. */
  asked({ participant, scenario, seed }) {
    if (this.form.hidden) {
      this.tell({ why: "The present session is not over: end it on the instructor's panel." });
      return;
    }
    Object.assign(this.participant, { value: participant });
    Object.assign(this.scenario, { value: scenario });
    Object.assign(this.seed, { value: seed });
    if (!this.form.reportValidity()) {
      this.tell({ why: "The scenario must be the name of a bundled scenario, the seed a whole number." });
      return;
    }
    this.form.requestSubmit();
    this.tell({ why: "" });
  }

  waits(on, why = "") {
    this.waiting = on;
    this.form.querySelector("button").textContent = on ? "The session is being prepared" : "Start the next session";
    this.form.querySelector(".note").textContent = why;
  }

  /** Shows why the request was refused. */
  refused(why) {
    if (!this.waiting) return;
    this.waits(false, why);
    this.tell({ why });
  }

  /** A window that reconnects to another session is reloaded. */
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

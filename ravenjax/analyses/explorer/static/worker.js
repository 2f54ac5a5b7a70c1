// A worker of the explorer's page: computes batches of runs with a campaign's WebAssembly, four robots side by side.
// It is a classic script, so that a page opened from a file can start it from a Blob.
"use strict";

const CHUNK = 250; // ticks computed for one vector of lanes before the next, so that their rows stay in the cache
const EVERY = 25; // ticks from one snapshot of the golden run to the next
const PAGE = 65_536;
const LINE = 64;

/** A compiled program of the description, with its memory: buffers for `vectors` vectors of lanes. */
class Program {
  constructor(layout, module, ticks, motionBytes, vectors) {
    this.layout = layout;
    this.ticks = ticks;
    this.vectors = vectors;
    this.memory = new WebAssembly.Memory({ initial: 1 });
    /** @type {Record<string, any>} */
    this.code = new WebAssembly.Instance(module, { env: { __linear_memory: this.memory } }).exports;
    this.end = LINE;
    this.outputs = layout.series + layout.outputs.reduce((sum, output) => sum + output.types.length, 0);
    this.step = 4 * layout.width; // bytes between two output numbers
    this.inputs = this.room(vectors * layout.inputs.bytes);
    this.groupInputs = this.room(layout.group_inputs.bytes);
    this.state = this.room(vectors * layout.state_bytes);
    this.held = this.room(vectors * layout.held_bytes);
    this.group = this.room(layout.group_state_bytes);
    this.rows = this.room(CHUNK * layout.row_bytes);
    this.results = this.room(layout.results.bytes);
    this.places = Int32Array.from(layout.results.offsets, (offset) => (this.results + offset) / 4);
    this.nowhere = this.room(4 * layout.series); // zeros, for runs without a golden run
    this.sink = this.room(this.outputs * this.step);
    this.tables = this.room(motionBytes);
    this.given = this.room(4 * layout.series * ticks);
    this.out = this.room(this.outputs * this.step * ticks);
    this.memory.grow(Math.max(0, Math.ceil((this.end - this.memory.buffer.byteLength) / PAGE)));
    this.words = new Int32Array(this.memory.buffer);
    this.floats = new Float32Array(this.memory.buffer);
    this.led = null;
  }

  /** Sets the motion of the hands. */
  lead(motion) {
    if (this.led === motion) return;
    this.words.set(new Int32Array(motion), this.tables / 4);
    this.led = motion;
  }

  room(bytes) {
    const first = Math.ceil(this.end / LINE) * LINE;
    this.end = first + bytes;
    return first;
  }

  /** Resets the lanes. parameters: words of all lanes; faults: words of each lane, of which the last are repeated. */
  begin(parameters, faults, lanes) {
    const { inputs, group_inputs: shared, width, state_bytes, held_bytes } = this.layout;
    const fields = inputs.offsets.length - parameters.length;
    const word = (lane, k) =>
      k < parameters.length ? parameters[k] : faults[Math.min(lane, lanes - 1) * fields + k - parameters.length];
    for (const [k, offset] of inputs.offsets.entries())
      for (let lane = 0; lane < Math.ceil(lanes / width) * width; lane += 1) {
        const vector = this.inputs + Math.floor(lane / width) * inputs.bytes;
        this.words[(vector + offset) / 4 + (lane % width)] = word(lane, k);
      }
    for (const [k, offset] of shared.offsets.entries()) this.words[(this.groupInputs + offset) / 4] = word(0, k);
    this.code.shared_begin(this.groupInputs, this.group);
    for (let v = 0; v * width < lanes; v += 1)
      this.code.lane_begin(this.inputs + v * inputs.bytes, this.state + v * state_bytes, this.held + v * held_bytes);
  }

  /** Address of the input of tick `first`, and the bytes from it to that of the next tick. */
  entering(first, compared) {
    const stride = compared ? 4 * this.layout.series : 0;
    return [compared ? this.given + first * stride : this.nowhere, BigInt(stride), 4n];
  }

  share(first, until, compared) {
    const { code, groupInputs, group, tables, rows } = this;
    code.shared_run(groupInputs, group, tables, ...this.entering(first, compared), rows, first, BigInt(until - first));
  }

  /** Computes ticks of vector `v`, whose rows begin at `row`; keep: whether the outputs of each tick are stored. */
  advance(v, row, first, until, compared, keep) {
    const { inputs, state_bytes, held_bytes, row_bytes } = this.layout;
    const size = this.outputs * this.step;
    this.code.lane_run(
      this.inputs + v * inputs.bytes,
      this.held + v * held_bytes,
      this.state + v * state_bytes,
      this.tables,
      ...this.entering(first, compared),
      this.rows + (first - row) * row_bytes,
      keep ? this.out + first * size : this.sink,
      BigInt(keep ? size : 0),
      BigInt(this.step),
      BigInt(until - first),
    );
  }

  /** Computes the results of the lanes of vector `v`, for `lane`. */
  finish(v) {
    const { inputs, state_bytes } = this.layout;
    this.code.lane_finish(this.inputs + v * inputs.bytes, this.state + v * state_bytes, this.group, this.results);
  }

  /** Copies the results of a lane of the last vector to `words`, from index `at` on. */
  lane(lane, words, at) {
    for (let k = 0; k < this.places.length; k += 1) words[at + k] = this.words[this.places[k] + lane];
  }

  /** The stored series of the last run, for `given`. */
  series() {
    const { series } = this.layout;
    const size = (this.outputs * this.step) / 4;
    const values = new Int32Array(series * this.ticks);
    for (let tick = 0; tick < this.ticks; tick += 1)
      for (let k = 0; k < series; k += 1) values[tick * series + k] = this.words[this.out / 4 + tick * size + (k * this.step) / 4];
    return values;
  }

  /** Sets the series of the golden run with which runs are compared. */
  compare(series) {
    this.words.set(series, this.given / 4);
  }
}

/** Computes batches of runs and the golden run of their question. */
class Core {
  constructor({ description, modules, motions, vectors }) {
    const { programs, ticks } = description;
    this.description = description;
    this.ticks = ticks;
    this.motions = motions;
    const size = Object.values(motions)[0].byteLength;
    this.outcomes = new Program(programs.outcomes, modules.outcomes, ticks, size, vectors);
    this.replayed = null;
    this.open = () => new Program(programs.replay, modules.replay, ticks, size, 1);
    this.question = null;
  }

  /** The golden run of a question, computed once: its series, its results at the end, its snapshots. */
  golden(parameters, motion) {
    const one = this.outcomes;
    const led = one.led === this.motions[motion];
    if (led && this.question !== null && this.question.every((word, k) => word === parameters[k])) return;
    one.lead(this.motions[motion]);
    const none = new Int32Array(one.layout.inputs.offsets.length - parameters.length);
    this.question = null;
    one.begin(parameters, none, 1);
    for (let first = 0; first < this.ticks; first += CHUNK) {
      const until = Math.min(first + CHUNK, this.ticks);
      one.share(first, until, false);
      one.advance(0, first, first, until, false, true);
    }
    this.last = new Int32Array(one.layout.outcomes.length);
    one.finish(0);
    one.lane(0, this.last, 0);
    one.compare(one.series());
    // Compute it again, compared with itself: runs start from its snapshots.
    one.begin(parameters, none, 1);
    const { state_bytes: lanes, group_state_bytes: group } = one.layout;
    this.snapshots = [];
    this.ends = new Map();
    for (let first = 0; first < this.ticks; first += EVERY) {
      this.snapshots.push({
        lanes: one.words.slice(one.state / 4, (one.state + lanes) / 4),
        group: one.words.slice(one.group / 4, (one.group + group) / 4),
      });
      const until = Math.min(first + EVERY, this.ticks);
      one.share(first, until, true);
      one.advance(0, first, first, until, true, false);
    }
    this.question = parameters.slice();
  }

  /** Words of the golden run's results when a run ends at `end`. */
  goldenAt(end, parameters) {
    if (end === this.ticks) return this.last;
    if (!this.ends.has(end)) {
      const one = this.outcomes;
      one.begin(parameters, new Int32Array(one.layout.inputs.offsets.length - parameters.length), 1);
      const from = Math.min(Math.floor(end / EVERY), this.snapshots.length - 1);
      this.restore(from, 0);
      if (end > from * EVERY) {
        one.share(from * EVERY, end, true);
        one.advance(0, from * EVERY, from * EVERY, end, true, false);
      }
      const words = new Int32Array(one.layout.outcomes.length);
      one.finish(0);
      one.lane(0, words, 0);
      this.ends.set(end, words);
    }
    return this.ends.get(end);
  }

  /** Sets the group, and vector `v`, to a snapshot of the golden run. */
  restore(snapshot, v) {
    const { outcomes: one, snapshots } = this;
    one.words.set(snapshots[snapshot].lanes, (one.state + v * one.layout.state_bytes) / 4);
    one.words.set(snapshots[snapshot].group, one.group / 4);
  }

  /** Results of runs, words [runs * outcomes], and of the golden run at the same ticks. */
  run({ parameters, motion, faults, acts, ends }) {
    const { outcomes: one, ticks } = this;
    const { width } = one.layout;
    const runs = ends.length;
    const size = one.layout.outcomes.length;
    this.golden(parameters, motion);
    const usual = new Int32Array(runs * size);
    for (let run = 0; run < runs; run += 1) usual.set(this.goldenAt(ends[run], parameters), run * size);
    one.begin(parameters, faults, runs);
    const begins = [];
    for (let v = 0; v * width < runs; v += 1) {
      const first = Math.min(...acts.subarray(v * width, (v + 1) * width));
      const snapshot = Math.min(Math.max(0, Math.floor((first - 1) / EVERY)), this.snapshots.length - 1);
      if (snapshot) this.restore(snapshot, v);
      begins.push(snapshot * EVERY);
    }
    const begin = Math.min(...begins);
    if (begin) one.words.set(this.snapshots[begin / EVERY].group, one.group / 4);
    else one.code.shared_begin(one.groupInputs, one.group);
    const marks = new Set([...ends, ...begins]);
    for (let tick = begin; tick < ticks; tick += CHUNK) marks.add(tick);
    const stops = [...marks].filter((mark) => mark >= begin).sort((a, b) => a - b);
    const words = new Int32Array(runs * size);
    const last = Math.max(...ends);
    for (const [place, first] of stops.entries()) {
      for (let v = 0; v < begins.length; v += 1) {
        const mine = ends.subarray(v * width, (v + 1) * width);
        if (!mine.includes(first)) continue;
        one.finish(v);
        for (const [lane, end] of mine.entries()) if (end === first) one.lane(lane, words, (v * width + lane) * size);
      }
      if (first >= last) break;
      const until = stops[place + 1] ?? last;
      one.share(first, until, true);
      for (let v = 0; v < begins.length; v += 1)
        if (begins[v] <= first && ends.subarray(v * width, (v + 1) * width).some((end) => end > first))
          one.advance(v, first, first, until, true, false);
    }
    return { words, usual };
  }

  /** Time series by name, one value per millisecond, and results at the end, of one run and its golden run. */
  replay({ parameters, motion, faults, end }) {
    this.replayed ??= this.open();
    const one = this.replayed;
    one.lead(this.motions[motion]);
    const none = new Int32Array(faults.length);
    const golden = this.course(parameters, none, false, end);
    one.compare(one.series());
    const faulty = this.course(parameters, faults, true, end);
    golden.series.unintended_mm.fill(0); // unintended motion is measured from the golden run
    for (const arm of this.description.arms) {
      const tip = `${arm}/tip`;
      for (const { series } of [golden, faulty]) series[`${arm}/deviation_mm`] = apart(series[tip], golden.series[tip]);
    }
    return { golden, faulty };
  }

  course(parameters, faults, compared, end) {
    const { replayed: one, ticks } = this;
    const size = one.layout.outcomes.length;
    const results = new Int32Array(ticks * size);
    one.begin(parameters, faults, 1);
    for (let tick = 0; tick < ticks; tick += 1) {
      one.share(tick, tick + 1, compared);
      one.advance(0, tick, tick, tick + 1, compared, true);
      one.finish(0);
      one.lane(0, results, tick * size);
    }
    return { series: this.named(results), end: results.slice((end - 1) * size, end * size) };
  }

  /** The stored series of a replay by name, with check/NAME/margin and check/NAME/count. */
  named(results) {
    const { replayed: one, ticks } = this;
    const { outputs, outcomes, series } = one.layout;
    const [whole, real] = [one.words, one.floats].map((all) => all.subarray(one.out / 4, one.out / 4 + ticks * one.outputs));
    const named = {};
    let place = series;
    for (const { name, types, scales } of outputs) {
      const width = types.length;
      const values = new Float32Array(ticks * width);
      for (let k = 0; k < width; k += 1) {
        const from = types[k] === "float32" ? real : whole;
        const truth = types[k] === "bool";
        for (let tick = 0; tick < ticks; tick += 1) {
          const value = from[tick * one.outputs + place + k];
          values[tick * width + k] = (truth ? Number(value !== 0) : value) * scales[k];
        }
      }
      named[name] = values;
      place += width;
    }
    const measured = new Float32Array(results.buffer);
    const size = outcomes.length;
    const far = outcomes.indexOf("unintended_mm");
    named.unintended_mm = Float32Array.from({ length: ticks }, (_, tick) => Math.max(0, measured[tick * size + far]));
    for (const name of this.description.checks)
      for (const [what, from] of [
        ["margin", measured],
        ["count", results],
      ]) {
        const k = outcomes.indexOf(`check_${name}_${what}`);
        named[`check/${name}/${what}`] = Float32Array.from({ length: ticks }, (_, tick) => from[tick * size + k]);
      }
    return named;
  }
}

/** Distance of two trajectories of a point, mm. */
function apart(a, b) {
  const out = new Float32Array(a.length / 3);
  for (let tick = 0; tick < out.length; tick += 1) {
    const k = 3 * tick;
    out[tick] = 1e3 * Math.hypot(a[k] - b[k], a[k + 1] - b[k + 1], a[k + 2] - b[k + 2]);
  }
  return out;
}

/** The buffers of the arrays in an answer, which are transferred without a copy. */
const memories = (result) => [...new Set(arrays(result).map(({ buffer }) => buffer))];
const arrays = (value) => (ArrayBuffer.isView(value) ? [value] : Object.values(value).flatMap(arrays));

let core = null;
/** The program for runs with an action, opened when it is first needed. @type {() => Core} */
let acting = null;

const TASKS = {
  open: (task) => {
    core = new Core(task);
    const { description, modules } = task;
    const programs = { ...description.programs, outcomes: description.programs.acted };
    let other = null;
    acting = () => (other ??= new Core({ ...task, description: { ...description, programs }, modules: { ...modules, outcomes: modules.acted } }));
    return {};
  },
  outcomes: (task) => core.run(task),
  acted: (task) => acting().run(task),
  replay: (task) => core.replay(task),
};

addEventListener("message", ({ data: { id, kind, task } }) => {
  try {
    const result = TASKS[kind](task);
    /** @type {any} */ (globalThis).postMessage({ id, result }, memories(result)); // of a worker, not of a window
  } catch (error) {
    postMessage({ id, error: `${error}` });
  }
});

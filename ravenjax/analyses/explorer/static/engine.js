// Computes the outcomes of faults with a campaign's WebAssembly: packs inputs, uses workers, derives verdicts.
// `description` is the object of `describe_program` in ravenjax/analyses/explorer/program.py.
//
//   const engine = await openEngine(description, { threads: 4 });
//   const question = engine.question();                       path -> value, observe_ms, and motion (its name)
//   const outcomes = await engine.outcomes(question, [{ site: "usb_out", arm: "gold", channel: "elbow",
//     effect: "overwrite", value: 9000, start_ms: 900, duration_ms: 64 }]);
//
// An outcome has the columns of a campaign's result table by their names (response, response_cause, response_ms,
// told_ms, hazard, verdict, unintended_first_ms, peak_golden_deviation_mm, check_NAME_first_ms, cue0_first_ms, jump_tip,
// failed, ..), and `evades`, `cue` and `tripped`: [{ name, first_ms, count, response }] of checks that tripped more
// often than in the golden run, or sooner, by time. The columns built_in_response and built_in_told_ms of campaigns with
// checks of their own are missing. With observe_ms, a fault that counts packets or time in pedal-down is observed to the
// end of the run.

import { bytes } from "./bytes.js";

const LANES = 16; // runs of a batch, about a tenth of a second; then a newer request may come first

/** Converts numbers of these types to 32-bit words. */
function words(types, values) {
  const view = new DataView(new ArrayBuffer(4 * types.length));
  for (const [k, type] of types.entries()) {
    if (type === "float32") view.setFloat32(4 * k, values[k], true);
    else if (type === "uint32") view.setUint32(4 * k, values[k], true);
    else view.setInt32(4 * k, values[k], true);
  }
  return new Int32Array(view.buffer);
}

/** Reads numbers of these types from 32-bit words, by these names. */
function numbers(names, types, from) {
  const [floats, wholes] = [Float32Array, Uint32Array].map((Kind) => new Kind(from.buffer, from.byteOffset, from.length));
  const out = {};
  for (let k = 0; k < types.length; k += 1) {
    const type = types[k];
    out[names[k]] = type === "float32" ? floats[k] : type === "bool" ? from[k] !== 0 : type === "uint32" ? wholes[k] : from[k];
  }
  return out;
}

/** First and last tick of a fault's window, as in ravenjax/faults/clocks.py; `ticks` and -1 if it never opens. */
function opening(fault, ticks) {
  const { start, duration, every } = fault;
  const period = every > 0 ? every : Infinity;
  const within = (reading) => (period === Infinity ? reading - start : (((reading - start) % period) + period) % period);
  let first = Math.max(0, start);
  if (within(first) >= duration) first = period === Infinity ? ticks : first + period - within(first);
  const final = ticks - 1;
  const last = final - Math.max(within(final) - duration + 1, 0);
  return { first: Math.min(first, ticks), last: last >= Math.max(0, start) ? last : -1 };
}

/** Converts a fault of the page to the numbers of a fault slot. Throws RangeError if the program lacks the fault. */
export function slot(description, fault) {
  const { channels, effects, triggers, tick_ms: tick } = description;
  const effect = effects[fault.effect];
  if (!effect) throw new RangeError(`effect ${fault.effect} is unknown: expected ${Object.keys(effects).join(", ")}`);
  const name = effect.channel ?? fault.channel;
  const place = channels.findIndex(
    (one) => one.site === fault.site && (name === undefined || one.channel === name) && (!one.arm || !fault.arm || one.arm === fault.arm),
  );
  if (place < 0) throw new RangeError(`site ${fault.site} has no channel ${name ?? "at all"} in this campaign`);
  if (!channels[place].effects.includes(fault.effect))
    throw new RangeError(`${fault.site} takes ${channels[place].effects.join(", ")} in this campaign, not ${fault.effect}`);
  const trigger = fault.trigger ?? Object.keys(triggers)[0];
  if (!(trigger in triggers)) throw new RangeError(`trigger ${trigger} is not among ${Object.keys(triggers).join(", ")}`);
  const lasts = fault.duration_ms === "end" || fault.duration_ms === undefined || fault.duration_ms < 0;
  const unit = trigger === "packet" ? 1 : tick; // the clock of packets counts packets
  const value = effect.constant ?? fault.value ?? 0;
  return {
    code: place + 1,
    effect: effect.code,
    value: fault.effect === "drift" ? value * tick : value,
    trigger: triggers[trigger],
    start: Math.floor(fault.start_ms / unit),
    duration: lasts ? description.forever : Math.floor(fault.duration_ms / unit),
    every: Math.floor((fault.every_ms ?? 0) / unit),
    period: Math.floor((fault.period_ms ?? 0) / tick),
    key: fault.key ?? 0,
    clock: trigger,
  };
}

/** Packs the faults of runs as 32-bit words, with the ticks at which they begin and end. Each of `faults` is a fault or a list. */
export function pack(description, question, faults) {
  const { fields, slots, ticks, tick_ms: tick } = description;
  const names = Object.keys(fields);
  const types = Object.values(fields);
  const runs = faults.map((one) => (Array.isArray(one) ? one : one === null ? [] : [one]).map((fault) => slot(description, fault)));
  const packed = new Int32Array(runs.length * slots * names.length);
  const acts = new Int32Array(runs.length).fill(ticks);
  const ends = new Int32Array(runs.length).fill(ticks);
  const observe = question.observe_ms ?? null; // a whole number of ticks
  for (const [run, some] of runs.entries()) {
    if (some.length > slots) throw new RangeError(`${some.length} faults in a run, expected ${slots} at most`);
    let last = 0;
    for (const [k, one] of some.entries()) {
      packed.set(words(types, names.map((name) => one[name])), (run * slots + k) * names.length);
      const open = opening(one, ticks);
      const timed = one.clock === "time";
      acts[run] = Math.min(acts[run], timed ? open.first : Math.max(0, one.start - 1));
      const final = timed ? open.last + 1 : ticks;
      if (final > 0 && observe !== null) last = Math.max(last, Math.min(final + observe / tick, ticks));
    }
    if (last > 0) ends[run] = last;
  }
  return { packed, acts, ends, faulty: runs.map((some) => some.length > 0) };
}

const UNNUMBERED = new Set(["observe_ms", "motion"]); // keys of a question that are no parameters
const motionOf = (description, question) => question.motion ?? description.motion;

/** Converts a question's parameters to words. Throws for a path that the program does not know. */
export function packQuestion(description, question) {
  const { parameters } = description;
  const known = new Set(parameters.map((one) => one.path));
  for (const path of Object.keys(question))
    if (!UNNUMBERED.has(path) && !known.has(path)) throw new RangeError(`no parameter ${path} in this program`);
  if (!(motionOf(description, question) in description.motions)) throw new RangeError(`no motion ${question.motion} in this page`);
  return words(
    parameters.map((one) => one.type),
    parameters.map((one) => question[one.path] ?? one.value),
  );
}

/** Time of an event, ms; -1 if it never occurred or the golden run had it before. */
const beyondGolden = (own, golden) => (own >= 0 && !(golden >= 0 && golden <= own) ? own : -1);

/** The trips and the response of checks beyond the golden run's, as in ravenjax/outcomes/verdict.py. */
function response(rules, own, golden) {
  const onset = own.first_active_ms;
  let strongest = rules.responses.indexOf("silent");
  let cause = "";
  let first = -1;
  let told = -1;
  const tripped = [];
  for (const check of rules.checks) {
    if (check.watches) continue;
    const rank = rules.responses.indexOf(check.response);
    const [count, usual] = [own, golden].map((columns) => columns[`check_${check.name}_count`]);
    const [trip, usually] = [own, golden].map((columns) => columns[`check_${check.name}_first_ms`]);
    const sooner = beyondGolden(trip, usually) >= 0;
    if (count <= usual && !sooner) continue;
    const ms = sooner ? trip : Math.max(trip, onset); // if the golden run has tripped before: not before the fault
    tripped.push({ name: check.name, first_ms: ms, count: count - usual, response: check.response });
    if (strongest > rank || (strongest === rank && ms < first)) {
      strongest = rank;
      cause = check.cause;
      first = ms;
    }
    if (rules.told.includes(check.response) && (told < 0 || ms < told)) told = ms;
  }
  tripped.sort((a, b) => a.first_ms - b.first_ms);
  return { response: rules.responses[strongest], response_cause: cause, response_ms: first, told_ms: told, tripped };
}

/** Why a run has no valid outcome, and when it failed, as in ravenjax/campaign/outcomes.py. */
function failure(description, measures) {
  const { failures, failure_of_tip, failure_of_outcome, may_be_infinite } = description.verdict;
  let first = measures.failed_ms;
  let signal = measures.failed_signal ?? (first >= 0 ? failure_of_tip : -1);
  if (first < 0)
    for (const name in measures) {
      const value = measures[name];
      if (typeof value !== "number" || Number.isFinite(value)) continue;
      if (Number.isNaN(value) || !may_be_infinite.some((end) => name.endsWith(end))) {
        first = description.ticks * description.tick_ms;
        signal = failure_of_outcome;
        break;
      }
    }
  return { failed: failures[signal + 1], failed_first_ms: first };
}

/** A run's columns of the result table, from the results of the run and of its golden run. */
export function judge(description, measures, golden, faulty) {
  const rules = description.verdict;
  const { diverged_ms: diverged, failed_ms: _ms, failed_signal: _signal, ...own } = measures;
  const out = { restart_ms: -1, ...own, ...failure(description, measures), activated: measures.active_ticks > 0, diverged: faulty && diverged >= 0 };
  for (const rule of ["code", "text", "tip"]) {
    const ms = measures[`jump_${rule}_ms`];
    delete out[`jump_${rule}_ms`];
    out[`jump_${rule}`] = ms >= 0;
    out[`jump_${rule}_first_ms`] = ms;
  }
  if (rules.overload in out) out[rules.overload] = rules.cables[out[rules.overload] + 1];
  out.tissue_depth_mm = Math.max(out.tissue_depth_mm, 0);
  if (!Number.isFinite(out.tip_distance_mm)) out.tip_distance_mm = NaN;
  for (const name of rules.golden_outcomes) out[`golden_${name}`] = golden[name];
  out.golden_tissue_depth_mm = Math.max(out.golden_tissue_depth_mm, 0);
  const did = response(rules, measures, golden);
  const stopped = did.response === "stopped";
  const halted = out.halted_ms - out.golden_halted_ms > rules.halt_ms && !stopped;
  const hazards = [out.unintended_first_ms >= 0, out.loss_first_ms >= 0 || halted, out.false_report_first_ms >= 0, true];
  const hazard = rules.hazards[hazards.indexOf(true)];
  const cue = description.cue;
  const came = beyondGolden(out[`cue${cue}_first_ms`], out[`golden_cue${cue}_first_ms`]) >= 0;
  const valid = out.failed === "";
  return Object.assign(out, did, {
    hazard,
    cue: came,
    evades: valid && rules.untold.includes(did.response) && hazard === rules.hazards[0],
    verdict: valid ? `${did.response}/${hazard}/${rules.cues[came ? 0 : 1]}` : "",
  });
}

/** Workers that take tasks in the order of their priority. */
class Pool {
  constructor(text, threads) {
    this.url = URL.createObjectURL(new Blob([text], { type: "text/javascript" }));
    this.waiting = [];
    this.workers = Array.from({ length: threads }, () => {
      const worker = new Worker(this.url);
      const one = { worker, task: null };
      worker.addEventListener("message", ({ data }) => this.done(one, data));
      worker.addEventListener("error", (event) => this.done(one, { result: null, error: event.message || "a worker of this page does not run" }));
      return one;
    });
  }

  /** Send a task to every worker. */
  all(kind, task) {
    return Promise.all(
      this.workers.map((one) => new Promise((resolve, reject) => this.give(one, { kind, task, resolve, reject, token: null }))),
    );
  }

  submit(kind, task, { priority, token }) {
    return new Promise((resolve, reject) => {
      const place = this.waiting.findIndex((other) => other.priority < priority);
      const one = { kind, task, priority, token, resolve, reject };
      this.waiting.splice(place < 0 ? this.waiting.length : place, 0, one);
      this.next();
    });
  }

  next() {
    for (const one of this.workers) if (!one.task && this.waiting.length) this.give(one, this.waiting.shift());
  }

  give(one, task) {
    one.task = task;
    one.worker.postMessage({ id: 0, kind: task.kind, task: task.task }, []);
  }

  done(one, { result, error }) {
    const { task } = one;
    one.task = null;
    if (error) task?.reject(new Error(error));
    else task?.resolve(result);
    this.next();
  }

  /** Drops the tasks of a token: waiting tasks never begin, and results of running tasks are ignored. */
  cancel(token) {
    const gone = (task) => task?.token === token;
    const stop = (task) => task.reject(new DOMException("a newer question came", "AbortError"));
    this.waiting.filter(gone).forEach(stop);
    this.waiting = this.waiting.filter((task) => !gone(task));
    for (const { task } of this.workers) if (gone(task)) stop(task);
  }

  close() {
    for (const { worker } of this.workers) worker.terminate();
    URL.revokeObjectURL(this.url);
  }
}

/** A series of `ticks` rows with each row `times` times. */
function held(values, ticks, times) {
  if (times === 1) return values;
  const width = values.length / ticks;
  const out = new Float32Array(values.length * times);
  for (let row = 0; row < ticks * times; row += 1) {
    const tick = Math.floor(row / times);
    out.set(values.subarray(tick * width, (tick + 1) * width), row * width);
  }
  return out;
}

const GRID = 8; // number of ticks per action, from effect to harm, that are computed before the bisection

/** Whether harm occurs although an action is taken, for each action and tick: {action: [..]}. */
async function harmsOf(actions, ticks, harms) {
  const all = actions.flatMap((action) => ticks.map((at) => ({ action, at })));
  const found = [];
  for (let first = 0; first < all.length; first += LANES) found.push(...(await harms(all.slice(first, first + LANES))));
  return Object.fromEntries(actions.map((action, k) => [action, found.slice(k * ticks.length, (k + 1) * ticks.length)]));
}

class Engine {
  constructor(description, pool) {
    this.description = description;
    this.pool = pool;
    this.threads = pool.workers.length;
    const { outcomes, results } = description.programs.outcomes;
    this.names = outcomes;
    this.types = results.types;
  }

  /** The question of the campaign: the value of each parameter by path, observe_ms and motion. */
  question() {
    const { parameters, observe_ms, motion } = this.description;
    return { ...Object.fromEntries(parameters.map(({ path, value }) => [path, value])), observe_ms, motion };
  }

  /**
   * Outcomes of faults, in their order; null or [] stands for a run without any, a list for several in one run.
   * priority: the greater goes first. token: what `cancel` takes; the promise is then rejected with an AbortError.
   * onOutcomes(first, outcomes): called with finished runs.
   */
  async outcomes(question, faults, { priority = 0, token = null, onOutcomes = null } = {}) {
    const parameters = packQuestion(this.description, question);
    const { packed, acts, ends, faulty } = pack(this.description, question, faults);
    const fields = faults.length ? packed.length / faults.length : 0;
    // Runs whose faults begin at about the same time share a batch, which starts at the first of these times.
    const order = faults.map((_, run) => run).sort((a, b) => acts[a] - acts[b] || a - b);
    const judged = Array.from({ length: faults.length });
    const lanes = Math.max(4, Math.min(LANES, 4 * Math.ceil(faults.length / (4 * this.threads))));
    const batches = [];
    for (let first = 0; first < order.length; first += lanes) {
      const rows = order.slice(first, first + lanes);
      const task = {
        parameters,
        motion: motionOf(this.description, question),
        faults: new Int32Array(rows.length * fields),
        acts: Int32Array.from(rows, (run) => acts[run]),
        ends: Int32Array.from(rows, (run) => ends[run]),
      };
      for (const [k, run] of rows.entries()) task.faults.set(packed.subarray(run * fields, (run + 1) * fields), k * fields);
      batches.push(
        this.pool.submit("outcomes", task, { priority, token }).then(({ words: own, usual }) => {
          // Runs that end at the same time have the same golden run.
          const golden = new Map();
          const size = this.names.length;
          for (const [k, run] of rows.entries()) {
            const end = ends[run];
            if (!golden.has(end)) golden.set(end, this.measures(usual.subarray(k * size, (k + 1) * size)));
            const out = judge(this.description, this.measures(own.subarray(k * size, (k + 1) * size)), golden.get(end), faulty[run]);
            if ((question.observe_ms ?? null) !== null) out.observed_ms = end * this.description.tick_ms;
            judged[run] = out;
          }
          onOutcomes?.(rows, rows.map((run) => judged[run]));
          return null;
        }),
      );
    }
    await Promise.all(batches);
    return judged;
  }

  measures(one) {
    return numbers(this.names, this.types, one);
  }

  /** The outcome of the run without a fault. */
  async golden(question, options = {}) {
    const [outcome] = await this.outcomes(question, [null], options);
    return outcome;
  }

  /**
   * Time series of a run and of its golden run, one number a millisecond: Float32Array [ticks * numbers] by the names of
   * description.programs.replay.outputs (gold/jpos: 7 numbers a tick), with ARM/deviation_mm (true tip from the golden
   * run's), unintended_mm (the most so far, of all arms), check/NAME/margin and check/NAME/count (least margin and trips so far). They go to the end of the operation;
   * `outcome` is that of when the run ends, as `outcomes` has it.
   */
  async replay(question, fault, { priority = 1, token = null } = {}) {
    const parameters = packQuestion(this.description, question);
    const { packed, faulty, ends } = pack(this.description, question, [fault]);
    const both = await this.pool.submit("replay", { parameters, motion: motionOf(this.description, question), faults: packed, end: ends[0] }, { priority, token });
    const outcome = judge(this.description, this.measures(both.faulty.end), this.measures(both.golden.end), faulty[0]);
    const { ticks, tick_ms: tick } = this.description;
    const [golden, own] = [both.golden, both.faulty].map(({ series }) => Object.fromEntries(Object.entries(series).map(([name, values]) => [name, held(values, ticks, tick)])));
    return { period_ms: 1, golden, faulty: own, outcome };
  }

  /**
   * Until when each action prevents the harm of a fault, ms by the action's name; -1: at no tick that was tried.
   * outcome: of the fault, with harm. The search is that of `ravenjax deadline`: eight ticks, then bisection.
   */
  async deadlines(question, fault, { first_active_ms, unintended_first_ms }, options = {}) {
    const { actions, fields, triggers, slots, tick_ms: tick } = this.description;
    const [effect, harm] = [first_active_ms / tick, unintended_first_ms / tick];
    const names = Object.keys(actions);
    const parameters = packQuestion(this.description, question);
    const { packed, acts } = pack(this.description, question, [fault]);
    const { outcomes, results } = this.description.programs.acted;
    const harms = async (/** @type {{action: string, at: number}[]} */ tried) => {
      const size = (slots + 1) * Object.keys(fields).length;
      const task = {
        parameters,
        motion: motionOf(this.description, question),
        faults: new Int32Array(tried.length * size),
        acts: new Int32Array(tried.length).fill(acts[0]),
        ends: new Int32Array(tried.length).fill(this.description.ticks),
      };
      for (const [run, { action, at }] of tried.entries()) {
        const taken = { code: actions[action], trigger: triggers.time, start: at, duration: effect };
        task.faults.set(packed, run * size);
        task.faults.set(words(Object.values(fields), Object.keys(fields).map((name) => taken[name] ?? 0)), run * size + packed.length);
      }
      const { words: own } = await this.pool.submit("acted", task, { priority: 0, token: null, ...options });
      const limit = this.description.harm_limit_mm;
      return tried.map((_, run) => {
        const found = numbers(outcomes, results.types, own.subarray(run * outcomes.length, (run + 1) * outcomes.length));
        return found.unintended_first_ms >= 0 || found.failed_ms >= 0 || (limit !== null && found.unintended_off_mm > limit);
      });
    };
    const grid = Array.from({ length: GRID + 1 }, (_, k) => effect + Math.floor(((harm + 1 - effect) * k) / GRID));
    const open = new Map();
    const tried = await harmsOf(names, grid.slice(0, GRID), harms);
    for (const action of names) {
      const last = tried[action].lastIndexOf(false);
      open.set(action, last < 0 ? [-1, -1] : [grid[last], grid[last + 1]]);
    }
    for (;;) {
      const some = names.filter((action) => open.get(action)[1] - open.get(action)[0] > 1);
      if (!some.length) break;
      const middle = some.map((action) => ({ action, at: Math.floor((open.get(action)[0] + open.get(action)[1]) / 2) }));
      for (const [k, late] of (await harms(middle)).entries()) open.get(middle[k].action)[late ? 1 : 0] = middle[k].at;
    }
    return Object.fromEntries(names.map((action) => [action, open.get(action)[0] < 0 ? -1 : open.get(action)[0] * tick]));
  }

  /** Cancels what was requested with this token. */
  cancel(token) {
    this.pool.cancel(token);
  }

  /** Ends the workers. The engine cannot be used afterwards. */
  close() {
    this.pool.close();
  }
}

/**
 * An engine of `threads` workers; all cores but one, if left out. description: from `program.describe_program`, parsed.
 * @param {object} description
 * @param {{threads?: number}} options
 */
export async function openEngine(description, { threads } = {}) {
  const count = threads ?? Math.max(1, (navigator.hardwareConcurrency ?? 2) - 1);
  const { programs, motions, worker } = description;
  const modules = {};
  for (const name of Object.keys(programs)) modules[name] = await WebAssembly.compile(bytes(programs[name].binary));
  const light = Object.entries(programs).map(([name, program]) => [name, { ...program, binary: "" }]);
  const pool = new Pool(worker, count);
  const known = { ticks: description.ticks, arms: description.arms, checks: description.verdict.checks.map(({ name }) => name), programs: Object.fromEntries(light) };
  await pool.all("open", { description: known, modules, motions: Object.fromEntries(Object.entries(motions).map(([name, text]) => [name, bytes(text)])), vectors: Math.ceil(LANES / known.programs.outcomes.width) });
  return new Engine(description, pool);
}

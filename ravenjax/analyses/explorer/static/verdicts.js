// The class of a run's outcome, and how a page shows a class: colour, mark for black and white, sentence.

/** Classes in the order of a legend, the gravest first. A report uses the same names. */
export const CLASSES = {
  unseen: { mark: "cross", says: "evades the checks, without a cue" },
  felt: { mark: "dot", says: "evades the checks, with a cue" },
  lost: { mark: "dash", says: "the instrument does not follow, no alarm" },
  misreported: { mark: "ring", says: "only the reported position is wrong" },
  flagged: { mark: "triangle", says: "a check raises an alarm" },
  stopped: { mark: "square", says: "a check stops the robot" },
  phantom: { mark: "ring", says: "harmless, but with a cue" },
  limited: { mark: "speck", says: "harmless, a check limits the command" },
  quiet: { mark: "", says: "harmless" },
  failed: { mark: "dash", says: "no valid result" },
};

/** Classes whose colour is light, so that their mark is dark. */
export const LIGHT = new Set(["quiet", "limited", "phantom", "flagged", "misreported"]);

/** The class of an outcome, as ravenjax/report/data/facts.py defines it. */
export function classOf(outcome) {
  if (outcome.failed) return "failed";
  if (outcome.response === "stopped" || outcome.response === "flagged") return outcome.response;
  if (outcome.hazard === "unintended motion") return outcome.cue ? "felt" : "unseen";
  if (outcome.hazard === "loss of motion") return "lost";
  if (outcome.hazard === "false report") return "misreported";
  if (outcome.cue) return "phantom";
  return outcome.response === "limited" ? "limited" : "quiet";
}

/** When the cue begins in the run without the fault, ms; -1: never. */
const cueWithout = (outcome) => outcome[`golden_cue${outcome.cue_set ?? 0}_first_ms`] ?? -1;

/**
 * Counts outcomes: all; evading the checks; ahead (with the cue before the harm); by class. without: when the cue begins
 * without the fault, ms.
 */
export function count(outcomes) {
  const classes = {};
  let evading = 0;
  let ahead = 0;
  let all = 0;
  let without = -1;
  for (const outcome of outcomes) {
    const name = classOf(outcome);
    classes[name] = (classes[name] ?? 0) + 1;
    evading += Number(outcome.evades);
    ahead += Number(name === "felt" && outcome[`cue${outcome.cue_set ?? 0}_first_ms`] < outcome.unintended_first_ms);
    without = Math.max(without, cueWithout(outcome));
    all += 1;
  }
  return { all, evading, ahead, without, classes };
}

const number = new Intl.NumberFormat("en", { maximumSignificantDigits: 4 });
export const text = (value) => (Number.isFinite(value) ? number.format(value).replace("-", "−") : "–");
/** A count with its noun. */
export const whole = (things) => things.toLocaleString("en");
/** A length as a person reads it. Beside a limit it has the digits that tell the two apart. */
export function length(mm, limit = Number.NaN) {
  const apart = (shown) => mm === limit || (shown !== limit && shown < limit === mm < limit);
  const plain = mm < 1 ? Number(mm.toPrecision(2)) : Math.round(10 * mm) / 10;
  const shown = [plain, ...[2, 3, 4, 5, 6].map((digits) => Number(mm.toFixed(digits)))].find((candidate) => Number.isNaN(limit) || apart(candidate)) ?? mm;
  return `${new Intl.NumberFormat("en", { maximumSignificantDigits: 8 }).format(shown).replace("-", "−")} mm`;
}
const MILLIS = new Intl.NumberFormat("en", { maximumFractionDigits: 1 });
export const millis = (ms) => `${MILLIS.format(ms)} ms`;

/** The answer of a map: [before, number, after]; limit and the cue's threshold in mm; own: the campaign's own harm in words, or "". */
export function answer({ all, evading, ahead, without = -1, classes }, limit, threshold, own = "") {
  if (!all) return ["Simulating the robot …", "", ""];
  const one = evading === 1;
  const after =
    ` ${one ? "evades" : "evade"} every safety check and ${own ? `${one ? "has" : "have"} ${own}` : `${one ? "moves" : "move"} the instrument more than ${text(limit)} mm`}` +
    (evading ? `; ${warned(classes.felt ?? 0, own || threshold < limit ? ahead : null, own ? "harm" : `${text(limit)} mm`, without)}.` : ".");
  return [`Of ${whole(all)} faults like this, `, evading ? whole(evading) : "none", after];
}

/**
 * The part of the answer about the cue. felt: runs with a cue; ahead: runs with a cue before the harm, null if the cue's
 * threshold is at the limit or beyond; harm: in words; without: when the cue begins without the fault, ms.
 */
function warned(felt, ahead, harm, without) {
  if (!felt) return without < 0 ? "the surgeon feels no cue" : `the cue comes without a fault, too, at ${millis(without)}, so it warns of none`;
  if (ahead === null) return `the surgeon feels a cue in ${whole(felt)}`;
  const early = ahead === 0 ? "never" : ahead === felt ? "always" : `in ${whole(ahead)}`;
  return `the surgeon feels a cue in ${whole(felt)}, ${early} before the ${harm}`;
}

/** Sentences about the outcome of one run. own: the campaign's own harm in words, or "". */
export function told(outcome, limit, own = "") {
  const sentences = [];
  const name = classOf(outcome);
  const harm = outcome.unintended_first_ms;
  const onset = outcome.first_active_ms;
  if (name === "failed") return [`This run gave no valid result: ${outcome.failed}.`];
  if (name === "stopped") sentences.push(`A check stops the robot ${after(outcome.told_ms, onset)}.`);
  else if (name === "flagged") sentences.push(`A check raises an alarm ${after(outcome.told_ms, onset)}; the robot continues.`);
  else if (outcome.evades) sentences.push("This fault evades every safety check.");
  else if (outcome.response === "limited") sentences.push("A check limits a command or drops a packet, without an alarm.");
  else sentences.push("No check reacts to this fault.");
  if (harm >= 0 && own) sentences.push(`${after(harm, onset).replace(/^at/, "At")}, there is ${own}.`);
  else if (harm >= 0) sentences.push(`${after(harm, onset).replace(/^at/, "At")}, the unintended motion exceeds ${text(limit)} mm; it reaches ${length(outcome.unintended_mm, limit)}${name === "stopped" ? " until the robot stops" : ""}.`);
  else if (outcome.hazard === "loss of motion") sentences.push("The instrument does not follow the surgeon.");
  else if (outcome.hazard === "false report") sentences.push("The robot reports a wrong position of the tip; the instrument itself follows the surgeon.");
  else sentences.push(`The unintended motion is ${length(Math.max(0, outcome.unintended_mm), limit)} at most while the robot works.`);
  if (outcome.cue) {
    const came = outcome[`cue${outcome.cue_set ?? 0}_first_ms`];
    const late = came > harm ? `, ${millis(came - harm)} too late` : ", in the same millisecond as the harm";
    const beside = came < harm ? `, ${millis(harm - came)} before the harm` : late;
    sentences.push(`The haptic cue comes ${after(came, onset)}${harm >= 0 ? beside : ""}.`);
  } else if (cueWithout(outcome) >= 0) sentences.push(`The haptic cue comes without the fault, too, at ${millis(cueWithout(outcome))}, so it does not warn of the fault.`);
  else sentences.push("The haptic cue does not come.");
  return sentences;
}

const after = (ms, onset) => (onset >= 0 && ms >= onset ? `${millis(ms - onset)} after the fault begins` : `at ${millis(ms)}`);

// Finds the smallest harmful value of a fault, starting from no change: by doubling, then by bisection.

const FIRST = 64; // the first value is this fraction of the span
const FINE = 40; // the largest number of bisections, which end at neighbouring whole numbers or numbers of four digits

/**
 * Returns {value, outcome, runs, safe}, or null if no value in the span is harmful. ask(values): returns the outcomes of
 * values, in order; from: the value without effect; to: the last value to try; harmful(outcome): whether it is harmful.
 */
export async function smallest(ask, from, to, whole, harmful) {
  const span = to - from;
  const steps = [];
  for (let part = FIRST; part >= 1; part /= 2) steps.push(from + span / part);
  const rounded = (value) => (whole ? Math.round(value) : Number(value.toPrecision(4)));
  const tried = [...new Set(steps.map(rounded))];
  const outcomes = await ask(tried);
  let runs = tried.length;
  const first = outcomes.findIndex(harmful);
  if (first < 0) return null;
  let [safe, bad, found] = [first ? tried[first - 1] : from, tried[first], outcomes[first]];
  for (let k = 0; k < FINE; k += 1) {
    const middle = rounded((safe + bad) / 2);
    if (middle === safe || middle === bad) break;
    const [outcome] = await ask([middle]);
    runs += 1;
    if (harmful(outcome)) [bad, found] = [middle, outcome];
    else safe = middle;
  }
  return { value: bad, outcome: found, runs, safe };
}

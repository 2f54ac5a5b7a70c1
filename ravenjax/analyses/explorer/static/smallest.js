// Finds the smallest harmful value of a fault, starting from no change: by doubling, then by bisection.

const FIRST = 64; // of a span: the least step that is tried first
const FINE = 40; // halvings at most: they end at neighbours, of whole numbers or of numbers of four digits

/**
 * {value, outcome, runs, safe} or null where none in the span is harmful. ask(values): outcomes of those values, in order;
 * from: the value that changes nothing; to: the farthest that is tried; harmful(outcome).
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

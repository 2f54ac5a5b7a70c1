// Writes the state of the page as an address, as a campaign file, and as shell commands.

const FIELDS = { site: "at", arm: "arm", channel: "on", effect: "does", value: "size", start_ms: "from", duration_ms: "for" };

/** The address of a state: {fault, across, up, motion, changes, ms, open}; motion: null, the campaign's own. */
export function written(state) {
  const out = new URLSearchParams();
  for (const [name, short] of Object.entries(FIELDS)) if (state.fault[name] !== undefined) out.set(short, state.fault[name]);
  out.set("map", `${state.across}~${state.up}`);
  if (state.motion) out.set("motion", state.motion);
  for (const [path, value] of Object.entries(state.changes)) out.set(`set.${path}`, value);
  if (state.open) out.set("ms", String(Math.round(state.ms)));
  return `#${out}`;
}

/** The state in an address; null for each part that the address lacks. */
export function read(hash) {
  const from = new URLSearchParams(hash.replace(/^#/, ""));
  if (!from.has("at")) return null;
  const fault = {};
  for (const [name, short] of Object.entries(FIELDS)) if (from.has(short)) fault[name] = from.get(short);
  for (const name of ["value", "start_ms"]) if (name in fault) fault[name] = Number(fault[name]);
  if (fault.duration_ms !== undefined && fault.duration_ms !== "end") fault.duration_ms = Number(fault.duration_ms);
  const [across, up] = (from.get("map") ?? "value~duration_ms").split("~");
  const changes = {};
  for (const [key, value] of from) if (key.startsWith("set.")) changes[key.slice(4)] = Number(value);
  return { fault, across, up, motion: from.get("motion"), changes, open: from.has("ms"), ms: Number(from.get("ms") ?? 0) };
}

const word = (value) => (typeof value === "number" ? String(value) : JSON.stringify(value));
const listed = (value) => (Array.isArray(value) ? `[${value.map(word).join(", ")}]` : word(value));

/** Names and factors of a cue's numbers in a campaign file, by those of parameters. */
const CUES = { threshold_m: ["threshold_mm", 1e3], kp: ["kp_per_mm", 1e-3], kd: ["kd_per_mm_s", 1e-3], cap: ["cap", 1] };

/** The lists of [haptics] with the changes of the page, and the changes of other parameters. */
function parted(campaign, changes) {
  const cues = structuredClone(campaign.cues);
  const others = {};
  for (const [path, value] of Object.entries(changes)) {
    const [, place, what] = /^haptics\.cues\.(\d+)\.(\w+)$/.exec(path) ?? [];
    if (place === undefined) others[path] = value;
    else {
      const [name, factor] = CUES[what];
      cues[name][place] = Number((value * factor).toPrecision(9));
    }
  }
  return { cues, others };
}

/** The beginning of a campaign file, with the chosen motion. */
const led = (campaign, motion) => (motion ? campaign.toml.replace(/^(\[operator\]\nmotion = ).*$/m, `$1${word(motion)}`) : campaign.toml);

/**
 * A campaign file with this fault. A list gives one run for each of its values. takes: whether the effect has a value;
 * question: all parameters; the file contains those that the campaign varies.
 */
export function toml(campaign, { fault, motion, changes }, takes, question) {
  const { cues, others } = parted(campaign, changes);
  const lines = [led(campaign, motion).trim(), "", "[haptics]", 'combine = "zip"'];
  for (const [name, values] of Object.entries(cues)) lines.push(`${name} = ${listed(values)}`);
  lines.push("", "[[group]]", 'name = "explored"');
  const held = { ...Object.fromEntries(campaign.varied.map((path) => [path, question[path]])), ...others };
  if (Object.keys(held).length) {
    lines.push("[group.parameters]");
    for (const [path, value] of Object.entries(held)) lines.push(`${path} = ${word(value)}`);
  }
  lines.push("[[group.fault]]");
  for (const name of Object.keys(FIELDS)) {
    const value = fault[name];
    if (value === undefined || value === "" || value === null || (name === "value" && !takes)) continue;
    lines.push(`${name} = ${listed(value)}`);
  }
  return `${lines.join("\n")}\n`;
}

/** Shell commands that compute the same run on this machine. */
export const command = (file) =>
  `cat > explored.toml <<'TOML'\n${file}TOML\nravenjax run explored.toml --out explored\nravenjax trace explored 0\n`;

// Loads the package's scripts into node: modules with their imports, and scripts that a page holds in itself.

import { readFileSync } from "node:fs";
import path from "node:path";
import vm from "node:vm";

const ROOT = path.resolve(import.meta.dirname ?? path.dirname(new URL(import.meta.url).pathname), "..");
const urls = new Map();

const source = (place) => readFileSync(path.join(ROOT, place), "utf-8");

/** A module as a URL of its own text: node takes a .js file for CommonJS where no package.json says otherwise. */
function url(place) {
  if (!urls.has(place)) {
    const text = source(place).replaceAll(/from "(\.\/[^"]+)"/g, (_, name) => `from "${url(path.join(path.dirname(place), name))}"`);
    urls.set(place, `data:text/javascript;base64,${Buffer.from(text).toString("base64")}`);
  }
  return urls.get(place);
}

/** The exports of a module of the package, by its path from the repository's root. */
export const load = (place) => import(url(place));

/** The names of a script that is no module, run with these globals; `names` may be functions, constants or classes. */
export function run(place, globals, names = []) {
  const context = vm.createContext({ console, URL, URLSearchParams, ...globals });
  vm.runInContext(source(place), context);
  return Object.fromEntries(names.map((name) => [name, vm.runInContext(name, context)]));
}

/** An element that does nothing but remember what was set. */
export function element(more = {}) {
  const attributes = {};
  const listeners = {};
  return {
    attributes,
    listeners,
    dataset: {},
    children: [],
    childNodes: [],
    style: {},
    setAttribute: (name, value) => (attributes[name] = value),
    getAttribute: (name) => attributes[name] ?? null,
    removeAttribute: (name) => delete attributes[name],
    addEventListener: (kind, heard) => (listeners[kind] = heard),
    append: () => {},
    querySelector: () => null,
    querySelectorAll: () => [],
    ...more,
  };
}

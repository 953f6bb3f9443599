// Checks of the catalogues: pairs `key: ["English", "中文"]` in src/i18n/*.ts. That a key exists
// and has both languages is the compiler's business; this looks for what it can't see.
import { readdirSync, readFileSync } from "node:fs";
import { join } from "node:path";

/** Path and text of every source below a folder. */
export function sources(folder) {
  return readdirSync(folder, { recursive: true, withFileTypes: true })
    .filter((entry) => entry.isFile() && /\.(ts|svelte)$/.test(entry.name))
    .map((entry) => join(entry.parentPath, entry.name))
    .map((path) => ({ path, text: readFileSync(path, "utf8") }));
}

const PAIR = /^ {2}(\w+): \[\s*"((?:[^"\\]|\\.)*)",\s*"((?:[^"\\]|\\.)*)",?\s*\],?/gm;

/** The pairs of a catalogue. */
export const pairs = (text) => [...text.matchAll(PAIR)].map(([, key, en, zh]) => ({ key, en, zh }));

/** What is wrong with the texts, a line each. */
export function faults(catalogues, users) {
  const found = [];
  const seen = new Map();
  // A key counts as used where it stands in quotes, or where its beginning does: `end_${x}`.
  const code = users.map((user) => user.text.replace(PAIR, "")).join("\n");
  const beginnings = [...code.matchAll(/`([a-z_]+_)\$\{/g)].map((match) => match[1]);
  for (const { path, text } of catalogues) {
    for (const { key, en, zh } of pairs(text)) {
      if (seen.has(key)) found.push(`${path}: ${key} stands in ${seen.get(key)}, too`);
      seen.set(key, path);
      if (gaps(en) !== gaps(zh)) found.push(`${path}: ${key} has other placeholders in Chinese`);
      const used = code.includes(`"${key}"`) || beginnings.some((head) => key.startsWith(head));
      if (!used) found.push(`${path}: ${key} is used nowhere`);
    }
  }
  return found;
}

function gaps(text) {
  return [...text.matchAll(/\{(\w+)\}/g)].map((match) => match[1]).sort().join();
}

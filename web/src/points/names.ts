// Display names of lines, modules and points, and their ids in the configuration.
import { named } from "../i18n/index.svelte";
import { lines, modules, points } from "../api/live.svelte";
import { modelOf } from "../api/models.svelte";

export const lineName = (line: string): string => named(lines.get(line)?.name) ?? line;
export const moduleName = (module: string): string => named(modules.get(module)?.name) ?? module;

/** `Pump house · Pump 1`; empty if neither has a name. */
function calledOf(path: string): string {
  const module = path.split(".")[0] ?? "";
  const [of, name] = [named(modules.get(module)?.name), named(points.get(path)?.name)];
  return of || name ? [of, name ?? path.slice(module.length + 1)].filter(Boolean).join(" · ") : "";
}

/** The name with the path: `Pump house · Pump 1 (pump.do0)`. */
export function pointText(path: string): string {
  const name = calledOf(path);
  return name ? `${name} (${path})` : path;
}

/** The model's title; for a board without a name of its own, what it is. */
export const modelTitle = ({ model, title }: { model: string | null; title: string }): string => modelOf(model)?.title ?? title;

/** The same for a module and for a line. */
export const moduleText = (module: string): string => both(moduleName(module), module);
export const lineText = (line: string): string => both(lineName(line), line);

const both = (name: string, id: string): string => (name === id ? id : `${name} (${id})`);

/** Names as they are written to the configuration: empty ones are left out. */
export function namesOf(en: string, zh: string): { en?: string; zh?: string } | null {
  const names = { ...(en.trim() && { en: en.trim() }), ...(zh.trim() && { zh: zh.trim() }) };
  return Object.keys(names).length ? names : null;
}

const ID_MOST = 32;

/** An id for a name: `Pump 1` is `pump_1`. Empty for what is not written in Latin letters. */
export function idOf(name: string, taken: (id: string) => boolean = () => false): string {
  const plain = name.normalize("NFKD").replace(/[\u0300-\u036f]/g, "");
  if (/[^\x20-\x7e]/.test(plain)) return "";
  const id = plain.toLowerCase().replace(/[^a-z0-9]+/g, "_").replace(/^[^a-z]+|_+$/g, "").slice(0, ID_MOST);
  if (!id || !taken(id)) return id;
  for (let n = 2; n < 100; n++) if (!taken(`${id}_${n}`)) return `${id}_${n}`.slice(0, ID_MOST);
  return "";
}

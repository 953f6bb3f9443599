// Texts in the language of who looks. Catalogues are pairs, both languages side by side, one
// file an area; a key that does not exist is a type error.
import { admin } from "./admin";
import { api } from "./api";
import { backup } from "./backup";
import { events } from "./events";
import { frame } from "./frame";
import { groups } from "./groups";
import { lines } from "./lines";
import { points } from "./points";
import { settings } from "./settings";
import { sim } from "./sim";
import { rules } from "./rules";
import { start } from "./start";
import { system } from "./system";
import { trends } from "./trends";
import { webhooks } from "./webhooks";

/** One text: English, Chinese. */
export type Pair = readonly [string, string];

const all = {
  ...frame,
  ...points,
  ...lines,
  ...settings,
  ...start,
  ...trends,
  ...events,
  ...groups,
  ...rules,
  ...backup,
  ...admin,
  ...system,
  ...api,
  ...webhooks,
  ...sim,
};

export type Key = keyof typeof all;
export type Lang = "en" | "zh";
export type Gaps = Record<string, string | number>;

const KEPT = "railbus.lang";

function first(): Lang {
  const kept = localStorage.getItem(KEPT);
  if (kept === "en" || kept === "zh") return kept;
  const known = navigator.languages.map((name) => name.slice(0, 2).toLowerCase());
  return known.find((name) => name === "zh" || name === "en") === "zh" ? "zh" : "en";
}

let lang = $state<Lang>(first());

/** The language now. */
export function language(): Lang {
  return lang;
}

/** Speaks another language, here and the next time. */
export function speak(next: Lang): void {
  lang = next;
  localStorage.setItem(KEPT, next);
  mark();
}

/** Tells the browser, which picks fonts and line breaks by it. */
export function mark(): void {
  document.documentElement.lang = lang === "zh" ? "zh-CN" : "en";
}

/** A text, its gaps filled. */
export function t(key: Key, gaps?: Gaps): string {
  const text = all[key][lang === "zh" ? 1 : 0];
  return gaps ? text.replace(/\{(\w+)\}/g, (whole, name: string) => String(gaps[name] ?? whole)) : text;
}

/** Of names by language, the one to show. */
export function named(names: Partial<Record<string, string>> | undefined): string | undefined {
  return names?.[lang] ?? names?.["en"] ?? names?.["zh"];
}

// Texts in the language of who looks. Catalogues are pairs, both languages side by side, one
// file an area; a key that does not exist is a type error. Those of `later.ts` come with the pages
// that need them: what is shown before, must not.
import { frame } from "./frame";
import type { later } from "./later";
import { lines } from "./lines";
import { points } from "./points";
import { start } from "./start";

/** One text: English, Chinese. */
export type Pair = readonly [string, string];

const first = { ...frame, ...points, ...lines, ...start };

export type Key = keyof typeof first | keyof typeof later;

/** Those that are there; the pages that are loaded later bring their own. */
const all: Partial<Record<Key, Pair>> = first;

/** Adds texts. */
export function addTexts(texts: Partial<Record<Key, Pair>>): void {
  Object.assign(all, texts);
}

export type Lang = "en" | "zh";
export type Gaps = Record<string, string | number>;

const KEPT = "railbus.lang";

function firstLanguage(): Lang {
  const kept = localStorage.getItem(KEPT);
  if (kept === "en" || kept === "zh") return kept;
  const known = navigator.languages.map((name) => name.slice(0, 2).toLowerCase());
  return known.find((name) => name === "zh" || name === "en") === "zh" ? "zh" : "en";
}

let lang = $state<Lang>(firstLanguage());

/** The language now. */
export function language(): Lang {
  return lang;
}

/** Speaks another language, here and the next time. */
export function setLanguage(next: Lang): void {
  lang = next;
  localStorage.setItem(KEPT, next);
  markDocumentLanguage();
}

/** Tells the browser, which picks fonts and line breaks by it. */
export function markDocumentLanguage(): void {
  document.documentElement.lang = lang === "zh" ? "zh-CN" : "en";
}

/** A text, its gaps filled. */
export function t(key: Key, gaps?: Gaps): string {
  const text = all[key]?.[lang === "zh" ? 1 : 0] ?? key;
  return gaps ? text.replace(/\{(\w+)\}/g, (whole, name: string) => String(gaps[name] ?? whole)) : text;
}

/** The text under a key that is made of what the daemon says; what it says itself where there is none. */
export function textOr(key: string, otherwise: string): string {
  return key in all ? t(key as Key) : otherwise;
}

/** Things one after the other, and what belongs to a word: as the language sets them apart. */
export const joinList = (all: readonly string[]): string => all.join(lang === "zh" ? "、" : ", ");
export const withDetail = (what: string, more: string): string => `${what}${lang === "zh" ? "：" : ": "}${more}`;

/** Of names by language, the one to show. */
export function named(names: Partial<Record<string, string>> | undefined): string | undefined {
  return names?.[lang] ?? names?.["en"] ?? names?.["zh"];
}

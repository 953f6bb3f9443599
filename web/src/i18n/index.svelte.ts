// Texts in the language of the page. Catalogues are pairs of both languages, one file for each
// domain; a missing key is a type error. Those of `later.ts` are loaded with the pages that need
// them, those of `fleet.ts` with the pages of a centre, those of `setup.ts` with the first setup,
// those of `config-text.ts` with the text of a configuration: nothing shown earlier may use them.
import type { configText } from "./config-text";
import type { fleet } from "./fleet";
import { frame } from "./frame";
import type { later } from "./later";
import { lines } from "./lines";
import { points } from "./points";
import type { setup } from "./setup";
import { start } from "./start";

/** One text: English, Chinese. */
export type Pair = readonly [string, string];

const first = { ...frame, ...points, ...lines, ...start };

export type Key = keyof typeof first | keyof typeof configText | keyof typeof fleet | keyof typeof later | keyof typeof setup;

/** The texts loaded so far; pages loaded later add their own. */
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

/** All languages, the page's own first. */
export const languages = (): Lang[] => (lang === "zh" ? ["zh", "en"] : ["en", "zh"]);

/** Switches to another language, and stores it. */
export function setLanguage(next: Lang): void {
  lang = next;
  localStorage.setItem(KEPT, next);
  markDocumentLanguage();
}

/** Sets the document's language, by which the browser chooses fonts and line breaks. */
export function markDocumentLanguage(): void {
  document.documentElement.lang = lang === "zh" ? "zh-CN" : "en";
}

/** A text with its placeholders filled in. */
export function t(key: Key, gaps?: Gaps): string {
  const text = all[key]?.[lang === "zh" ? 1 : 0] ?? key;
  return gaps ? text.replace(/\{(\w+)\}/g, (whole, name: string) => String(gaps[name] ?? whole)) : text;
}

/** The text under a key made of a word of the daemon; `otherwise` if there is none. */
export function textOr(key: string, otherwise: string): string {
  return key in all ? t(key as Key) : otherwise;
}

/** A list, and a detail after a word, with the punctuation of the language. */
export const joinList = (all: readonly string[]): string => all.join(lang === "zh" ? "、" : ", ");
export const withDetail = (what: string, more: string): string => `${what}${lang === "zh" ? "：" : ": "}${more}`;

/** Names by language. */
export type Names = Partial<Record<string, string>>;

/** The name to show, of those in several languages. */
export function named(names: Names | undefined): string | undefined {
  return names?.[lang] ?? names?.["en"] ?? names?.["zh"];
}

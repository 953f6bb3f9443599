// Rules in words.
import { language, named, t } from "../i18n/index.svelte";
import type { ActionText, Rule, WhenText } from "../api/types";
import { span } from "../lib/format";
import { points } from "../api/live.svelte";
import { lineText, moduleText, pointText } from "../points/names";

export const DAYS = ["mon", "tue", "wed", "thu", "fri", "sat", "sun"];
/** A Monday. */
const MONDAY = 4;

/** `Mon`, in the language of the page. */
export function dayText(day: string): string {
  const date = new Date(2_026, 4, MONDAY + DAYS.indexOf(day));
  return date.toLocaleDateString(language() === "zh" ? "zh-CN" : "en", { weekday: "short" });
}

/** The word for a state of a point. */
export function stateText(path: string, is: boolean | undefined): string {
  const isInput = points.get(path)?.kind === "input";
  return isInput ? t(is ? "high" : "low") : t(is ? "on" : "off");
}

export const nameOf = (rule: Rule): string => named(rule.name) ?? rule.rule;

/** What a rule waits for, as a sentence. */
export function whenText({ when, for_ms }: Rule): string {
  const said = condition(when);
  return for_ms ? t("rule_says_for", { when: said, time: span(for_ms) }) : said;
}

function condition(when: WhenText): string {
  const { point = "", above, below } = when;
  const unit = points.get(point)?.unit ?? "";
  if (above !== undefined) return t("rule_says_above", { point: pointText(point), value: `${above} ${unit}`.trim() });
  if (below !== undefined) return t("rule_says_below", { point: pointText(point), value: `${below} ${unit}`.trim() });
  if (when.time) {
    const days = when.days ? when.days.map(dayText).join(" ") : t("rule_daily");
    return t("rule_says_time", { time: when.time, days });
  }
  if (when.module_offline) return t("rule_says_module", { name: moduleText(when.module_offline) });
  if (when.line_offline) return t("rule_says_line", { name: lineText(when.line_offline) });
  return t("rule_says_is", { point: pointText(point), state: stateText(point, when.is) });
}

/** What a rule does, in a few words. */
export function actionText({ set, to, pulse, width_ms, notify }: ActionText): string {
  if (set) return t("rule_says_set", { point: pointText(set), state: stateText(set, to) });
  if (pulse) return t("rule_says_pulse", { point: pointText(pulse), time: width_ms ? span(width_ms) : "" });
  return t("rule_says_notify", { text: notify ?? "" });
}

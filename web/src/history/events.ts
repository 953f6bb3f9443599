// Events and audit entries in words.
import { joinList, named, t, withDetail, textOr } from "../i18n/index.svelte";
import type { EventKind, SiteEvent } from "../api/types";
import { span } from "../lib/format";
import { points } from "../api/live.svelte";
import { lineText, moduleText, pointText } from "../points/names";

export const KINDS: EventKind[] = ["write", "alarm", "module", "line", "config", "login", "rule", "system"];

/** How a command ended, in words. */
export const endText = (end: string): string => textOr(`end_${end}`, end);

export function endedWell(end: string | null | undefined): boolean {
  return end === "readback" || end === "reply" || end === "sent";
}

/** What an event is about: `Pump 1 (pump.do0)`, `Pump house (pump)`, `main`. */
export function about(event: SiteEvent): string {
  if (event.point) return pointText(event.point);
  return event.module ? moduleText(event.module) : lineText(event.line ?? "");
}

/** More outputs than this are summed up by their number. */
const EACH_MOST = 4;

/** The module of an event, and its point if that is shown already. */
type Subject = Pick<SiteEvent, "module" | "point">;

const onOff = (state: string | undefined): string => t(state === "on" ? "on" : "off");

/** Output states as the daemon writes them, `do3=on do4=off`, in words; anything else unchanged. */
export function statesText(of: Subject, text: string): string {
  const all = text.split(" ").map((one) => /^(\w+)=(on|off)$/.exec(one));
  const states = new Set(all.map((one) => one?.[2]));
  if (all.includes(null)) return text;
  const [state] = states;
  if (all.length > EACH_MOST && states.size === 1) return t("what_all", { n: all.length, state: onOff(state) });
  return joinList(all.map((one) => `${labelText(of, one?.[1] ?? "")} ${onOff(one?.[2])}`.trim()));
}

function labelText({ module, point }: Subject, label: string): string {
  const path = `${module}.${label}`;
  return path === point ? "" : (named(points.get(path)?.name) ?? label);
}

/** How the daemon records commands, and the text for each; groups in the order of the placeholders. */
const ASKED: [RegExp, (of: Subject, ...parts: string[]) => string][] = [
  [/^pulse (\w+) (\d+)ms by (host|device)$/, (of, label = "", ms, by) =>
    t(by === "device" ? "what_pulse_device" : "what_pulse_host", { point: labelText(of, label), time: span(Number(ms)) })],
  [/^(toggle|end of pulse|end of lease) (\w+)$/, (of, what = "", label = "") =>
    t(what === "toggle" ? "what_toggle" : what.endsWith("pulse") ? "what_pulse_end" : "what_lease_end", { point: labelText(of, label) })],
  [/^lease (\w+)=(on|off) (\d+)ms$/, (of, label = "", state, ms) =>
    t("what_lease", { point: labelText(of, label), state: onOff(state), time: span(Number(ms)) })],
  [/^(\w+)=off after (\d+)ms$/, (of, label = "", ms) => t("what_max_on", { point: labelText(of, label), time: span(Number(ms)) })],
  [/^settings (.*)$/, (_, all = "") =>
    withDetail(t("tab_settings"), joinList(all.split(/ (?=\w+=)/)).replace(/(\w+)=/g, (_, name: string) => `${textOr(`set_${name}`, name)} `))],
  [/^calibrate zero, span at (.*)$/, (_, volts = "") => t("what_calibrate", { volts })],
  [/^send (\S*): (.*) \((\S+)\)$/, (_, needs = "", bytes = "") => {
    const may = needs.split("+").map((need) => textOr(`need_${need}`, need));
    return t("what_send", { bytes, may: joinList(may.filter(Boolean)) || t("need_read") });
  }],
];

/** A command, in words. */
export function commandText(of: Subject, what: string): string {
  for (const [form, said] of ASKED) {
    const parts = form.exec(what);
    if (parts) return said(of, ...parts.slice(1));
  }
  return statesText(of, what);
}

/** What a rule does, as the daemon writes it: `pump.do0=off, pulse gate.do0 500ms, notify`. */
function actionsText(what: string): string {
  const one = (action: string): string => {
    const [, pulsed, ms, set, state] = /^pulse (\S+)(?: (\d+)ms)?$|^(\S+)=(on|off)$/.exec(action) ?? [];
    if (pulsed) return t("rule_says_pulse", { point: pointText(pulsed), time: ms ? span(Number(ms)) : "" }).trim();
    return set ? t("rule_says_set", { point: pointText(set), state: onOff(state) }) : textOr(`rule_${action}`, action);
  };
  return joinList(what.split(", ").map(one));
}

/** Who did it; the program's own parts have names of their own. */
export function whoText({ who = "", via = "" }: Pick<SiteEvent, "who" | "via">): string {
  if (who === "an unknown name") return t("who_unknown");
  if (via === "socket" || via === "signal") return textOr(`who_${who}`, who);
  if (via !== "program") return who;
  const [, rule] = /^rule:(.*)/.exec(who) ?? [];
  return rule ? t("rule_edit", { rule }) : textOr(`who_${who}`, textOr(`point_${who}`, who));
}

export const viaText = (via = ""): string => textOr(`via_${via}`, via);

/** The daemon's own text of an event, translated. */
function addedText({ code, text = "", end }: SiteEvent): string {
  if (text === end) return "";
  switch (code) {
    case "end_dropped": {
      const [, address, output] = /^address (\d+), output (\d+)$/.exec(text) ?? [];
      return address && output ? t("dropped_at", { address, output }) : text;
    }
    case "history_works":
      return t("dropped_n", { n: text.replace("dropped ", "") });
    case "line_down":
      return textOr(`port_is_${text}`, textOr(`port_${text}`, text));
    case "user_added":
      return textOr(`role_${text}`, text);
    case "user_changed":
      return joinList(text.split(" ").map((one) => textOr(`user_has_${one}`, one)));
    default:
      return textOr(`code_${code}_${text}`, text);
  }
}

/** What happened, in a few words. */
export function eventText(event: SiteEvent): string {
  const { kind, code = "", what = "" } = event;
  if (kind === "write") return commandText(event, what);
  const said = textOr(`code_${code}`, what || code.replaceAll("_", " "));
  const more = [kind === "rule" ? actionsText(what) : what, addedText(event)].filter((one) => one && one !== said).join(" · ");
  return more ? withDetail(said, more) : said;
}

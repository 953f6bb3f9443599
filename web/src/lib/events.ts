// What happened, as `/events` and `/audit` tell it.
import { named, t, type Key } from "../i18n/index.svelte";
import { span } from "./format";
import { points } from "./live.svelte";
import { lineText, moduleText, pointText } from "./names";

export const KINDS = ["write", "alarm", "module", "line", "config", "login", "rule", "system"] as const;
export type Kind = (typeof KINDS)[number];

export interface SiteEvent {
  id: string;
  at: string;
  kind: Kind;
  severity: "info" | "warning" | "error";
  module?: string;
  /** Its path: `pump.do0`. */
  point?: string;
  line?: string;
  who?: string;
  via?: string;
  what?: string;
  before?: string;
  after?: string;
  end?: string;
  code?: string;
  text?: string;
  acked?: { who: string; at: string; comment: string };
}

/** An entry of the chain in which every write stands. */
export interface Entry {
  id: string;
  at: string;
  who: string;
  via: string;
  module: string;
  what: string;
  before?: string;
  after?: string;
  end?: string | null;
  hash: string;
}

export interface Page<T> {
  items: T[];
  next: string | null;
}

const CODES: Record<string, Key> = {
  module_online: "code_module_online",
  module_offline: "code_module_offline",
  line_up: "code_line_up",
  line_down: "code_line_down",
  line_babble: "code_line_babble",
  line_quiet: "code_line_quiet",
  config_reloaded: "code_config_reloaded",
  audit_fails: "code_audit_fails",
  keys_fail: "code_keys_fail",
  end_dropped: "code_end_dropped",
  audit_works: "code_audit_works",
  started: "code_started",
  stopped: "code_stopped",
  rule_fired: "code_rule_fired",
  rule_failed: "code_rule_failed",
  rule_stopped: "code_rule_stopped",
  logged_in: "code_logged_in",
  login_refused: "code_login_refused",
  logins_many: "code_logins_many",
  logged_out: "code_logged_out",
  password_changed: "code_password_changed",
  session_ended: "code_session_ended",
  user_added: "code_user_added",
  user_changed: "code_user_changed",
  user_removed: "code_user_removed",
  token_created: "code_token_created",
  token_revoked: "code_token_revoked",
  config_changed: "code_config_changed",
  webhook_secret_changed: "code_webhook_secret_changed",
  webhook_secrets_lost: "code_webhook_secrets_lost",
  webhook_fails: "code_webhook_fails",
  webhook_works: "code_webhook_works",
  sim_order: "code_sim_order",
};

const ENDS: Record<string, Key> = {
  readback: "end_readback",
  reply: "end_reply",
  sent: "end_sent",
  refused: "end_refused",
  expired: "end_expired",
  not_verified: "end_not_verified",
  unknown: "end_unknown",
  no_reply: "end_no_reply",
  garbled: "end_garbled",
  unsupported: "end_unsupported",
  overloaded: "end_overloaded",
  closed: "end_closed",
  locked: "end_locked",
  interlock: "end_interlock",
  min_off: "end_min_off",
  confirm: "end_confirm",
  not_as_asked: "end_not_as_asked",
  unwatched: "end_unwatched",
  lent: "end_lent",
  not_tried: "end_not_tried",
  undone: "end_undone",
  not_undone: "end_not_undone",
};

/** How a command ended, in words where there are some. */
export function endText(end: string): string {
  const key = ENDS[end];
  return key ? t(key) : end;
}

export function endedWell(end: string | null | undefined): boolean {
  return end === "readback" || end === "reply" || end === "sent";
}

/** What an event is about: `Pump 1 (pump.do0)`, `Pump house (pump)`, `main`. */
export function about(event: SiteEvent): string {
  if (event.point) return pointText(event.point);
  return event.module ? moduleText(event.module) : lineText(event.line ?? "");
}

/** More outputs than this are told by their number. */
const EACH_MOST = 4;

/** Of which module something is told; and of which of its points, where that is said already. */
type Of = Pick<SiteEvent, "module" | "point">;

/** States of outputs as the daemon writes them, `do3=on do4=off`, in words; what is none, as it is. */
export function statesText(of: Of, text: string): string {
  const all = text.split(" ").map((one) => /^(\w+)=(on|off)$/.exec(one));
  const states = new Set(all.map((one) => one?.[2]));
  if (all.includes(null)) return text;
  const [state] = states;
  if (all.length > EACH_MOST && states.size === 1) return t("what_all", { n: all.length, state: t(state === "on" ? "on" : "off") });
  return all.map((one) => `${labelText(of, one?.[1] ?? "")} ${t(one?.[2] === "on" ? "on" : "off")}`.trim()).join(", ");
}

function labelText({ module, point }: Of, label: string): string {
  const path = `${module}.${label}`;
  return path === point ? "" : (named(points.get(path)?.name) ?? label);
}

/** What was asked of a module, in words: `pulse k1 500ms by host`. */
export function askedText(of: Of, what: string): string {
  const pulse = /^pulse (\w+) (\d+)ms by (host|device)$/.exec(what);
  if (pulse) {
    const gaps = { point: labelText(of, pulse[1] ?? ""), time: span(Number(pulse[2])) };
    return t(pulse[3] === "device" ? "what_pulse_device" : "what_pulse_host", gaps);
  }
  const toggle = /^toggle (\w+)$/.exec(what);
  if (toggle) return t("what_toggle", { point: labelText(of, toggle[1] ?? "") });
  return statesText(of, what);
}

/** Who and from where, where that is a word of the daemon's and no name. */
export function whoText(who: string | undefined): string {
  return who === "an unknown name" ? t("who_unknown") : (who ?? "");
}

export function viaText(via: string | undefined): string {
  return via === "socket" ? t("via_socket") : (via ?? "");
}

/** What happened, in a few words. */
export function eventText(event: SiteEvent): string {
  if (event.kind === "write") return askedText(event, event.what ?? "");
  const key = event.code ? CODES[event.code] : undefined;
  const said = key ? t(key) : (event.what ?? event.code?.replaceAll("_", " ") ?? "");
  const more = [key && event.what, event.text].filter((one) => one && one !== said).join(" ");
  return more ? `${said}${said ? ": " : ""}${more}` : said;
}

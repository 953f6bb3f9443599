// Sites, their points and commands to them in words.
import { joinList, t, textOr, withDetail } from "../i18n/index.svelte";
import { span } from "../lib/format";
import type { FleetCommand, FleetPoint, FleetSite } from "../api/types";

/** How long ago something was that was `ms` ago when it was told. */
export const agoText = (ms: number, since: number): string =>
  t("fleet_ago", { time: span(Math.max(0, Math.round((ms + since) / 1_000)) * 1_000) });

// `now`: the centre hears its servers, and said it just now. Nothing else is told as a fact of now.

/** How a site is: the kind of its tag, and its word. */
export function presence(site: FleetSite, now: boolean): { kind: "good" | "bad" | "past"; text: string } {
  if (!now || site.presence === "unknown") return { kind: "past", text: t("fleet_is_unknown") };
  if (site.presence === "online") return { kind: "good", text: t("fleet_is_online") };
  return { kind: "bad", text: t("fleet_is_offline") };
}

/** Whether its values are as they are shown. */
export function valuesText(site: FleetSite, now: boolean): string {
  if (!now) return t("fleet_is_unknown");
  if (site.current) return t("fleet_current");
  if (site.points === 0) return t("fleet_empty");
  return t("fleet_old");
}

/** Why it needs attention. */
export const reasons = (site: FleetSite, now: boolean): string =>
  now ? joinList((site.attention ?? []).map((why) => textOr(`fleet_why_${why}`, why))) : "";

export function clockText(ahead: number): string {
  const time = span(Math.abs(ahead));
  if (Math.abs(ahead) < 1_000) return t("fleet_clock_right");
  return ahead > 0 ? t("fleet_clock_ahead", { time }) : t("fleet_clock_behind", { time });
}

export function pointValue({ value, quality }: FleetPoint, now: boolean): string {
  if (value === undefined || value === null) return "?";
  const text = typeof value === "boolean" ? t(value ? "on" : "off") : String(value);
  return quality === "good" && now ? text : t("was", { value: text });
}

/** The quality of a point and why, in words. */
export function qualityText({ quality, reason }: FleetPoint, now: boolean): string {
  if (!now) return t("unknown");
  if (quality === "good") return t("fleet_good");
  const word = quality === "stale" ? t("quality_stale") : t("fleet_bad");
  if (!reason) return word;
  return withDetail(word, textOr(`fleet_r_${reason}`, textOr(`reason_${reason}`, reason)));
}

const onOff = (value: unknown): string => (typeof value === "boolean" ? t(value ? "on" : "off") : String(value ?? ""));

type Given = Record<string, unknown>;

/** The body of a request, as far as it is an object: anything may have been sent. */
function given(body: string): Given {
  try {
    const parsed: unknown = JSON.parse(body);
    return parsed && typeof parsed === "object" ? (parsed as Given) : {};
  } catch {
    // Of a long body the record has only the beginning.
    return {};
  }
}

/** A command, as a technician would say it; as the request if it is none of those known here. */
export function commandText({ method, path, body }: FleetCommand): string {
  const request = path.replace(/^\/api\/v1\//, "");
  const way = request.split("/");
  const [what, name = "", label = "", verb = ""] = way;
  const { value, set } = given(body);
  if (what === "points" && way.length === 3) return `${name}.${label} ${onOff(value)}`;
  if (what === "points" && way.length === 4) return `${name}.${label} ${textOr(`fleet_verb_${verb}`, verb)}`;
  if (what === "groups" && label === "set") return `@${name} ${onOff(value)}`;
  if (what === "scenes" && label === "run") return t("fleet_scene", { name });
  const all = set && typeof set === "object" ? Object.entries(set) : [];
  const each = all.map(([point, on]) => (what === "modules" ? `${name}.${point} ${onOff(on)}` : oneOf(on)));
  if (each.length && (what === "modules" || what === "batch") && !each.includes("")) return joinList(each);
  return `${method} ${request} ${body}`;
}

/** An entry of a batch; empty if it is none. */
function oneOf(entry: unknown): string {
  const { path, value } = (entry ?? {}) as Given;
  return typeof path === "string" ? `${path} ${onOff(value)}` : "";
}

/** Its result: whether it is a good one, in words. */
export function resultText(command: FleetCommand): { good: boolean; text: string } {
  const why = [command.code, command.title].filter(Boolean).join(" ");
  switch (command.how) {
    case undefined:
      return { good: true, text: t("fleet_end_none") };
    case "answered":
      if (command.code) return { good: false, text: why };
      return { good: true, text: t(command.confirmed === "sent" ? "fleet_end_sent" : "fleet_end_done") };
    case "never":
      return { good: false, text: why ? withDetail(t("fleet_end_never"), why) : t("fleet_end_never") };
    default:
      return { good: false, text: t("fleet_end_unknown") };
  }
}

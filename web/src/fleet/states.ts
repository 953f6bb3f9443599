// Sites, their points and commands to them in words.
import { joinList, t, textOr, withDetail } from "../i18n/index.svelte";
import { span } from "../lib/format";
import type { FleetBulk, FleetBulkState, FleetCommand, FleetCommandEnd, FleetConfigState, FleetPoint, FleetSite } from "../api/types";

/** How long ago something was that was `ms` ago when it was told. */
export const agoText = (ms: number, since: number): string =>
  t("fleet_ago", { time: span(Math.max(0, Math.round((ms + since) / 1_000)) * 1_000) });

// `now`: the centre hears its servers, and said it just now. Nothing else is told as a fact of now.

/** How a site is: the kind of its tag, and its word. */
export function presence(site: Pick<FleetSite, "presence">, now: boolean): { kind: "good" | "bad" | "past"; text: string } {
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

/** How far the configuration of a site is. */
export function configText(config: Pick<FleetConfigState, "phase" | "version">): string {
  const word = textOr(`fleet_cfg_${config.phase}`, config.phase);
  return config.version === undefined ? word : withDetail(t("fleet_cfg_version", { n: config.version }), word);
}

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

function onOff(value: unknown): string {
  if (typeof value === "boolean") return t(value ? "on" : "off");
  const word = String(value ?? "");
  return textOr(`fleet_verb_${word}`, word);
}

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

/** A part of a path. */
function decoded(part: string): string {
  try {
    return decodeURIComponent(part);
  } catch {
    return part;
  }
}

/** A command, as a technician would say it; as the request if it is none of those known here. */
export function commandText({ method, path, body }: Pick<FleetCommand, "method" | "path" | "body">): string {
  const request = path.replace(/^\/api\/v1\//, "");
  const way = request.split("/").map(decoded);
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

/** What a command to a site can have come to, in the order in which it is told. */
export const ENDS = ["done", "unconfirmed", "sent", "waiting", "failed", "never", "unknown"] as const satisfies FleetBulkState[];
/** Those with which somebody has to do something. */
const BAD: FleetBulkState[] = ["failed", "never", "unknown"];

function endOf({ how, code, confirmed }: FleetCommandEnd): FleetBulkState {
  if (how === undefined) return "sent";
  if (how === "answered" && code) return "failed";
  if (how === "answered") return confirmed === "sent" ? "unconfirmed" : "done";
  return how === "never" ? how : "unknown";
}

/** Its result: whether it is a good one, in words. */
export function resultText(end: FleetCommandEnd, state = endOf(end)): { good: boolean; text: string } {
  const word = t(`fleet_end_${state}`);
  const why = [end.code, end.title].filter(Boolean).join(" ");
  const good = !BAD.includes(state);
  if (good || state === "unknown" || !why) return { good, text: word };
  return { good, text: state === "never" ? withDetail(word, why) : why };
}

/** How many sites of a command are how. */
export const countText = (counts: FleetBulk["counts"], state: FleetBulkState): string =>
  withDetail(t(`fleet_end_${state}`), String(counts[state]));

/** The results of a command to many sites. */
export const resultsText = ({ counts }: FleetBulk): { good: boolean; text: string } => ({
  good: !BAD.some((state) => counts[state]),
  text: joinList(ENDS.filter((state) => counts[state]).map((state) => countText(counts, state))),
});

export const sitesText = (n: number): string => (n === 1 ? t("fleet_site_one") : t("fleet_site_many", { n }));

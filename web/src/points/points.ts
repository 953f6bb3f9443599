// What can be said about a point or a module now. A stale value is never shown as a fresh one:
// every page asks here.
import { t } from "../i18n/index.svelte";
import { clock } from "../lib/clock.svelte";
import { secondTime, span } from "../lib/format";
import { lostAt } from "../api/link.svelte";
import { lines, pointsOf } from "../api/live.svelte";
import { showsHidden } from "../app/prefs.svelte";
import type { ModuleInfo, PointInfo } from "../api/types";

/** The value is good, and the page is still connected. */
export function isFresh(point: PointInfo): boolean {
  return point.quality === "good" && lostAt() === null;
}

/** A value as text, without its unit. */
function valueText(point: PointInfo): string {
  const { value, kind } = point;
  if (value === null || value === undefined) return "–";
  if (typeof value === "number") return value.toFixed(point.decimals ?? 0);
  if (kind === "output") return value ? t("on") : t("off");
  return value ? t("high") : t("low");
}

/** The value as text: as it is, as it was, or unknown. */
export function shownText(point: PointInfo): string {
  if (point.value === null || point.value === undefined) return "?";
  const value = valueText(point);
  return isFresh(point) || typeof point.value === "number" ? value : t("was", { value });
}

/** Why a value is not fresh, and when it was read; empty for a fresh one. */
export function staleReason(point: PointInfo): string {
  if (isFresh(point)) return "";
  const reason = reasonText(point);
  // Unchanged values are not sent again: after a lost connection the time of the last read is not known.
  if (point.read_at === undefined || lostAt() !== null) return reason;
  return `${reason} · ${t("read_at", { at: secondTime(point.read_at) })}`;
}

function reasonText(point: PointInfo): string {
  const lost = lostAt();
  if (lost !== null) return t("reason_lost", { at: secondTime(lost) });
  if (point.quality === "stale") return t("quality_stale");
  switch (point.reason) {
    case "offline":
      return t("reason_offline");
    case "other_model":
      return t("reason_other");
    case "line_absent":
      return t("reason_line_absent");
    case "line_busy":
      return t("port_busy");
    case "line_closed":
      return t("reason_line_closed");
    case "lent":
      return t("reason_lent");
    case "never_read":
      return t("reason_never_read");
    default:
      return t("unknown");
  }
}

/** The status of a module, from best to worst. A lost connection hides the line's state, and that the module's. */
export type ModuleStatus = "online" | "old" | "waiting" | "offline" | "other" | "line" | "lost";

export function moduleStatus(module: ModuleInfo): ModuleStatus {
  if (lostAt() !== null) return "lost";
  const line = lines.get(module.line);
  if (line && line.state !== "up") return "line";
  if (module.state === "other_model") return "other";
  if (module.state !== "online") return module.state === "offline" ? "offline" : "waiting";
  return pointsOf(module.module).some((point) => point.quality !== "good") ? "old" : "online";
}

/** When a module replied last, as far as its values show. */
export function lastReply(module: ModuleInfo): number | undefined {
  const lost = lostAt();
  if (lost !== null && module.state === "online") return lost;
  const times = pointsOf(module.module).flatMap((point) => point.read_at ?? []);
  return times.length ? Math.max(...times) : undefined;
}

/** The status of a module, in a few words. */
export function moduleStatusText(module: ModuleInfo): string {
  const how = moduleStatus(module);
  const last = lastReply(module);
  switch (how) {
    case "online":
      return t("state_online");
    case "old":
      return t("state_old");
    case "waiting":
      return t("state_unheard");
    case "offline":
      return last === undefined ? t("state_offline") : t("offline_for", { time: ago(last) });
    case "other":
      return t("state_other", { model: module.answers_as ?? "?" });
    case "line":
    case "lost": {
      return last === undefined ? t("unknown") : t("last_seen", { at: secondTime(last) });
    }
  }
}

/** How long ago, in whole seconds: it is shown anew once a second. */
export function ago(at: number): string {
  return span(Math.max(0, Math.round((clock() - at) / 1_000)) * 1_000);
}

/** The points of a module that are not hidden. */
export function visiblePointsOf(module: string): PointInfo[] {
  return pointsOf(module).filter((point) => !point.hidden || showsHidden());
}

/** Outputs, inputs, analog inputs, variables: each in the order of the terminals. */
export function byKind(points: PointInfo[], kind: PointInfo["kind"]): PointInfo[] {
  return points.filter((point) => point.kind === kind).sort((a, b) => a.index - b.index);
}

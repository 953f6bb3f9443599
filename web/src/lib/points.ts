// What is said of a point besides its value.
import { t } from "../i18n/index.svelte";
import type { PointInfo } from "./types";

/** Why a value can't be trusted. */
export function reasonText(point: PointInfo): string {
  if (point.quality === "stale") return t("quality_stale");
  const reason = point.reason ?? point.quality;
  switch (reason) {
    case "offline":
      return t("reason_offline");
    case "never_read":
    case "unknown":
      return t("reason_never_read");
    case "line_absent":
      return t("reason_line_absent");
    case "lent":
      return t("reason_lent");
    default:
      return reason;
  }
}

/** Outputs, inputs, analog inputs, variables: each in the order of the terminals. */
export function byKind(points: PointInfo[], kind: PointInfo["kind"]): PointInfo[] {
  return points.filter((point) => point.kind === kind).sort((a, b) => a.index - b.index);
}

// The data of a chart as CSV.
import type { Slot } from "./course";

export function heads(paths: string[]): string[] {
  return ["time", ...paths.flatMap((path) => ["min", "max", "mean"].map((what) => `${path}.${what}`))];
}

/** A row for each slot: minimum, maximum and mean of every point. */
export function rows(slots: Slot[]): (string | number | undefined)[][] {
  return slots.map(({ t, cells }) => [
    new Date(t).toISOString(),
    ...cells.flatMap((cell) => [cell?.min, cell?.max, cell?.mean]),
  ]);
}

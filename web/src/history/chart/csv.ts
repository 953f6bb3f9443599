// What a chart shows, as a table for other programs.
import type { Slot } from "./course";

export function heads(paths: string[]): string[] {
  return ["time", ...paths.flatMap((path) => ["min", "max", "mean"].map((what) => `${path}.${what}`))];
}

/** A row for each slot: least, greatest and mean of every point. */
export function rows(slots: Slot[]): (string | number | undefined)[][] {
  return slots.map(({ t, cells }) => [
    new Date(t).toISOString(),
    ...cells.flatMap((cell) => [cell?.min, cell?.max, cell?.mean]),
  ]);
}

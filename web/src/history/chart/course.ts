// The course of a point over time: consecutive stretches, each with the minimum, maximum and mean
// of its values. A sample holds until the next one.

import type { HistoryInfo } from "../../api/types";

/** From `t` to before `end`. Without values there is no data for that time. */
export interface Stretch {
  t: number;
  end: number;
  min: number | null;
  max: number | null;
  mean: number | null;
  /** How many samples fell into it. */
  n: number;
  ok: boolean;
}

export interface Course {
  stretches: Stretch[];
  /** Made of all samples; otherwise of buckets, whose counts are approximate. */
  exact: boolean;
}

export const NOTHING: Course = { stretches: [], exact: true };

/** The course in an answer; `until` is the present. */
export function courseOf(history: HistoryInfo, until: number): Course {
  if (history.samples) return { stretches: fromSamples(history.samples, until), exact: true };
  return { stretches: fromBuckets(history.buckets ?? [], until), exact: false };
}

function fromSamples(samples: NonNullable<HistoryInfo["samples"]>, until: number): Stretch[] {
  const found: Stretch[] = [];
  for (const [i, { t, v, q }] of samples.entries()) {
    const end = samples[i + 1]?.t ?? until;
    if (end <= t) continue;
    const value = v === null ? null : Number(v);
    found.push({ t, end, min: value, max: value, mean: value, n: 1, ok: value !== null && q !== "bad" });
  }
  return found;
}

function fromBuckets(buckets: NonNullable<HistoryInfo["buckets"]>, until: number): Stretch[] {
  const found: Stretch[] = [];
  for (const [i, { t, min, max, mean, n, q }] of buckets.entries()) {
    // The last bucket is as wide as the one before it.
    const width = t - (buckets[i - 1]?.t ?? t);
    const end = Math.min(until, buckets[i + 1]?.t ?? t + width);
    if (end <= t) continue;
    const known = min !== null && min !== undefined;
    // A stretch with values is shown even if a part of it was bad.
    found.push({ t, end, min, max, mean, n, ok: known && (q !== "bad" || n > 1) });
  }
  return found;
}

/** The stretch that contains a time. */
export function at(course: Course, t: number): Stretch | undefined {
  const { stretches } = course;
  let low = 0;
  let high = stretches.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    const found = stretches[middle];
    if (found && found.end <= t) low = middle + 1;
    else high = middle;
  }
  const found = stretches[low];
  return found && found.t <= t ? found : undefined;
}

export interface Stats {
  min: number;
  max: number;
  /** Weighted by time. For digital points the share of time it was on. */
  mean: number;
  /** For how long the value was known, in milliseconds. */
  known: number;
  /** How often it switched. */
  switched: number;
  exact: boolean;
}

/** Statistics of a range; null without data. */
export function stats(course: Course, from: number, to: number): Stats | null {
  let [min, max, weighed, known, switched] = [Infinity, -Infinity, 0, 0, 0];
  let before: Stretch | undefined;
  for (const stretch of course.stretches) {
    if (stretch.t >= to) break;
    if (!stretch.ok || stretch.min === null || stretch.max === null) continue;
    if (stretch.end > from) {
      const held = Math.min(stretch.end, to) - Math.max(stretch.t, from);
      min = Math.min(min, stretch.min);
      max = Math.max(max, stretch.max);
      weighed += (stretch.mean ?? stretch.min) * held;
      known += held;
      if (stretch.t >= from) switched += switchings(before, stretch);
    }
    before = stretch;
  }
  return known > 0 ? { min, max, mean: weighed / known, known, switched, exact: course.exact } : null;
}

/** How often a digital point switched between one stretch and the end of the next. */
function switchings(before: Stretch | undefined, stretch: Stretch): number {
  if (stretch.min !== stretch.max) return Math.max(1, stretch.n);
  if (!before || before.min !== before.max) return 0;
  return before.max === stretch.min ? 0 : 1;
}

/** A given number of slots of equal length, each with its statistics. */
export function tabulate(courses: Course[], from: number, to: number, slots: number): Slot[] {
  const width = (to - from) / slots;
  return Array.from({ length: slots }, (_, i) => {
    const t = from + i * width;
    return { t, cells: courses.map((course) => stats(course, t, t + width)) };
  });
}

export interface Slot {
  t: number;
  cells: (Stats | null)[];
}

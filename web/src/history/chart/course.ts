// The course of a point over time, in one shape: stretches that follow each other, each with the
// least, the greatest and the mean value in it. A single sample holds until the next one comes.

export type Quality = "good" | "stale" | "bad";

/** From `t` until before `end`; without a value nothing is known of that time. */
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
  /** Every sample is there; else they are summed up, and counts are only about right. */
  exact: boolean;
}

/** What `/history` answers. */
export interface History {
  point: string;
  unit?: string | null;
  raw?: boolean;
  samples?: { t: number; v: number | boolean | null; q?: Quality }[] | null;
  buckets?:
    | { t: number; min: number | null; max: number | null; mean: number | null; n: number; q?: Quality }[]
    | null;
}

export const NOTHING: Course = { stretches: [], exact: true };

/** The course that an answer tells of; `until` is where the present is, which nobody knows beyond. */
export function courseOf(history: History, until: number): Course {
  if (history.samples) return { stretches: fromSamples(history.samples, until), exact: true };
  return { stretches: fromBuckets(history.buckets ?? [], until), exact: false };
}

function fromSamples(samples: NonNullable<History["samples"]>, until: number): Stretch[] {
  const found: Stretch[] = [];
  for (const [i, { t, v, q }] of samples.entries()) {
    const end = samples[i + 1]?.t ?? until;
    if (end <= t) continue;
    const value = v === null ? null : Number(v);
    found.push({ t, end, min: value, max: value, mean: value, n: 1, ok: value !== null && q !== "bad" });
  }
  return found;
}

function fromBuckets(buckets: NonNullable<History["buckets"]>, until: number): Stretch[] {
  const found: Stretch[] = [];
  for (const [i, { t, min, max, mean, n, q }] of buckets.entries()) {
    // The last one is as wide as the one before it.
    const width = t - (buckets[i - 1]?.t ?? t);
    const end = Math.min(until, buckets[i + 1]?.t ?? t + width);
    if (end <= t) continue;
    const known = min !== null && min !== undefined;
    // A stretch that knows values shows them, even if some of it was bad.
    found.push({ t, end, min, max, mean, n, ok: known && (q !== "bad" || n > 1) });
  }
  return found;
}

/** The stretch in which a time lies. */
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
  /** Over time: what held longer counts more. For digital points the share of time it was on. */
  mean: number;
  /** For how long the value was known, in milliseconds. */
  known: number;
  /** How often it switched. */
  switched: number;
  exact: boolean;
}

/** What is to say of a time; nothing where nothing is known of it. */
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

/** How often a digital point switched from one stretch to the end of the next. */
function switchings(before: Stretch | undefined, stretch: Stretch): number {
  if (stretch.min !== stretch.max) return Math.max(1, stretch.n);
  if (!before || before.min !== before.max) return 0;
  return before.max === stretch.min ? 0 : 1;
}

/** So many slots of the same length, each with what is known of it. */
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

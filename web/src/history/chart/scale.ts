// Scales and their ticks.

export interface View {
  from: number;
  to: number;
}

/** The shortest and the longest time that a chart shows, in milliseconds. */
export const SPAN_LEAST = 200;
export const SPAN_MOST = 400 * 86_400_000;

/** Zooms by a factor (below 1: closer) around a fixed time. */
export function zoom(view: View, about: number, factor: number): View {
  const span = view.to - view.from;
  const next = Math.min(SPAN_MOST, Math.max(SPAN_LEAST, span * factor));
  const from = about - ((about - view.from) / span) * next;
  return { from, to: from + next };
}

export function pan(view: View, by: number): View {
  return { from: view.from + by, to: view.to + by };
}

/** Moves a range that reaches into the future back to the present. */
export function hold(view: View, now: number): View {
  return view.to > now ? pan(view, now - view.to) : view;
}

/** Pixels of a value on a scale from `a` to `b`. */
export function place(value: number, a: number, b: number, start: number, length: number): number {
  return b === a ? start + length / 2 : start + ((value - a) / (b - a)) * length;
}

/** 1, 2 or 5 times a power of ten, the nearest above. */
export function niceStep(rough: number): number {
  const power = 10 ** Math.floor(Math.log10(rough));
  const found = [1, 2, 5].find((step) => step * power >= rough * 0.999);
  return (found ?? 10) * power;
}

export interface Axis {
  min: number;
  max: number;
  ticks: number[];
  decimals: number;
}

/** An axis that holds these values, with about so many ticks. */
export function axis(min: number, max: number, about: number): Axis {
  // A constant value gets a scale around it.
  const room = max > min ? (max - min) * 0.06 : Math.max(Math.abs(max) * 0.1, 0.5);
  // No axis below zero for values that are never negative.
  const least = min >= 0 && min - room < 0 ? 0 : min - room;
  const step = niceStep((max + room - least) / about);
  const low = Math.floor(least / step) * step;
  const high = Math.ceil((max + room) / step) * step;
  const count = Math.round((high - low) / step);
  const ticks = Array.from({ length: count + 1 }, (_, i) => low + i * step);
  return { min: low, max: high, ticks, decimals: Math.max(0, -Math.floor(Math.log10(step) + 1e-9)) };
}

const S = 1_000;
const M = 60 * S;
const H = 60 * M;
const D = 24 * H;
const STEPS = [
  ...[10, 20, 50, 100, 200, 500, S, 2 * S, 5 * S, 10 * S, 15 * S, 30 * S],
  ...[M, 2 * M, 5 * M, 10 * M, 15 * M, 30 * M, H, 2 * H, 3 * H, 6 * H, 12 * H],
  ...[D, 2 * D, 7 * D, 14 * D, 30 * D, 60 * D],
];

export interface TimeTicks {
  step: number;
  at: number[];
}

/** At most `most` ticks at round local times. */
export function timeTicks(view: View, most: number): TimeTicks {
  const rough = (view.to - view.from) / Math.max(1, most);
  const step = STEPS.find((step) => step >= rough) ?? 60 * D;
  const found: number[] = [];
  const begin = new Date(view.from);
  begin.setHours(0, 0, 0, 0);
  if (step >= D) {
    // Days differ in length (daylight saving).
    const days = step / D;
    for (let day = begin; day.getTime() <= view.to; day.setDate(day.getDate() + days)) {
      if (day.getTime() >= view.from) found.push(day.getTime());
    }
    return { step, at: found };
  }
  const origin = begin.getTime();
  for (let t = origin + Math.ceil((view.from - origin) / step) * step; t <= view.to; t += step) {
    found.push(t);
  }
  return { step, at: found };
}

const two = (n: number, digits = 2): string => String(n).padStart(digits, "0");

/** `14:03`, `14:03:07`, `14:03:07.25`, `11-21`: as precise as the distance of two ticks needs. */
export function tickText(t: number, step: number): string {
  const d = new Date(t);
  const day = `${two(d.getMonth() + 1)}-${two(d.getDate())}`;
  if (step >= D) return day;
  const minutes = `${two(d.getHours())}:${two(d.getMinutes())}`;
  if (step >= M) return minutes === "00:00" ? day : minutes;
  const seconds = `${minutes}:${two(d.getSeconds())}`;
  if (step >= S) return seconds;
  return `${seconds}.${two(d.getMilliseconds(), 3).slice(0, step >= 100 ? 1 : 2)}`;
}

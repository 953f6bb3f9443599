// Reduces many stretches to one column per pixel, keeping minimum and maximum.
import type { Course, Stretch } from "./course";
import type { View } from "./scale";

/** From pixel `x` to `end`. */
export interface Column {
  x: number;
  end: number;
  min: number;
  max: number;
  mean: number;
}

export interface Columns {
  /** Runs of columns that touch each other. */
  runs: Column[][];
  /** Gaps in the data, from pixel to pixel. */
  gaps: { x: number; end: number }[];
}

/** The columns and gaps of a course at a given width in pixels. */
export function columns(course: Course, view: View, width: number): Columns {
  const scale = width / (view.to - view.from);
  const found: Columns = { runs: [], gaps: [] };
  let run: Column[] = [];
  let pixel = emptyPixel(-1);

  const flush = (): void => {
    if (pixel.weight > 0) push(run, { ...pixel, mean: pixel.weighed / pixel.weight });
    pixel = emptyPixel(-1);
  };
  const cut = (): void => {
    flush();
    if (run.length) found.runs.push(run);
    run = [];
  };

  // The pixel at which a gap begins.
  let lost: number | null = null;
  const ends = (end: number): void => {
    // A gap narrower than a pixel does not interrupt the line.
    if (lost !== null && end - lost >= 1) {
      cut();
      found.gaps.push({ x: lost, end });
    }
    lost = null;
  };

  for (const stretch of course.stretches) {
    if (stretch.end <= view.from) continue;
    if (stretch.t >= view.to) break;
    const x = Math.max(0, (stretch.t - view.from) * scale);
    const end = Math.min(width, (stretch.end - view.from) * scale);
    if (!known(stretch)) {
      lost ??= x;
      continue;
    }
    ends(x);
    if (Math.floor(x) === Math.floor(end - 1e-9) && end - x < 1) {
      if (pixel.at !== Math.floor(x)) {
        flush();
        pixel = emptyPixel(Math.floor(x));
      }
      gather(pixel, stretch, x, end);
    } else {
      flush();
      push(run, { x, end, min: stretch.min, max: stretch.max, mean: stretch.mean ?? stretch.min });
    }
  }
  ends(width);
  cut();
  return found;
}

type Known = Stretch & { min: number; max: number };

function known(stretch: Stretch): stretch is Known {
  return stretch.ok && stretch.min !== null && stretch.max !== null;
}

interface Pixel extends Column {
  at: number;
  weighed: number;
  weight: number;
}

function emptyPixel(at: number): Pixel {
  return { at, x: at, end: at, min: Infinity, max: -Infinity, mean: 0, weighed: 0, weight: 0 };
}

function gather(pixel: Pixel, stretch: Known, x: number, end: number): void {
  pixel.end = end;
  pixel.min = Math.min(pixel.min, stretch.min);
  pixel.max = Math.max(pixel.max, stretch.max);
  pixel.weighed += (stretch.mean ?? stretch.min) * (end - x);
  pixel.weight += end - x;
}

/** Each column begins where the one before it ends. Equal ones are merged. */
function push(run: Column[], { x, end, min, max, mean }: Column): void {
  const before = run.at(-1);
  if (before) before.end = x;
  if (before && before.min === min && before.max === max && before.mean === mean) before.end = end;
  else run.push({ x, end, min, max, mean });
}

// Draws the chart: a lane of lines for each unit, a band for each digital point, the time axis at
// the bottom. Everything is computed before; this only draws it onto the canvas.
import type { Course } from "./course";
import { columns, type Column, type Columns } from "./decimate";
import { axis, place, tickText, timeTicks, type Axis, type View } from "./scale";

export interface Series {
  path: string;
  digital: boolean;
  unit: string;
  course: Course;
  /** Which colour of the palette. */
  colour: number;
  /** Who switched it, and when. */
  marks: { t: number; ok: boolean }[];
}

export interface Scene {
  series: Series[];
  view: View;
  now: number;
  width: number;
  height: number;
  /** Cursors A and B, and the time below the pointer. */
  cursors: { t: number; name: string; active: boolean }[];
  hover: number | null;
}

export interface Palette {
  ink: string;
  muted: string;
  edge: string;
  accent: string;
  surface: string;
  bad: string;
  font: string;
  lines: string[];
}

export const LEFT = 52;
export const RIGHT = 10;
const TOP = 22;
const FOOT = 24;
const BAND = 38;
const LANE_LEAST = 110;
const HATCH = 6;

interface Lane {
  y: number;
  height: number;
  unit: string;
  axis: Axis;
  series: { one: Series; columns: Columns }[];
}

/** The height of a chart of these series, given the preferred one. */
export function heightFor(series: Series[], wanted: number): number {
  const lanes = new Set(series.filter((one) => !one.digital).map((one) => one.unit)).size;
  const bands = series.filter((one) => one.digital).length;
  return TOP + FOOT + bands * BAND + (lanes ? Math.max(lanes * LANE_LEAST, wanted - bands * BAND) : 20);
}

/** The time of a pixel. */
export function timeAt(view: View, x: number, width: number): number {
  return view.from + ((x - LEFT) / Math.max(1, width - LEFT - RIGHT)) * (view.to - view.from);
}

export function pixelAt(view: View, t: number, width: number): number {
  return place(t, view.from, view.to, LEFT, width - LEFT - RIGHT);
}

export function draw(on: CanvasRenderingContext2D, scene: Scene, palette: Palette): void {
  const inner = scene.width - LEFT - RIGHT;
  on.clearRect(0, 0, scene.width, scene.height);
  on.font = palette.font;
  on.lineWidth = 1;
  drawTime(on, scene, palette);
  const digital = scene.series.filter((one) => one.digital);
  const floor = scene.height - FOOT - digital.length * BAND;
  for (const lane of lanesOf(scene, inner, floor)) drawLane(on, lane, inner, palette);
  digital.forEach((one, i) => drawBand(on, one, scene, floor + i * BAND, inner, palette));
  drawCursors(on, scene, palette);
}

function lanesOf(scene: Scene, inner: number, floor: number): Lane[] {
  const analog = scene.series.filter((one) => !one.digital);
  const units = [...new Set(analog.map((one) => one.unit))];
  const height = (floor - TOP) / Math.max(1, units.length);
  return units.map((unit, i) => {
    const series = analog
      .filter((one) => one.unit === unit)
      .map((one) => ({ one, columns: columns(one.course, scene.view, inner) }));
    let [min, max] = [Infinity, -Infinity];
    for (const { columns } of series) {
      for (const column of columns.runs.flat()) {
        min = Math.min(min, column.min);
        max = Math.max(max, column.max);
      }
    }
    const scale = min > max ? axis(0, 1, 2) : axis(min, max, Math.max(2, height / 44));
    return { y: TOP + i * height + 4, height: height - 14, unit, axis: scale, series };
  });
}

function drawTime(on: CanvasRenderingContext2D, scene: Scene, palette: Palette): void {
  const { view, width, height } = scene;
  const { step, at } = timeTicks(view, (width - LEFT) / 92);
  on.textAlign = "center";
  on.textBaseline = "alphabetic";
  for (const t of at) {
    const x = Math.round(pixelAt(view, t, width)) + 0.5;
    stroke(on, palette.edge, x, TOP, x, height - FOOT);
    on.fillStyle = palette.muted;
    if (x > LEFT + 10 && x < width - 26) on.fillText(tickText(t, step), x, height - 8);
  }
}

function drawLane(on: CanvasRenderingContext2D, lane: Lane, inner: number, palette: Palette): void {
  const y = (value: number): number =>
    place(value, lane.axis.min, lane.axis.max, lane.y + lane.height, -lane.height);
  on.textBaseline = "middle";
  on.textAlign = "right";
  for (const tick of lane.axis.ticks) {
    const at = Math.round(y(tick)) + 0.5;
    stroke(on, palette.edge, LEFT, at, LEFT + inner, at);
    on.fillStyle = palette.muted;
    on.fillText(tick.toFixed(lane.axis.decimals), LEFT - 6, at);
  }
  if (lane.unit) {
    on.textAlign = "left";
    on.fillText(lane.unit, LEFT + 4, lane.y + 8);
  }
  for (const { one, columns } of lane.series) {
    const colour = palette.lines[one.colour] ?? palette.accent;
    for (const gap of columns.gaps) hatch(on, gap, lane.y, lane.height, palette);
    for (const run of columns.runs) drawRun(on, run, y, colour);
  }
}

/** The range from minimum to maximum, lightly, and the mean as a line. */
function drawRun(on: CanvasRenderingContext2D, run: Column[], y: (value: number) => number, colour: string): void {
  on.fillStyle = colour;
  on.globalAlpha = 0.22;
  on.beginPath();
  for (const { x, end, max } of run) line(on, x, end, y(max));
  for (const { x, end, min } of run.toReversed()) line(on, end, x, y(min));
  on.fill();
  on.globalAlpha = 1;
  on.strokeStyle = colour;
  on.lineWidth = 1.6;
  on.beginPath();
  run.forEach(({ x, end, mean }, i) => {
    if (i === 0) on.moveTo(LEFT + x, y(mean));
    line(on, x, end, y(mean));
  });
  on.stroke();
  on.lineWidth = 1;
}

function line(on: CanvasRenderingContext2D, from: number, to: number, y: number): void {
  on.lineTo(LEFT + from, y);
  on.lineTo(LEFT + to, y);
}

/** On is a block, off a thin line: told apart without colour. */
function drawBand(
  on: CanvasRenderingContext2D,
  one: Series,
  { view, width }: Scene,
  top: number,
  inner: number,
  palette: Palette,
): void {
  const { runs, gaps } = columns(one.course, view, inner);
  const [y, height] = [top + 17, BAND - 21];
  on.fillStyle = palette.lines[one.colour] ?? palette.accent;
  for (const { x, end, min, max, mean } of runs.flat()) {
    const wide = Math.max(1, end - x);
    on.fillRect(LEFT + x, y + height - 2, wide, 2);
    if (max <= 0) continue;
    on.globalAlpha = min === max ? 0.85 : 0.3 + 0.5 * mean;
    on.fillRect(LEFT + x, y, wide, height);
    on.globalAlpha = 1;
  }
  for (const gap of gaps) hatch(on, gap, y, height, palette);
  for (const mark of one.marks) {
    const x = pixelAt(view, mark.t, width);
    if (x >= LEFT && x <= width - RIGHT) drawMark(on, x, y - 5, mark.ok ? palette.ink : palette.bad, mark.ok);
  }
  on.fillStyle = palette.ink;
  on.textAlign = "left";
  on.textBaseline = "middle";
  on.fillText(one.path, LEFT + 4, top + 8);
}

/** A command: a wedge; a cross if it failed. */
function drawMark(on: CanvasRenderingContext2D, x: number, y: number, colour: string, ok: boolean): void {
  on.fillStyle = colour;
  on.beginPath();
  if (ok) {
    on.moveTo(x, y + 5);
    on.lineTo(x - 4, y - 2);
    on.lineTo(x + 4, y - 2);
    on.fill();
  } else {
    stroke(on, colour, x - 4, y - 3, x + 4, y + 5);
    stroke(on, colour, x + 4, y - 3, x - 4, y + 5);
  }
}

/** A time without data. */
function hatch(
  on: CanvasRenderingContext2D,
  { x, end }: { x: number; end: number },
  y: number,
  height: number,
  palette: Palette,
): void {
  on.save();
  on.beginPath();
  on.rect(LEFT + x, y, end - x, height);
  on.clip();
  on.strokeStyle = palette.edge;
  on.beginPath();
  for (let at = x - height; at < end; at += HATCH) {
    on.moveTo(LEFT + at, y + height);
    on.lineTo(LEFT + at + height, y);
  }
  on.stroke();
  on.restore();
}

function drawCursors(on: CanvasRenderingContext2D, scene: Scene, palette: Palette): void {
  const { view, width, height, hover, cursors } = scene;
  if (hover !== null) {
    on.setLineDash([3, 3]);
    const x = Math.round(pixelAt(view, hover, width)) + 0.5;
    stroke(on, palette.muted, x, TOP, x, height - FOOT);
    on.setLineDash([]);
  }
  on.textAlign = "center";
  on.textBaseline = "middle";
  for (const { t, name, active } of cursors) {
    const x = Math.round(pixelAt(view, t, width)) + 0.5;
    if (x < LEFT || x > width - RIGHT + 1) continue;
    stroke(on, palette.accent, x, TOP, x, height - FOOT);
    on.fillStyle = active ? palette.accent : palette.surface;
    on.strokeStyle = palette.accent;
    on.beginPath();
    on.rect(x - 9.5, 2, 19, 18);
    on.fill();
    on.stroke();
    on.fillStyle = active ? palette.surface : palette.accent;
    on.fillText(name, x, 12);
  }
}

function stroke(
  on: CanvasRenderingContext2D,
  colour: string,
  x: number,
  y: number,
  toX: number,
  toY: number,
): void {
  on.strokeStyle = colour;
  on.beginPath();
  on.moveTo(x, y);
  on.lineTo(toX, toY);
  on.stroke();
}

// What a chart computes before it draws.
import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import { modules } from "./modules.js";

let course, decimate, scale, csv, close;

before(async () => {
  const loaded = await modules("history/chart/course.ts", "history/chart/decimate.ts", "history/chart/scale.ts", "history/chart/csv.ts");
  [course, decimate, scale, csv] = loaded.found;
  close = loaded.close;
});
after(() => close());

const samples = (...all) => ({ point: "a.b", samples: all.map(([t, v, q]) => ({ t, v, q: q ?? "good" })) });

test("a sample holds until the next one", () => {
  const { stretches, exact } = course.courseOf(samples([0, 1], [10, null, "bad"], [30, 0]), 50);
  assert.equal(exact, true);
  assert.deepEqual(stretches.map(({ t, end, mean, ok }) => [t, end, mean, ok]), [
    [0, 10, 1, true],
    [10, 30, null, false],
    [30, 50, 0, true],
  ]);
});

test("a bad value is not a value, though it has a number", () => {
  const { stretches } = course.courseOf(samples([0, 5, "bad"], [10, 5]), 20);
  assert.deepEqual(stretches.map((stretch) => stretch.ok), [false, true]);
});

test("buckets know no more than they say", () => {
  const buckets = [
    { t: 0, min: 1, max: 3, mean: 2, n: 4 },
    { t: 10, min: null, max: null, mean: null, n: 0 },
    { t: 20, min: 2, max: 2, mean: 2, n: 1 },
  ];
  const found = course.courseOf({ point: "a.b", buckets }, 28);
  assert.equal(found.exact, false);
  assert.deepEqual(found.stretches.map(({ t, end, ok }) => [t, end, ok]), [[0, 10, true], [10, 20, false], [20, 28, true]]);
});

test("the stretch of a time is found, none before the first and after the last", () => {
  const all = course.courseOf(samples([10, 1], [20, 2], [30, 3]), 40);
  const at = (t) => course.at(all, t)?.mean;
  assert.deepEqual([at(9), at(10), at(19.9), at(20), at(39), at(40)], [undefined, 1, 1, 2, 3, undefined]);
});

test("the mean is one over time, not over samples", () => {
  const all = course.courseOf(samples([0, 10], [90, 20]), 100);
  const found = course.stats(all, 0, 100);
  assert.equal(found.mean, 11);
  assert.deepEqual([found.min, found.max, found.known], [10, 20, 100]);
  // Between cursors only what lies between them counts.
  assert.equal(course.stats(all, 80, 100).mean, 15);
});

test("time of which nothing is known counts for nothing", () => {
  const all = course.courseOf(samples([0, 4], [50, null, "bad"], [90, 4]), 100);
  const found = course.stats(all, 0, 100);
  assert.deepEqual([found.mean, found.known], [4, 60]);
  assert.equal(course.stats(all, 55, 85), null);
  assert.equal(course.stats(course.NOTHING, 0, 1), null);
});

test("switchings are counted, also across a gap, not the value at the beginning", () => {
  const all = course.courseOf(samples([0, 0], [10, 1], [20, 0], [30, null, "bad"], [40, 1], [50, 1]), 60);
  assert.equal(course.stats(all, 0, 60).switched, 3);
  assert.equal(course.stats(all, 15, 60).switched, 2);
  assert.equal(course.stats(all, 41, 49).switched, 0);
});

test("a table has a line for each slot", () => {
  const all = course.courseOf(samples([0, 1], [10, 3]), 20);
  const slots = course.tabulate([all], 0, 20, 4);
  assert.deepEqual(slots.map((slot) => slot.cells[0].mean), [1, 1, 3, 3]);
});

test("thousands of samples become one column a pixel, and no peak is lost", () => {
  const many = Array.from({ length: 20_000 }, (_, t) => [t, t === 12_345 ? 99 : t % 7]);
  const all = course.courseOf(samples(...many), 20_000);
  const { runs, gaps } = decimate.columns(all, { from: 0, to: 20_000 }, 500);
  assert.equal(gaps.length, 0);
  assert.equal(runs.length, 1);
  assert.ok(runs[0].length <= 501, `${runs[0].length} columns`);
  assert.equal(Math.max(...runs[0].map((column) => column.max)), 99);
  assert.equal(Math.min(...runs[0].map((column) => column.min)), 0);
});

test("a gap of many bad samples is one gap, and tears the line", () => {
  const bad = Array.from({ length: 100 }, (_, i) => [500 + i, null, "bad"]);
  const all = course.courseOf(samples([0, 1], ...bad, [600, 2]), 1_000);
  const { runs, gaps } = decimate.columns(all, { from: 0, to: 1_000 }, 100);
  assert.deepEqual(gaps, [{ x: 50, end: 60 }]);
  assert.deepEqual(runs.map((run) => [run[0].x, run.at(-1).end]), [[0, 50], [60, 100]]);
});

test("a gap narrower than a pixel does not tear the line", () => {
  const all = course.courseOf(samples([0, 1], [500, null, "bad"], [501, 2]), 1_000);
  assert.equal(decimate.columns(all, { from: 0, to: 1_000 }, 100).runs.length, 1);
});

test("nothing outside the view is drawn", () => {
  const all = course.courseOf(samples([0, 1], [100, 2], [200, 3], [300, 4]), 400);
  const { runs } = decimate.columns(all, { from: 150, to: 250 }, 100);
  assert.deepEqual(runs[0].map(({ x, end, mean }) => [x, end, mean]), [[0, 50, 2], [50, 100, 3]]);
});

test("zoom keeps the time under the pointer where it is", () => {
  const view = { from: 0, to: 10_000 };
  const closer = scale.zoom(view, 2_500, 0.5);
  assert.deepEqual(closer, { from: 1_250, to: 6_250 });
  assert.equal(scale.zoom(view, 0, 1e-9).to, scale.SPAN_LEAST);
  assert.deepEqual(scale.hold({ from: 50, to: 150 }, 100), { from: 0, to: 100 });
});

test("axes have round steps and hold every value", () => {
  for (const [min, max] of [[0, 10], [3.17, 8.84], [-5, 5], [8.71, 8.71], [0, 0], [1e-4, 2e-4], [1e6, 1.1e6], [-40.2, -12.1]]) {
    const axis = scale.axis(min, max, 4);
    assert.ok(axis.min <= min && axis.max >= max, `${min}..${max} in ${axis.min}..${axis.max}`);
    assert.ok(axis.ticks.length >= 3 && axis.ticks.length <= 9, `${axis.ticks.length} ticks`);
    const texts = axis.ticks.map((tick) => tick.toFixed(axis.decimals));
    assert.equal(new Set(texts).size, texts.length, `ticks can be told apart: ${texts}`);
  }
  assert.equal(scale.axis(0.1, 5, 4).min, 0);
});

test("time ticks lie at round times, and are told apart", () => {
  const begin = new Date(2026, 10, 21, 13, 7, 23).getTime();
  for (const span of [500, 5_000, 60_000, 600_000, 3_600_000, 86_400_000, 7 * 86_400_000, 90 * 86_400_000]) {
    const { step, at } = scale.timeTicks({ from: begin, to: begin + span }, 8);
    assert.ok(at.length >= 1 && at.length <= 9, `${at.length} ticks in ${span}`);
    const texts = at.map((t) => scale.tickText(t, step));
    assert.equal(new Set(texts).size, texts.length, `${texts}`);
  }
  const { at } = scale.timeTicks({ from: begin, to: begin + 600_000 }, 8);
  assert.equal(scale.tickText(at[0], 120_000), "13:08");
});

test("a table for other programs has a row for each slot, empty where nothing is known", () => {
  const slots = [{ t: 0, cells: [{ min: 1, max: 3, mean: 2 }, null] }];
  assert.deepEqual(csv.heads(["p.a"]), ["time", "p.a.min", "p.a.max", "p.a.mean"]);
  const none = [undefined, undefined, undefined];
  assert.deepEqual(csv.rows(slots), [["1970-01-01T00:00:00.000Z", 1, 3, 2, ...none]]);
});

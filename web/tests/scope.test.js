// A busy line for a long time: the scope keeps its hundred thousand frames, and no more of
// anything. The frames are made here, all else comes from the daemon.
import assert from "node:assert/strict";
import { test } from "node:test";
import { open } from "./daemon.js";
import { browser, cookies, daemon } from "./site.js";

const KEPT = 100_000;
const SPARE = 5_000;
const SECONDS = 60;
const PARTS = 6;
const RATE = 1_000;

function frames(from, count) {
  return Array.from({ length: count }, (_, i) => ({
    event: "frame",
    time: new Date(Date.UTC(2026, 0, 1) + from + i).toISOString(),
    line: "main",
    role: i % 2 ? "reply" : "request",
    protocol: "rtu",
    address: 3,
    module: "oven",
    meaning: `read 8 coils from ${from + i}`,
    verdict: (from + i) % 100 ? "good" : "bad",
    bytes: "03 01 00 3C 00 08 FC 22",
    gap_ms: 10.5,
  }));
}

test("a thousand frames a second do not grow the page", async () => {
  const { context, page, wrong } = await open(browser, { lang: "en", width: 1280, scheme: "light" });
  await context.addCookies(cookies);
  let give;
  let itListens;
  const listens = new Promise((resolve) => (itListens = resolve));
  await page.routeWebSocket(/\/api\/v1\/ws/, (socket) => {
    const server = socket.connectToServer();
    socket.onMessage((message) => {
      server.send(message);
      if (String(message).includes('"frames/main"')) itListens();
    });
    server.onMessage((message) => {
      if (!String(message).includes('"frames/main"')) socket.send(message);
    });
    give = (list) => socket.send(JSON.stringify({ type: "delta", topic: "frames/main", seq: 1, frames: list }));
  });
  await page.goto(`${daemon.origin}/lines/main/scope`);
  await page.locator(".connection.live").waitFor();
  // What comes before the page asks for it is none of its frames.
  await listens;
  const devtools = await context.newCDPSession(page);
  // Time of the processor, not of the clock: others may be busy, too.
  await devtools.send("Performance.enable", { timeDomain: "threadTicks" });
  const measure = async () => {
    await devtools.send("HeapProfiler.collectGarbage");
    const { metrics } = await devtools.send("Performance.getMetrics");
    return Object.fromEntries(metrics.map(({ name, value }) => [name, value]));
  };

  let sent = 0;
  const send = (count) => {
    give(frames(sent, count));
    sent += count;
  };
  const kept = async () => Number.parseInt(await page.locator("p[role=status]").innerText(), 10);
  while (sent < KEPT + SPARE) send(1_000);
  // Whether the list shows its end at that moment is another matter.
  await page.waitForFunction((least) => {
    const text = document.querySelector("p[role=status]")?.textContent ?? "";
    return Number.parseInt(text, 10) >= least;
  }, KEPT);
  const full = await measure();
  const from = sent;
  const begin = performance.now();
  const since = () => (performance.now() - begin) / 1_000;
  const heaps = [];
  for (let part = 1; part <= PARTS; part += 1) {
    const end = (SECONDS / PARTS) * part;
    while (sent - from < end * RATE) {
      await new Promise((resolve) => setTimeout(resolve, 50));
      // What is due, however late this program was woken.
      send(Math.floor(Math.min(since(), end) * RATE) - (sent - from));
    }
    heaps.push(await measure());
  }
  const seconds = since();
  const [first, later] = [heaps[0], heaps[PARTS - 1]];

  const busy = ((later.TaskDuration - full.TaskDuration) / seconds) * 1_000;
  const sizes = [full, ...heaps].map(({ JSHeapUsedSize }) => (JSHeapUsedSize / 1e6).toFixed(1));
  console.log(`heap ${sizes.join(" ")} MB, busy ${busy.toFixed(0)} ms/s, ${seconds.toFixed(0)} s`);
  assert.ok(later.JSHeapUsedSize < first.JSHeapUsedSize * 1.05, "the heap grows");
  assert.ok(later.Nodes < first.Nodes * 1.2 + 100, `nodes: ${first.Nodes} -> ${later.Nodes}`);
  const told = await kept();
  assert.ok(told >= KEPT && told <= KEPT + SPARE, `${told} frames are kept`);
  assert.ok((await page.locator(".window .list-row").count()) < 100, "only what is seen exists");

  await page.getByRole("searchbox").fill("bad and addr=3");
  await page.waitForFunction((most) => {
    const text = document.querySelector("p[role=status]")?.textContent ?? "";
    return Number.parseInt(text, 10) <= most;
  }, (KEPT + SPARE) / 100 + 1);
  assert.deepEqual(wrong, []);
  await context.close();
});

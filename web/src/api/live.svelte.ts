// The current state of the site, fed by the WebSocket. Where no WebSocket gets through, and for a
// far site, it is polled.
import { SvelteMap } from "svelte/reactivity";
import { language } from "../i18n/index.svelte";
import { farSite } from "./base";
import { get, csrfToken, problemOf } from "./client";
import { isOpen, isUnseen, markHeard, markOpen, markRetry, POLL_MS, silence, STALE_AFTER_MS } from "./link.svelte";
import type { LineInfo, ModuleInfo, PointInfo, Problem } from "./types";

export const points = new SvelteMap<string, PointInfo>();
export const modules = new SvelteMap<string, ModuleInfo>();
export const lines = new SvelteMap<string, LineInfo>();

/** A message of the server about a topic. */
export interface Message {
  type: "snapshot" | "delta" | "dropped";
  topic: string;
  data?: unknown;
  n?: number;
  [what: string]: unknown;
}

type Listener = (message: Message) => void;

const ALWAYS = ["points/#", "modules", "lines"];
const CHECK_MS = 1_000;
/** After this time an answer would say nothing about now. It also frees the browser's few connections for commands. */
const POLL_MOST_MS = STALE_AFTER_MS;
/** How often those who subscribed are told to look again, where there are no news. */
const FAR_NEWS_MS = 10_000;
/** Silence after which the connection is probed, and after which it is closed. */
const ASK_AFTER_MS = 2_000;
const GONE_AFTER_MS = 15_000;
const RETRY_MOST_MS = 15_000;

/** The recent samples of each analog point, for its sparkline. */
const COURSE_MS = 60_000;
const COURSE_MOST = 240;
const courses = new SvelteMap<string, { t: number; v: number }[]>();

const listeners = new Map<string, Set<Listener>>();

let socket: WebSocket | null = null;
let running = false;
let failures = 0;
let polling: ReturnType<typeof setInterval> | undefined;

export function course(path: string): readonly { t: number; v: number }[] {
  return courses.get(path) ?? [];
}

export function pointsOf(module: string): PointInfo[] {
  return [...points.values()].filter((point) => point.module === module);
}

/** Subscribes to a topic. The returned function unsubscribes. */
export function subscribe(topic: string, listener: Listener): () => void {
  if (farSite !== null) {
    // It sends no news: something may have been missed at any time.
    const timer = setInterval(() => isUnseen() || listener({ type: "dropped", topic }), FAR_NEWS_MS);
    return () => clearInterval(timer);
  }
  const others = listeners.get(topic) ?? new Set();
  if (others.size === 0) send({ sub: [topic] });
  others.add(listener);
  listeners.set(topic, others);
  return () => {
    others.delete(listener);
    if (others.size > 0) return;
    listeners.delete(topic);
    send({ unsub: [topic] });
  };
}

/** Connects, and reconnects until `stop`. */
export function start(): void {
  if (running) return;
  running = true;
  connect();
  watchdog = setInterval(checkAlive, CHECK_MS);
}

export function stop(): void {
  running = false;
  clearInterval(watchdog);
  clearInterval(polling);
  polling = undefined;
  socket?.close();
}

document.addEventListener("visibilitychange", () => {
  if (farSite !== null && running) void poll();
});

let watchdog: ReturnType<typeof setInterval> | undefined;
let asked = false;

/** Probes a silent connection: it may have died without being closed. */
function checkAlive(): void {
  if (!isOpen()) return;
  const silent = silence();
  // The browser slows down the timers of a page in the background: close only after a probe.
  if (asked && silent > GONE_AFTER_MS) socket?.close();
  else if (silent > ASK_AFTER_MS && !asked) {
    asked = true;
    send({ sub: ["lines"] });
  }
}

function send(message: object): void {
  if (socket?.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message));
}

function connect(): void {
  if (!running) return;
  if (farSite !== null) {
    startPolling();
    return void poll();
  }
  const scheme = location.protocol === "https:" ? "wss" : "ws";
  const asked = new URLSearchParams({ lang: language(), ...(csrfToken() ? { csrf: csrfToken() ?? "" } : {}) });
  const mine = new WebSocket(`${scheme}://${location.host}/api/v1/ws?${asked}`);
  socket = mine;
  mine.onopen = () => {
    failures = 0;
    clearInterval(polling);
    polling = undefined;
    markOpen(true);
    heard();
    send({ sub: [...new Set([...ALWAYS, ...listeners.keys()])] });
  };
  mine.onmessage = (event) => {
    heard();
    receive(JSON.parse(String(event.data)) as Message);
  };
  mine.onclose = () => {
    markOpen(false);
    if (!running || socket !== mine) return;
    failures += 1;
    const wait = Math.min(RETRY_MOST_MS, 500 * 2 ** Math.min(failures, 8));
    markRetry(wait);
    setTimeout(connect, wait);
    startPolling();
  };
}

function startPolling(): void {
  polling ??= setInterval(() => void poll(), POLL_MS);
}

function heard(): void {
  markHeard();
  asked = false;
}

let busy = false;
/** Something has changed since the poll under way was asked. */
let again = false;
let failure = $state.raw<Problem | null>(null);

/** Why what is shown could not be fetched the last time, if it is polled. */
export const pollProblem = (): Problem | null => failure;

async function poll(): Promise<void> {
  if (busy || isUnseen()) return;
  busy = true;
  again = false;
  // It was so at some time since, however long the answer takes.
  const since = Date.now();
  try {
    const [l, m, p] = await Promise.all([
      get<{ lines: LineInfo[] }>("/lines", POLL_MOST_MS),
      get<{ modules: ModuleInfo[] }>("/modules", POLL_MOST_MS),
      get<{ points: PointInfo[] }>("/points", POLL_MOST_MS),
    ]);
    replaceAll(lines, l.lines, (line) => line.line);
    replaceAll(modules, m.modules, (module) => module.module);
    for (const point of p.points) noteReading(point, since);
    replaceAll(points, p.points, (point) => point.path);
    // Only now: what could not be taken was not heard.
    markHeard(since);
    failure = null;
  } catch (thrown) {
    failure = problemOf(thrown);
  } finally {
    busy = false;
  }
  if (again) void poll();
}

function receive(message: Message): void {
  const news = (key: string): unknown[] => {
    const found = message.type === "snapshot" ? (message.data ?? message[key]) : message[key];
    const inner = Array.isArray(found) ? found : (found as Record<string, unknown> | undefined)?.[key];
    return Array.isArray(inner) ? inner : [];
  };
  const all = message.type === "snapshot";
  switch (message.topic) {
    case "points/#": {
      const fresh = news("points") as PointInfo[];
      for (const point of fresh) noteReading(point);
      merge(points, fresh, (point) => point.path, all);
      break;
    }
    case "modules":
      merge(modules, news("modules") as ModuleInfo[], (module) => module.module, all);
      break;
    case "lines":
      merge(lines, news("lines") as LineInfo[], (line) => line.line, all);
      break;
  }
  listeners.get(message.topic)?.forEach((listener) => listener(message));
}

function merge<T>(into: SvelteMap<string, T>, news: T[], key: (item: T) => string, all: boolean): void {
  if (all) replaceAll(into, news, key);
  else for (const item of news) into.set(key(item), item);
}

function replaceAll<T>(into: SvelteMap<string, T>, items: T[], key: (item: T) => string): void {
  const kept = new Set(items.map(key));
  for (const old of [...into.keys()]) if (!kept.has(old)) into.delete(old);
  for (const item of items) into.set(key(item), item);
}

/** Notes when a point was read, and adds analog values to their samples. */
function noteReading(point: PointInfo, now = Date.now()): void {
  if (point.age_ms !== undefined) point.read_at = now - point.age_ms;
  // A value that is not good is no sample.
  if (point.kind !== "analog" || typeof point.value !== "number" || point.quality !== "good") return;
  const kept = (courses.get(point.path) ?? []).filter((sample) => sample.t > now - COURSE_MS);
  courses.set(point.path, [...kept, { t: now, v: point.value }].slice(-COURSE_MOST));
}

/** Stores a point that was fetched on its own. */
export function refresh(point: PointInfo): void {
  // From a far site answers arrive in any order: only polls, one after the other, say how it is.
  if (farSite !== null) {
    again = busy;
    return void poll();
  }
  noteReading(point);
  points.set(point.path, point);
}

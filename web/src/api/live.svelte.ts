// The current state of the site, fed by the WebSocket. Where no WebSocket gets through, it is
// polled once a second.
import { SvelteMap } from "svelte/reactivity";
import { language } from "../i18n/index.svelte";
import { get, csrfToken } from "./client";
import { clock } from "../lib/clock.svelte";
import type { LineInfo, ModuleInfo, PointInfo } from "./types";

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
const POLL_MS = 1_000;
/** Silence after which the connection is probed, and after which it is closed. */
const ASK_AFTER_MS = 2_000;
const GONE_AFTER_MS = 15_000;
/** Silence after which everything shown is stale, even if the socket is still open. */
const STALE_AFTER_MS = 5_000;
const RETRY_MOST_MS = 15_000;

/** The recent samples of each analog point, for its sparkline. */
const COURSE_MS = 60_000;
const COURSE_MOST = 240;
const courses = new SvelteMap<string, { t: number; v: number }[]>();

const link = $state({ open: false, everHeard: false, heard: Date.now(), retryAt: 0 });
const listeners = new Map<string, Set<Listener>>();

let socket: WebSocket | null = null;
let running = false;
let failures = 0;
let polling: ReturnType<typeof setInterval> | undefined;

export type LinkState = "live" | "connecting" | "reconnecting" | "stale";

/** The state of the connection, and the seconds to show with it. */
export function connection(): { state: LinkState; seconds: number } {
  const now = clock();
  const silent = now - link.heard;
  if (!link.everHeard) return { state: "connecting", seconds: 0 };
  if (silent < (link.open ? STALE_AFTER_MS : 2 * POLL_MS + 500)) return { state: "live", seconds: 0 };
  if (silent > STALE_AFTER_MS) return { state: "stale", seconds: Math.round(silent / 1_000) };
  return { state: "reconnecting", seconds: Math.max(0, Math.ceil((link.retryAt - now) / 1_000)) };
}

/** When the connection was lost, if it is: everything shown is from then. */
export function lostAt(): number | null {
  const { state } = connection();
  return state === "reconnecting" || state === "stale" ? link.heard : null;
}

export function isStale(): boolean {
  return lostAt() !== null;
}

export function course(path: string): readonly { t: number; v: number }[] {
  return courses.get(path) ?? [];
}

export function pointsOf(module: string): PointInfo[] {
  return [...points.values()].filter((point) => point.module === module);
}

/** Subscribes to a topic. The returned function unsubscribes. */
export function subscribe(topic: string, listener: Listener): () => void {
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
  watchdog = setInterval(checkAlive, POLL_MS);
}

export function stop(): void {
  running = false;
  clearInterval(watchdog);
  clearInterval(polling);
  polling = undefined;
  socket?.close();
}

let watchdog: ReturnType<typeof setInterval> | undefined;
let asked = false;

/** Probes a silent connection: it may have died without being closed. */
function checkAlive(): void {
  if (!link.open) return;
  const silent = Date.now() - link.heard;
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
  const scheme = location.protocol === "https:" ? "wss" : "ws";
  const asked = new URLSearchParams({ lang: language(), ...(csrfToken() ? { csrf: csrfToken() ?? "" } : {}) });
  const mine = new WebSocket(`${scheme}://${location.host}/api/v1/ws?${asked}`);
  socket = mine;
  mine.onopen = () => {
    failures = 0;
    clearInterval(polling);
    polling = undefined;
    link.open = true;
    markHeard();
    send({ sub: [...new Set([...ALWAYS, ...listeners.keys()])] });
  };
  mine.onmessage = (event) => {
    markHeard();
    receive(JSON.parse(String(event.data)) as Message);
  };
  mine.onclose = () => {
    link.open = false;
    if (!running || socket !== mine) return;
    failures += 1;
    const wait = Math.min(RETRY_MOST_MS, 500 * 2 ** Math.min(failures, 8));
    link.retryAt = Date.now() + wait;
    setTimeout(connect, wait);
    polling ??= setInterval(() => void poll(), POLL_MS);
  };
}

function markHeard(): void {
  link.heard = Date.now();
  link.everHeard = true;
  asked = false;
}

let busy = false;

async function poll(): Promise<void> {
  if (busy) return;
  busy = true;
  try {
    const [l, m, p] = await Promise.all([
      get<{ lines: LineInfo[] }>("/lines"),
      get<{ modules: ModuleInfo[] }>("/modules"),
      get<{ points: PointInfo[] }>("/points"),
    ]);
    markHeard();
    replaceAll(lines, l.lines, (line) => line.line);
    replaceAll(modules, m.modules, (module) => module.module);
    p.points.forEach(noteReading);
    replaceAll(points, p.points, (point) => point.path);
  } catch {
    // The state of the connection shows it.
  } finally {
    busy = false;
  }
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
      fresh.forEach(noteReading);
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
function noteReading(point: PointInfo): void {
  const now = Date.now();
  if (point.age_ms !== undefined) point.read_at = now - point.age_ms;
  // A value that is not good is no sample.
  if (point.kind !== "analog" || typeof point.value !== "number" || point.quality !== "good") return;
  const kept = (courses.get(point.path) ?? []).filter((sample) => sample.t > now - COURSE_MS);
  courses.set(point.path, [...kept, { t: now, v: point.value }].slice(-COURSE_MOST));
}

/** Stores a point that was fetched on its own. */
export function refresh(point: PointInfo): void {
  noteReading(point);
  points.set(point.path, point);
}

// Numbers and times as people read them.
import { language } from "../i18n/index.svelte";

const two = (n: number): string => String(n).padStart(2, "0");

/** `2026-11-21 14:03:07`, in the browser's time zone. */
export function dateTime(at: Date | string | number): string {
  const d = new Date(at);
  const day = `${d.getFullYear()}-${two(d.getMonth() + 1)}-${two(d.getDate())}`;
  return `${day} ${two(d.getHours())}:${two(d.getMinutes())}:${two(d.getSeconds())}`;
}

/** `14:03:07`; with the date unless it is today's. */
export function secondTime(at: number): string {
  const whole = dateTime(at);
  const [day, time] = whole.split(" ");
  return dateTime(Date.now()).startsWith(day ?? "") ? (time ?? whole) : whole;
}

/** `14:03:07.412`. */
export function clockTime(at: number): string {
  const d = new Date(at);
  const ms = String(d.getMilliseconds()).padStart(3, "0");
  return `${two(d.getHours())}:${two(d.getMinutes())}:${two(d.getSeconds())}.${ms}`;
}

const UNITS = {
  en: ["ms", "s", "min", "h", "d"],
  zh: ["毫秒", "秒", "分", "小时", "天"],
} as const;

/** A duration in the largest unit that fits. */
export function span(ms: number): string {
  const [milli, second, minute, hour, day] = UNITS[language()];
  if (ms < 1_000) return `${Math.round(ms)} ${milli}`;
  if (ms < 60_000) return `${round(ms / 1_000, ms < 10_000 ? 1 : 0)} ${second}`;
  if (ms < 3_600_000) return `${Math.round(ms / 60_000)} ${minute}`;
  if (ms < 86_400_000) return `${round(ms / 3_600_000, 1)} ${hour}`;
  return `${round(ms / 86_400_000, 1)} ${day}`;
}

export function round(n: number, decimals: number): string {
  return n.toFixed(decimals).replace(/\.0+$/, "");
}

export function percent(n: number): string {
  return `${round(n, n < 10 ? 1 : 0)} %`;
}

/** `10 (0Ah)`: manuals write addresses either way. */
export function addressText(address: number): string {
  return `${address} (${address.toString(16).toUpperCase().padStart(2, "0")}h)`;
}

/** An amount of bytes, in the unit that fits. */
export function bytes(n: number): string {
  const units = ["B", "kB", "MB", "GB", "TB"];
  let power = 0;
  for (; n >= 1_000 && power < units.length - 1; power++) n /= 1_000;
  return `${round(n, n < 10 && power > 0 ? 1 : 0)} ${units[power]}`;
}

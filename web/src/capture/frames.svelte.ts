// The frames of a line: the last 100,000, those that match a filter, and the filter's syntax.
import type { FrameRecord } from "../api/untyped";

export interface Numbered extends FrameRecord {
  n: number;
  /** Its time, in milliseconds since 1970. */
  at: number;
}

export const FRAMES_MOST = 100_000;
/** Old frames are dropped this many at a time, which amortises the cost. */
const CHUNK = 5_000;

/** ASCII frames as text, all else as hexadecimal digits. */
export function readable(frame: FrameRecord): string {
  if (frame.protocol !== "ascii") return frame.bytes;
  const letters = frame.bytes.split(" ").map((byte) => {
    const code = Number.parseInt(byte, 16);
    if (code === 13) return "<CR>";
    return code > 31 && code < 127 ? String.fromCharCode(code) : `<${byte}>`;
  });
  return letters.join("");
}

type Test = (frame: FrameRecord) => boolean;

/** `addr=3 and bad or missing`: words that must all match, alternatives separated by `or`. */
export function filterOf(text: string): Test {
  const ways = text.toLowerCase().split(/\s+or\s+/).map((way) => {
    const words = way.split(/\s+/).filter((word) => word && word !== "and");
    const tests: Test[] = [];
    let not = false;
    for (const word of words) {
      if (word === "not") {
        not = true;
        continue;
      }
      const test = word_(word);
      tests.push(not ? (frame) => !test(frame) : test);
      not = false;
    }
    return (frame: FrameRecord) => tests.every((test) => test(frame));
  });
  return (frame) => ways.some((way) => way(frame));
}

const VERDICTS = ["good", "refused", "bad", "unknown", "missing"];

function word_(word: string): Test {
  const [key, value = ""] = word.split("=");
  switch (key) {
    case "addr":
    case "address":
      return (frame) => frame.address === Number(value);
    case "proto":
    case "protocol":
      return (frame) => frame.protocol === value;
    case "module":
      return (frame) => frame.module === value;
    case "request":
    case "reply":
      return (frame) => frame.role === key;
    case "late":
      return (frame) => frame.late === true;
  }
  if (VERDICTS.includes(word)) return (frame) => frame.verdict === word;
  return (frame) => `${frame.meaning} ${frame.module} ${frame.bytes}`.toLowerCase().includes(word);
}

export class FrameLog {
  /** Incremented whenever there is something new to show. */
  version = $state(0);
  all: Numbered[] = [];
  shown: Numbered[] = [];
  /** How many frames the server dropped because this page was too slow. */
  dropped = $state(0);
  #next = 0;
  #test: Test = () => true;
  #due = false;

  add(frames: FrameRecord[]): void {
    for (const frame of frames) {
      const numbered = { ...frame, n: this.#next++, at: Date.parse(frame.time) };
      this.all.push(numbered);
      if (this.#test(numbered)) this.shown.push(numbered);
    }
    if (this.all.length >= FRAMES_MOST + CHUNK) this.#trim();
    this.#changed();
  }

  #trim(): void {
    this.all.splice(0, this.all.length - FRAMES_MOST);
    const first = this.all[0]?.n ?? 0;
    const keep = this.shown.findIndex((frame) => frame.n >= first);
    this.shown.splice(0, keep < 0 ? this.shown.length : keep);
  }

  /** At most once per animation frame. */
  #changed(): void {
    if (this.#due) return;
    this.#due = true;
    requestAnimationFrame(() => {
      this.#due = false;
      this.version += 1;
    });
  }

  filter(text: string): void {
    this.#test = filterOf(text);
    this.shown = this.all.filter(this.#test);
    this.#changed();
  }

  clear(): void {
    this.all = [];
    this.shown = [];
    this.dropped = 0;
    this.#changed();
  }
}

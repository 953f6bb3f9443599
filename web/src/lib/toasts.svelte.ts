// Short notices at the edge of the page. What failed stays until it is dismissed.
import { problem } from "./api";
import type { Problem } from "./types";

export interface Toast {
  id: number;
  kind: "good" | "bad";
  text: string;
  problem?: Problem;
  action?: { label: string; run: () => void };
}

const LASTS_MS = 4_000;
/** Older ones make room. */
const MOST = 4;

let next = 0;
const list = $state<Toast[]>([]);

export function toasts(): readonly Toast[] {
  return list;
}

export function dismiss(id: number): void {
  const at = list.findIndex((toast) => toast.id === id);
  if (at >= 0) list.splice(at, 1);
}

function add(toast: Omit<Toast, "id">): number {
  const id = next++;
  list.push({ ...toast, id });
  while (list.length > MOST) list.shift();
  return id;
}

/** Says that something was done. */
export function tell(text: string, action?: Toast["action"]): void {
  const id = add(action ? { kind: "good", text, action } : { kind: "good", text });
  setTimeout(() => dismiss(id), action ? LASTS_MS * 2 : LASTS_MS);
}

/** Says why something was not done. */
export function complain(thrown: unknown): void {
  const found = problem(thrown);
  const text = found.detail ?? found.title;
  // The same trouble again is the same notice.
  const same = list.find((toast) => toast.text === text);
  if (same) dismiss(same.id);
  add({ kind: "bad", text, problem: found });
}

// Short notices at the edge of the page. What failed stays until it is dismissed.
import { problemOf, onResponse } from "../api/client";
import type { Problem } from "../api/types";

export interface Toast {
  id: number;
  kind: "good" | "bad";
  text: string;
  problem?: Problem;
  /** What is so now, after a command. */
  verdict?: string;
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
export function notify(text: string, action?: Toast["action"]): void {
  const id = add(action ? { kind: "good", text, action } : { kind: "good", text });
  setTimeout(() => dismiss(id), action ? LASTS_MS * 2 : LASTS_MS);
}

/** Dialogs that are open, the foremost last: what fails in one is said in it, not behind it. */
const dialogs: ((problem: Problem) => void)[] = [];

/** Takes what is complained of, until the returned function is called. */
export function catchProblems(take: (problem: Problem) => void): () => void {
  dialogs.push(take);
  return () => void dialogs.splice(dialogs.indexOf(take), 1);
}

/** Says why something was not done, and for a command what is so now. */
export function showProblem(thrown: unknown, verdict?: string): void {
  const found = problemOf(thrown);
  const dialog = dialogs.at(-1);
  if (dialog && !verdict) return dialog(found);
  const text = found.detail ?? found.title;
  // The same trouble again is the same notice.
  const same = list.find((toast) => toast.text === text);
  if (same) dismiss(same.id);
  add({ kind: "bad", text, problem: found, ...(verdict && { verdict }) });
}

// That the daemon did not answer is said until it does.
onResponse(() => {
  for (const { id, problem } of [...list]) if (problem?.status === 0) dismiss(id);
});

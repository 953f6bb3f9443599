// The toasts. A failure stays until it is dismissed.
import { problemOf, onResponse } from "../api/client";
import type { Problem } from "../api/types";

export interface Toast {
  id: number;
  kind: "good" | "bad";
  text: string;
  problem?: Problem;
  /** The state of the output now, after a failed command. */
  verdict?: string;
  action?: { label: string; run: () => void };
}

const LASTS_MS = 4_000;
/** How many are shown; the oldest is dropped. */
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

/** Shows that something was done. */
export function notify(text: string, action?: Toast["action"]): void {
  const id = add(action ? { kind: "good", text, action } : { kind: "good", text });
  setTimeout(() => dismiss(id), action ? LASTS_MS * 2 : LASTS_MS);
}

/** The open dialogs, the topmost last: it shows problems itself, as a toast would be behind it. */
const dialogs: ((problem: Problem) => void)[] = [];

/** Sends problems to a dialog, until the returned function is called. */
export function catchProblems(take: (problem: Problem) => void): () => void {
  dialogs.push(take);
  return () => void dialogs.splice(dialogs.indexOf(take), 1);
}

/** Shows why something failed, and for a command the state of the output now. */
export function showProblem(thrown: unknown, verdict?: string): void {
  const found = problemOf(thrown);
  const dialog = dialogs.at(-1);
  if (dialog && !verdict) return dialog(found);
  const text = found.detail ?? found.title;
  // The same text is shown once.
  const same = list.find((toast) => toast.text === text);
  if (same) dismiss(same.id);
  add({ kind: "bad", text, problem: found, ...(verdict && { verdict }) });
}

// "The daemon does not answer" is dismissed when it does.
onResponse(() => {
  for (const { id, problem } of [...list]) if (problem?.status === 0) dismiss(id);
});

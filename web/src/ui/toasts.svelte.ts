// The toasts. A failure stays until it is dismissed.
import type { Failure } from "./failure";

export interface Toast {
  id: number;
  kind: "good" | "bad";
  text: string;
  failure?: Failure;
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

/** The open dialogs, the topmost last: it shows failures itself, as a toast would be behind it. */
const dialogs: ((failure: Failure) => void)[] = [];

/** Sends failures to a dialog, until the returned function is called. */
export function catchFailures(take: (failure: Failure) => void): () => void {
  dialogs.push(take);
  return () => void dialogs.splice(dialogs.indexOf(take), 1);
}

/** Shows why something failed, and for a command the state of the output now. */
export function showFailure(failure: Failure, verdict?: string): void {
  const dialog = dialogs.at(-1);
  if (dialog && !verdict) return dialog(failure);
  const text = failure.detail ?? failure.title;
  // The same text is shown once.
  const same = list.find((toast) => toast.text === text);
  if (same) dismiss(same.id);
  add({ kind: "bad", text, failure, ...(verdict && { verdict }) });
}

/** Dismisses failures that are over. */
export function dismissFailures(over: (failure: Failure) => boolean): void {
  for (const { id, failure } of [...list]) if (failure && over(failure)) dismiss(id);
}

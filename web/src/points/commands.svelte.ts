// Commands given from this page and how they ended, by point.
import { SvelteMap } from "svelte/reactivity";
import { t } from "../i18n/index.svelte";
import { post, problemOf, put } from "../api/client";
import { points, refresh } from "../api/live.svelte";
import { showProblem } from "../api/problems";
import type { PointInfo, Problem, Written } from "../api/types";

export type Command =
  | { state: "pending"; want: boolean }
  | { state: "confirmed"; how: Written["confirmed"]; ms: number }
  | { state: Verdict; problem: Problem };

/** How long the end of a command is shown: confirmed, or not. */
const CONFIRMED_MS = 4_000;
const TROUBLE_MS = 60_000;
/** The code of a write whose read-back differs. */
const NOT_VERIFIED = "E0601";

/** The state of the output after a command that did not succeed. */
export type Verdict = "failed" | "unknown" | "not_verified";

/** Without an answer the output may have been switched: that is unknown, not failed. */
export function verdictOf(problem: Problem): Verdict {
  if (problem.code === NOT_VERIFIED) return "not_verified";
  return (problem.may_have_acted ?? !problem.code) ? "unknown" : "failed";
}

const commands = new SvelteMap<string, Command>();

export function commandOf(path: string): Command | undefined {
  return commands.get(path);
}

const address = (path: string): string => `/points/${path.replace(".", "/")}`;

/** Switches an output. */
export function write(point: PointInfo, value: boolean): Promise<void> {
  const confirm = point.confirm ? { confirm: true } : {};
  return run(point, value, () => put<Written>(address(point.path), { value, ...confirm }));
}

/** Switches an output on for a while. */
export function pulse(point: PointInfo, ms?: number): Promise<void> {
  const confirm = point.confirm ? { confirm: true } : {};
  const wanted = ms === undefined ? confirm : { ms, ...confirm };
  return run(point, true, () => post<Written>(`${address(point.path)}/pulse`, wanted));
}

async function run(point: PointInfo, want: boolean, ask: () => Promise<Written>): Promise<void> {
  const { path } = point;
  if (commands.get(path)?.state === "pending") return;
  commands.set(path, { state: "pending", want });
  try {
    const done = await ask();
    const now = points.get(path);
    if (now && done.value !== null) {
      refresh({ ...now, value: done.value, quality: "good", time: new Date().toISOString(), age_ms: 0 });
    }
    show(path, { state: "confirmed", how: done.confirmed, ms: done.took_ms }, CONFIRMED_MS);
  } catch (thrown) {
    const problem = problemOf(thrown);
    const verdict = verdictOf(problem);
    show(path, { state: verdict, problem }, TROUBLE_MS);
    showProblem(problem, t(`verdict_${verdict}_why`));
  }
}

function show(path: string, end: Command, ms: number): void {
  commands.set(path, end);
  setTimeout(() => {
    if (commands.get(path) === end) commands.delete(path);
  }, ms);
}

// A resource of the API, fetched for as long as a component shows it.
import { get, problemOf } from "./client";
import { isUnseen, lostAt } from "./link.svelte";
import type { Problem } from "./types";

export interface Resource<T> {
  /** The last answer; it stays during a refetch. */
  readonly data: T | null;
  /** When that was asked for: it was so at some time since. */
  readonly asked: number;
  /** Why the last request failed. */
  readonly problem: Problem | null;
  readonly busy: boolean;
  refetch: () => Promise<void>;
}

const GONE = 404;

/** Fetches at once, again when the path changes, and every `every` milliseconds. */
export function resource<T>(path: () => string | null, every?: number): Resource<T> {
  let data = $state.raw<T | null>(null);
  let problem = $state.raw<Problem | null>(null);
  let busy = $state(false);
  let asked = $state(0);
  let turn = 0;
  const reachable = $derived(lostAt() === null);

  async function ask(what: string | null): Promise<void> {
    const mine = ++turn;
    if (what === null) return;
    busy = true;
    const since = Date.now();
    try {
      const answer = await get<T>(what);
      if (mine === turn) [data, problem, asked] = [answer, null, since];
    } catch (thrown) {
      if (mine === turn) problem = problemOf(thrown);
    } finally {
      if (mine === turn) busy = false;
    }
  }

  $effect(() => {
    const what = path();
    // While the daemon is unreachable the last answer stays; it is fetched again afterwards.
    if (!reachable) return;
    void ask(what);
    if (!every) return;
    const timer = setInterval(() => {
      // A 404 is not polled. Nor is a second request sent while one is open: a slow daemon would
      // otherwise use up the browser's few connections, which commands need.
      if (!busy && problem?.status !== GONE && !isUnseen()) void ask(what);
    }, every);
    return () => clearInterval(timer);
  });

  return {
    get data() {
      return data;
    },
    get asked() {
      return asked;
    },
    get problem() {
      return problem;
    },
    get busy() {
      return busy;
    },
    refetch: () => ask(path()),
  };
}

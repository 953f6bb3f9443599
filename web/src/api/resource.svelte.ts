// Something asked of the API for as long as a page shows it.
import { get, problemOf } from "./client";
import { lostAt } from "./live.svelte";
import type { Problem } from "./types";

export interface Resource<T> {
  /** The last answer; it stays while it is asked again. */
  readonly data: T | null;
  /** Why there is none. */
  readonly problem: Problem | null;
  readonly busy: boolean;
  refetch: () => Promise<void>;
}

const GONE = 404;

/** Asks at once, again when the path changes, and every so often. */
export function resource<T>(path: () => string | null, every?: number): Resource<T> {
  let data = $state.raw<T | null>(null);
  let problem = $state.raw<Problem | null>(null);
  let busy = $state(false);
  let turn = 0;
  const reachable = $derived(lostAt() === null);

  async function ask(what: string | null): Promise<void> {
    const mine = ++turn;
    if (what === null) return;
    busy = true;
    try {
      const answer = await get<T>(what);
      if (mine === turn) [data, problem] = [answer, null];
    } catch (thrown) {
      if (mine === turn) problem = problemOf(thrown);
    } finally {
      if (mine === turn) busy = false;
    }
  }

  $effect(() => {
    const what = path();
    // What was shown stays while nobody answers, and is asked for again when somebody does.
    if (!reachable) return;
    void ask(what);
    if (!every) return;
    const timer = setInterval(() => {
      // What is not there does not come by asking. And of a daemon that is slow, one question is open:
      // more would take the few connections that a browser has from what somebody does.
      if (!busy && problem?.status !== GONE) void ask(what);
    }, every);
    return () => clearInterval(timer);
  });

  return {
    get data() {
      return data;
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

// A long list, loaded page by page, newest first.
import { get, problemOf } from "./client";
import type { Page } from "./types";
import type { Problem } from "./types";

/** How many items the page keeps. For older ones there are the filter and the export. */
const MOST = 2_000;
const AT_ONCE = 50;

export interface Paged<T> {
  readonly items: T[];
  readonly next: string | null;
  readonly problem: Problem | null;
  readonly ready: boolean;
  more: () => Promise<void>;
  /** Loads what is new. */
  refetch: () => Promise<void>;
  replace: (id: string, item: T) => void;
}

/** The list at a path such as `/events?kind=write`; starts over when the path changes. */
export function pagedList<T extends { id: string }>(path: () => string): Paged<T> {
  let items = $state.raw<T[]>([]);
  let next = $state<string | null>(null);
  let problem = $state.raw<Problem | null>(null);
  let ready = $state(false);
  let turn = 0;

  async function ask(cursor: string | null): Promise<Page<T> | null> {
    const mine = turn;
    const what = path();
    const where = `${what}${what.includes("?") ? "&" : "?"}limit=${AT_ONCE}${cursor ? `&cursor=${encodeURIComponent(cursor)}` : ""}`;
    try {
      const page = await get<Page<T>>(where);
      if (mine !== turn) return null;
      problem = null;
      return page;
    } catch (thrown) {
      if (mine === turn) problem = problemOf(thrown);
      return null;
    } finally {
      if (mine === turn) ready = true;
    }
  }

  async function begin(): Promise<void> {
    turn += 1;
    const page = await ask(null);
    if (page) [items, next] = [page.items, page.next];
  }

  $effect(() => {
    path();
    void begin();
  });

  return {
    get items() {
      return items;
    },
    get next() {
      return items.length < MOST ? next : null;
    },
    get problem() {
      return problem;
    },
    get ready() {
      return ready;
    },
    async more() {
      const page = await ask(next);
      if (page) [items, next] = [[...items, ...page.items], page.next];
    },
    async refetch() {
      const page = await ask(null);
      if (!page) return;
      const known = new Set(page.items.map((item) => item.id));
      const overlap = items.some((item) => known.has(item.id));
      if (overlap) items = [...page.items, ...items.filter((item) => !known.has(item.id))].slice(0, MOST);
      else [items, next] = [page.items, page.next];
    },
    replace(id, item) {
      items = items.map((old) => (old.id === id ? item : old));
    },
  };
}

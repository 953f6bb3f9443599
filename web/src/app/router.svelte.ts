// The router: the path of the address says which page is shown. Links are plain links, which can
// be opened in a tab, copied and bookmarked; a click on one is handled in the page.

import { hrefOf, pageAt } from "../api/base";

export type Params = Record<string, string>;

/** The path of the page, as it would be at the site itself. */
const pathNow = (): string => pageAt(location.pathname) ?? "/";

const place = $state({ path: pathNow(), query: location.search, hash: location.hash });

/** The path shown now. */
export function path(): string {
  return place.path;
}

/** What follows the `?`. */
export function query(): URLSearchParams {
  return new URLSearchParams(place.query);
}

export function hash(): string {
  return place.hash;
}

/** Goes to another page. */
export function go(page: string, how: "push" | "replace" = "push"): void {
  if (how === "push") history.pushState(null, "", hrefOf(page));
  else history.replaceState(null, "", hrefOf(page));
  arrived();
  if (how === "push") scrollTo(0, 0);
}

function arrived(): void {
  place.path = pathNow();
  place.query = location.search;
  place.hash = location.hash;
}

/** The parameters where a path fits a pattern such as `/module/:name/:tab?`. */
export function match(pattern: string, path: string): Params | null {
  const want = pattern.split("/").filter(Boolean);
  const have = path.split("/").filter(Boolean);
  if (have.length > want.length) return null;
  const params: Params = {};
  for (const [at, part] of want.entries()) {
    const given = have[at];
    if (part.startsWith(":")) {
      if (given !== undefined) params[part.slice(1).replace("?", "")] = decodeURIComponent(given);
      else if (!part.endsWith("?")) return null;
    } else if (part !== given) {
      return null;
    }
  }
  return params;
}

function clicked(event: MouseEvent): void {
  const link = (event.target as Element | null)?.closest?.("a");
  const plain = event.button === 0 && !event.metaKey && !event.ctrlKey && !event.shiftKey && !event.altKey;
  if (!link || !plain || event.defaultPrevented || link.target || link.hasAttribute("download")) return;
  const url = new URL(link.href);
  const page = url.origin === location.origin ? pageAt(url.pathname) : null;
  if (page === null) return;
  event.preventDefault();
  go(page + url.search + url.hash);
}

/** Follows links and the browser's back and forward. */
export function follow(): void {
  addEventListener("click", clicked);
  addEventListener("popstate", arrived);
}

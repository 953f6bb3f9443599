// Where these pages are: those of a site at the root of its own daemon, or under `/s/SITE` at the
// centre of its fleet. Everywhere else addresses are written as at the site itself.

/** The name of the site, if these are its pages at its centre. */
export const farSite: string | null = /^\/s\/([^/]+)/.exec(location.pathname)?.[1] ?? null;

const base = farSite === null ? "" : `/s/${farSite}`;

/** The address here of a page or a route. */
export const hrefOf = (path: string): string => base + path;

/** The reverse: which page it is; none of these pages for an API, and for the pages of another site. */
export function pageAt(address: string): string | null {
  const path = address === base ? "/" : address.slice(base.length);
  return address.startsWith(base) && !/^\/(api|s)\/|^[^/]/.test(path) ? path : null;
}

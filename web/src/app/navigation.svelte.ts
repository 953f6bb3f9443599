// The pages that the user may open on this site.
import { farSite } from "../api/base";
import { may, currentSession } from "../access/session.svelte";
import type { Page } from "./pages";

/** Those that are listed in the rail. */
export function pagesShown(pages: readonly Page[]): Page[] {
  const simulated = currentSession()?.simulated ?? false;
  const is = (page: Page): boolean => !(page.near && farSite) && (simulated || !page.simulated);
  return pages.filter((page) => page.icon && may(page.role) && is(page));
}

// The pages that the user may open on this site.
import { may, currentSession } from "../access/session.svelte";
import { PAGES, type Page } from "./pages";

/** Those that are listed in the rail. */
export function pagesShown(): Page[] {
  const simulated = currentSession()?.simulated ?? false;
  return PAGES.filter((page) => page.icon && may(page.role) && (simulated || !page.simulated));
}

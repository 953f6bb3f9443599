// Which pages there are for who uses the page, on this site.
import { may, currentSession } from "../access/session.svelte";
import { PAGES, type Page } from "./pages";

/** Those with a place of their own in the rail. */
export function pagesShown(): Page[] {
  const simulated = currentSession()?.simulated ?? false;
  return PAGES.filter((page) => page.icon && may(page.role) && (simulated || !page.simulated));
}

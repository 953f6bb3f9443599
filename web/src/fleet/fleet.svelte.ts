// The state of the whole fleet: how many sites there are, and the centre's connection to its servers.
import { currentSession, may } from "../access/session.svelte";
import { get } from "../api/client";
import { lostAt, markHeard, STALE_AFTER_MS } from "../api/link.svelte";
import type { Resource } from "../api/resource.svelte";
import { clock } from "../lib/clock.svelte";
import type { FleetSites } from "../api/types";

/** How often pages ask the centre for what they show. */
export const LOOK_MS = 2_000;
/** How many sites are shown before more are asked for. */
export const PAGE = 100;
/** The status of what is not there. */
export const NOT_FOUND = 404;

let summary = $state.raw<FleetSites | null>(null);
let busy = false;

/** The counts of all sites, without the sites. */
export const fleetNow = (): FleetSites | null => summary;

/** Asks the centre, which also shows whether it is there. */
export async function look(): Promise<void> {
  if (busy) return;
  busy = true;
  // It was so at some time since, however long the answer takes.
  const since = Date.now();
  try {
    summary = await get<FleetSites>("/fleet/v1/sites?limit=0");
    markHeard(since);
  } catch {
    // The state of the connection shows it.
  } finally {
    busy = false;
  }
}

/** Whether an answer that was asked for at this time should have been followed by another one. */
export const isOld = (asked: number): boolean => Math.abs(clock() - asked) >= STALE_AFTER_MS;

/** Whether an answer that was asked for at this time says how it is now. */
export function isNow(asked: number, connection: FleetSites["connection"] | undefined): boolean {
  // Also not where the browser's clock was set back.
  return lostAt() === null && connection?.connected === true && !isOld(asked);
}

/** Looks again and again for what is not there: it may come. */
export function whileNone(found: Resource<unknown>): void {
  $effect(() => {
    if (found.problem?.status !== NOT_FOUND) return;
    const timer = setInterval(() => void found.refetch(), LOOK_MS);
    return () => clearInterval(timer);
  });
}

/** Whether the user may command sites. Who is limited to points of a site can't be held to them here. */
export const mayCommand = (): boolean => may("operator") && !currentSession()?.user?.points.length;

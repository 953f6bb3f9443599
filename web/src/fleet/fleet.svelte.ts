// The state of the whole fleet: how many sites there are, and the centre's connection to its servers.
import { get } from "../api/client";
import { lostAt, markHeard, STALE_AFTER_MS } from "../api/link.svelte";
import { clock } from "../lib/clock.svelte";
import type { FleetSites } from "../api/types";

/** How often pages ask the centre for what they show. */
export const LOOK_MS = 2_000;

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

/** Whether an answer that was asked for at this time says how it is now. */
export function isNow(asked: number, connection: FleetSites["connection"] | undefined): boolean {
  // Also not where the browser's clock was set back.
  return lostAt() === null && connection?.connected === true && Math.abs(clock() - asked) < STALE_AFTER_MS;
}

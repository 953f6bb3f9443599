// The state of the whole fleet: how many sites there are, and the centre's connection to its servers.
import { get } from "../api/client";
import { lostAt, markHeard } from "../api/link.svelte";
import type { FleetSites } from "../api/types";

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

/** Whether what is shown is what the sites say now. */
export const isHeard = (): boolean => lostAt() === null && summary?.connection.connected === true;

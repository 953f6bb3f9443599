// The state of the connection to the program that serves these pages: everything that is shown is
// as old as what was heard last.
import { farSite } from "./base";
import { clock } from "../lib/clock.svelte";

/** How often what has no socket is fetched. The way to a far site is a longer one. */
export const POLL_MS = farSite === null ? 1_000 : 2_000;

/** Silence after which everything shown is stale, even if the socket is still open. */
export const STALE_AFTER_MS = 5_000;

const link = $state({ open: false, everHeard: false, heard: Date.now(), retryAt: 0 });

export type LinkState = "live" | "connecting" | "reconnecting" | "stale";

/** The way to a far site may be a narrow one: nothing is fetched that nobody sees. */
export const isUnseen = (): boolean => farSite !== null && document.hidden;

/** Something was heard, or the answer to what was asked at this time. */
export function markHeard(since = Date.now()): void {
  link.heard = since;
  link.everHeard = true;
}

/** A socket was opened, which says by itself what is new; or it was closed. */
export function markOpen(open: boolean): void {
  link.open = open;
}

/** The next try to connect is in so many milliseconds. */
export function markRetry(ms: number): void {
  link.retryAt = Date.now() + ms;
}

export const isOpen = (): boolean => link.open;

/** For how long nothing was heard, in milliseconds. */
export const silence = (): number => Date.now() - link.heard;

/** The state of the connection, and the seconds to show with it. */
export function connection(): { state: LinkState; seconds: number } {
  const now = clock();
  // A clock that was set back says nothing of the time between: that counts as silence.
  const silent = Math.abs(now - link.heard);
  if (!link.everHeard) return { state: "connecting", seconds: 0 };
  if (silent < (link.open ? STALE_AFTER_MS : 2 * POLL_MS + 500)) return { state: "live", seconds: 0 };
  if (silent > STALE_AFTER_MS) return { state: "stale", seconds: Math.round(silent / 1_000) };
  return { state: "reconnecting", seconds: Math.max(0, Math.ceil((link.retryAt - now) / 1_000)) };
}

/** When the connection was lost, if it is: everything shown is from then. */
export function lostAt(): number | null {
  const { state } = connection();
  return state === "reconnecting" || state === "stale" ? link.heard : null;
}

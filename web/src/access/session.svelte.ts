// The user of the page, and what the daemon says about itself.
import { get, post, setCsrfToken, onSessionEnd } from "../api/client";
import type { Role, Session } from "../api/types";

const RANK: Record<Role, number> = { viewer: 0, operator: 1, engineer: 2, admin: 3 };

let session = $state.raw<Session | null>(null);
let down = $state(false);

export function currentSession(): Session | null {
  return session;
}

/** The daemon has not answered since the page was loaded. */
export function isDown(): boolean {
  return down;
}

/** Whether the user has at least this role. */
export function may(role: Role): boolean {
  const user = session?.user;
  return !!user && RANK[user.role] >= RANK[role];
}

/** Whether the user may switch this point. */
export function maySwitch(path: string): boolean {
  const points = session?.user?.points ?? [];
  return may("operator") && (points.length === 0 || points.some((pattern) => fits(pattern, path)));
}

/** Whether the user may switch only some points. */
export function isLimitedToPoints(): boolean {
  return !!session?.user?.points.length;
}

function fits(pattern: string, path: string): boolean {
  const parts = pattern.split("*").map((part) => part.replace(/[.+?^${}()|[\]\\]/g, "\\$&"));
  return new RegExp(`^${parts.join(".*")}$`).test(path);
}

export function setSession(next: Session): void {
  session = next;
  setCsrfToken(next.csrf);
}

export async function load(): Promise<void> {
  try {
    setSession(await get<Session>("/session"));
    down = false;
  } catch {
    down = session === null;
  }
}

export async function signOut(): Promise<void> {
  await post("/logout");
  await load();
}

onSessionEnd(() => {
  if (session?.user) session = { ...session, user: null, csrf: null };
});

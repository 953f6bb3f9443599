// Who uses the page, and what the daemon says of itself.
import { get, post, trust, whenEnded } from "../api/api";
import type { Role, Session } from "../api/types";

const RANK: Record<Role, number> = { viewer: 0, operator: 1, engineer: 2, admin: 3 };

let session = $state.raw<Session | null>(null);
let down = $state(false);

export function who(): Session | null {
  return session;
}

/** The daemon did not answer when the page came. */
export function isDown(): boolean {
  return down;
}

/** Whether who uses the page has at least this role. */
export function may(role: Role): boolean {
  const user = session?.user;
  return !!user && RANK[user.role] >= RANK[role];
}

/** Whether who uses the page may switch this point. */
export function maySwitch(path: string): boolean {
  const points = session?.user?.points ?? [];
  return may("operator") && (points.length === 0 || points.some((pattern) => fits(pattern, path)));
}

/** Whether who uses the page is limited to some points. */
export function whoIsLimited(): boolean {
  return !!session?.user?.points.length;
}

function fits(pattern: string, path: string): boolean {
  const parts = pattern.split("*").map((part) => part.replace(/[.+?^${}()|[\]\\]/g, "\\$&"));
  return new RegExp(`^${parts.join(".*")}$`).test(path);
}

export function enter(next: Session): void {
  session = next;
  trust(next.csrf);
}

export async function load(): Promise<void> {
  try {
    enter(await get<Session>("/session"));
    down = false;
  } catch {
    down = session === null;
  }
}

export async function leave(): Promise<void> {
  await post("/logout");
  await load();
}

whenEnded(() => {
  if (session?.user) session = { ...session, user: null, csrf: null };
});

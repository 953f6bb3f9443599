// What can be commanded of many sites at once.
import type { FleetBulkPreview } from "../api/types";

/** A request to the API of each site. */
export interface Order {
  method: string;
  path: string;
  body: object;
}

/** A command as it was looked at: it is given to these sites, once. */
export interface Looked extends Order {
  /** Its id, under which it is given: also if its answer is lost it can be found. */
  id: string;
  /** When the centre was asked for the sites. */
  asked: number;
  sites: FleetBulkPreview["sites"];
  sendable: number;
}

const KEY_LEN = 16;

/** An id that nobody else has. Pages over plain HTTP have no `randomUUID`. */
export const newId = (): string =>
  Array.from(crypto.getRandomValues(new Uint8Array(KEY_LEN)), (byte) => byte.toString(KEY_LEN).padStart(2, "0")).join("");

/** What is typed on a Chinese keyboard means the same. */
export const plain = (typed: string): string => typed.normalize("NFKC").trim();

/** To switch a point `oven.k1` or a group `@night` to a state; none if it is neither. */
export function orderOf(target: string, to: string): Order | null {
  const [, group, module, label] = /^(?:@([^@]+)|([^@.]+)\.(.+))$/.exec(target) ?? [];
  if (!to || !(group || label)) return null;
  const value = to === "toggle" ? to : to === "on";
  const part = encodeURIComponent;
  if (group) return { method: "POST", path: `/api/v1/groups/${part(group)}/set`, body: { value } };
  const path = `/api/v1/points/${part(module ?? "")}/${part(label ?? "")}`;
  return to === "toggle" ? { method: "POST", path: `${path}/toggle`, body: {} } : { method: "PUT", path, body: { value } };
}

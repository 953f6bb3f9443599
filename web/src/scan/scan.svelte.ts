// A scan: started, followed, cancelled; and adding what it found to the configuration.
import { language } from "../i18n/index.svelte";
import { patch, post } from "../api/client";
import { OperationTracker } from "../api/operation.svelte";
import { showProblem } from "../api/problems";
import type { Found, ScanRequest } from "../api/types";

/** A module's id in the configuration. */
export const NAME = /^[a-z][a-z0-9_]{0,31}$/;

export class Scan extends OperationTracker {
  async start(request: ScanRequest): Promise<void> {
    try {
      await this.follow((await post<{ op: string }>("/scans", request)).op);
    } catch (thrown) {
      showProblem(thrown);
    }
  }
}

export interface Chosen {
  found: Found;
  /** Its id in the configuration. */
  name: string;
  /** Its display name, in the language of the page. */
  called?: string;
  /** How many outputs it has, for boards that do not report it. */
  outputs?: number | undefined;
}

/** Adds new modules to the configuration, and gives known ones their new names. */
export async function adopt(chosen: Chosen[]): Promise<void> {
  for (const { found, name } of chosen) {
    if (found.name && found.name !== name) await patch(`/config/modules/${found.name}`, { rename: name });
  }
  const fresh = chosen.filter(({ found }) => !found.name);
  if (!fresh.length) return;
  const modules = fresh.map(({ found, name, called, outputs }) => {
    const { line, model, address, protocol, baud, format, checksum } = found;
    const more = { ...(called && { name: { [language()]: called } }), ...(outputs && { outputs }), ...(checksum && { checksum }) };
    return { module: name, line, model, address, protocol, baud, format, ...more };
  });
  await post("/config/modules", { modules });
}

// A scan: begun, followed, cancelled; and what it found put into the configuration.
import { get, patch, post, problem, remove } from "./api";
import { hear } from "./live.svelte";
import { complain } from "./toasts.svelte";
import type { Found, Operation } from "./types";

export interface Wish {
  lines: string[];
  depth: "quick" | "full" | "deep";
  protocols?: string[];
  addresses?: string;
}

/** Where no WebSocket tells of progress it is asked for this often. */
const ASK_MS = 1_000;

/** The name of a module as the configuration takes it. */
export const NAME = /^[a-z][a-z0-9_]{0,31}$/;

export class Scan {
  op = $state.raw<Operation>();
  running = $derived(this.op?.state === "running");
  #deaf: () => void = () => {};
  #timer: ReturnType<typeof setInterval> | undefined;

  async start(wish: Wish): Promise<void> {
    this.leave();
    try {
      const { op } = await post<{ op: string }>("/scans", wish);
      await this.#look(op);
      this.#deaf = hear(`ops/${op}`, (message) => this.#take(message["op"] ?? message.data));
      this.#timer = setInterval(() => void this.#look(op), ASK_MS);
    } catch (thrown) {
      complain(thrown);
    }
  }

  async #look(op: string): Promise<void> {
    try {
      this.#take(await get<Operation>(`/ops/${op}`));
    } catch (thrown) {
      // While the network is away it goes on; an operation that is unknown has ended.
      if (problem(thrown).status === 404) this.leave();
    }
  }

  #take(news: unknown): void {
    if (!news || typeof news !== "object" || !("state" in news)) return;
    this.op = news as Operation;
    if (this.op.state === "running") return;
    this.leave();
    if (this.op.error) complain(this.op.error);
  }

  async cancel(): Promise<void> {
    if (!this.op) return;
    try {
      await remove(`/ops/${this.op.op}`);
    } catch (thrown) {
      complain(thrown);
    }
  }

  /** Follows it no longer. */
  leave(): void {
    this.#deaf();
    clearInterval(this.#timer);
  }
}

export interface Chosen {
  found: Found;
  name: string;
}

/** Adds new modules to the configuration, and gives known ones their new names. */
export async function adopt(chosen: Chosen[]): Promise<void> {
  for (const { found, name } of chosen) {
    if (found.name && found.name !== name) await patch(`/config/modules/${found.name}`, { rename: name });
  }
  const fresh = chosen.filter(({ found }) => !found.name);
  if (!fresh.length) return;
  const modules = fresh.map(({ found, name }) => {
    const { line, model, address, protocol, baud, format, checksum } = found;
    return { name, line, model, address, protocol, baud, format, ...(checksum ? { checksum } : {}) };
  });
  await post("/config/modules", { modules });
}

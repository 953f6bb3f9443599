// A long-running operation, followed until it ends.
import { get, problemOf, remove } from "./client";
import { subscribe } from "./live.svelte";
import { showProblem } from "./problems";
import type { Operation } from "./types";

/** How often progress is polled, for where no WebSocket reports it. */
const ASK_MS = 1_000;

export class OperationTracker {
  op = $state.raw<Operation>();
  running = $derived(this.op?.state === "running");
  #unsubscribe: () => void = () => {};
  #timer: ReturnType<typeof setInterval> | undefined;

  async follow(op: string): Promise<void> {
    this.leave();
    await this.#look(op);
    if (this.op && !this.running) return;
    this.#unsubscribe = subscribe(`ops/${op}`, (message) => this.#take(message["op"] ?? message.data));
    this.#timer = setInterval(() => void this.#look(op), ASK_MS);
  }

  async #look(op: string): Promise<void> {
    try {
      this.#take(await get<Operation>(`/ops/${op}`));
    } catch (thrown) {
      // Network errors are ignored; an operation that is not known any more has ended.
      if (problemOf(thrown).status === 404) this.leave();
    }
  }

  #take(news: unknown): void {
    if (!news || typeof news !== "object" || !("state" in news)) return;
    this.op = news as Operation;
    if (this.op.state === "running") return;
    this.leave();
    this.ended(this.op);
  }

  /** Called once, when the operation has ended. */
  protected ended(op: Operation): void {
    if (op.error) showProblem(op.error);
  }

  async cancel(): Promise<void> {
    if (!this.op) return;
    try {
      await remove(`/ops/${this.op.op}`);
    } catch (thrown) {
      showProblem(thrown);
    }
  }

  /** Stops following. */
  leave(): void {
    this.#unsubscribe();
    clearInterval(this.#timer);
  }
}

// A change of a module's settings: planned, written, followed until it ends.
import { t } from "../i18n/index.svelte";
import { patch, post } from "../api/client";
import { OperationTracker } from "../api/operation.svelte";
import { showProblem } from "../api/problems";
import type { Operation, SettingsPlan } from "../api/types";

/** The name of a setting. */
export function settingName(name: string): string {
  const [point, mode] = name.split(".");
  if (mode === "mode") return t("set_mode", { point: point ?? "" });
  switch (name) {
    case "address":
    case "baud":
    case "parity":
    case "checksum":
    case "protocol":
    case "pulse_width":
    case "calibration_voltage":
      return t(`set_${name}`);
    default:
      return name;
  }
}

/** The text for a value that is a word. */
export function settingWord(value: string): string {
  switch (value) {
    case "none":
    case "even":
    case "odd":
    case "on":
    case "off":
    case "level":
    case "pulse":
      return t(`word_${value}`);
    default:
      return value;
  }
}

/** New values, or the undoing of a change. */
export type SettingsRequest = { set: Record<string, string> } | { undo: number };

export class Change extends OperationTracker {
  /** What the change would do, until it is started or dropped. */
  plan = $state.raw<SettingsPlan | null>(null);
  request = $state.raw<SettingsRequest | null>(null);
  busy = $state(false);
  readonly #path: string;
  readonly #done: () => void;

  constructor(module: string, done: () => void) {
    super();
    this.#path = `/modules/${module}/settings`;
    this.#done = done;
  }

  /** Asks for the plan (a dry run); nothing is written. */
  async prepare(request: SettingsRequest, etag: string): Promise<void> {
    await this.#attempt(async () => {
      this.plan = await this.#send<SettingsPlan>(request, etag, "?dry_run=1");
      this.request = request;
    });
  }

  /** Writes what was planned, provided the module's settings have not changed since. */
  async write(): Promise<void> {
    const { plan, request } = this;
    if (!plan || !request) return;
    await this.#attempt(async () => {
      const { op } = await this.#send<{ op: string }>(request, plan.etag, "");
      this.drop();
      await this.follow(op);
    });
  }

  drop(): void {
    this.plan = this.request = null;
  }

  #send<T>(request: SettingsRequest, etag: string, query: string): Promise<T> {
    const match = { "If-Match": `"${etag}"` };
    if ("set" in request) return patch(this.#path + query, request.set, match);
    return post(`${this.#path}/undo${query}`, { change: request.undo }, 0, match);
  }

  async #attempt(work: () => Promise<void>): Promise<void> {
    this.busy = true;
    try {
      await work();
    } catch (thrown) {
      showProblem(thrown);
    } finally {
      this.busy = false;
    }
  }

  /** A failure is shown where the change was made, not as a toast. */
  protected override ended(_op: Operation): void {
    this.#done();
  }
}

import type { Pair } from "./index.svelte";

export const demo = {} as const satisfies Record<string, Pair>;

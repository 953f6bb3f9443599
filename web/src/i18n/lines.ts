import type { Pair } from "./index.svelte";

export const lines = {} as const satisfies Record<string, Pair>;

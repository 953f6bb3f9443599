// The simulated lines and the real state of their modules, for as long as a page shows them.
import { SvelteMap } from "svelte/reactivity";
import { get } from "../api/client";
import { subscribe } from "../api/live.svelte";
import type { SimFaultInfo, SimLineInfo, SimModuleInfo } from "../api/types";
import { showProblem } from "../api/problems";

/** A fault, and when it ends by the clock of this page. */
export type SimFault = SimFaultInfo & { ends?: number };
export type SimModule = SimModuleInfo & { faults: SimFault[] };
export type SimLine = SimLineInfo & { faults: SimFault[]; modules: SimModule[] };

const timed = (faults: SimFault[]): SimFault[] =>
  faults.map((one) => (one.left_ms === undefined ? one : { ...one, ends: Date.now() + one.left_ms }));

/** All simulated lines, kept up to date over the WebSocket. */
export function simulated(): { readonly lines: SimLine[] } {
  const lines = new SvelteMap<string, SimLine>();

  /** A message contains only the modules that changed. */
  function take(news: SimLine): void {
    const fresh = new Map(news.modules.map((one) => [one.module, { ...one, faults: timed(one.faults) }]));
    const known = lines.get(news.line)?.modules ?? [...fresh.values()];
    const modules = known.map((one) => fresh.get(one.module) ?? one);
    lines.set(news.line, { ...news, faults: timed(news.faults), modules });
  }

  $effect(() => {
    let ends: (() => void)[] | null = [];
    get<{ lines: SimLine[] }>("/sim").then((all) => {
      for (const one of all.lines) {
        take(one);
        ends?.push(subscribe(`sim/${one.line}`, (message) => take((message.data ?? message.sim) as SimLine)));
      }
    }, showProblem);
    return () => {
      ends?.forEach((end) => end());
      ends = null;
    };
  });

  return {
    get lines() {
      return [...lines.values()];
    },
  };
}

// The datasheets of the models, fetched once for each language.
import { SvelteMap } from "svelte/reactivity";
import type { ModelSheet } from "./types";

const sheets = new SvelteMap<string, ModelSheet>();

export function setModels(all: ModelSheet[]): void {
  for (const one of all) sheets.set(one.model, one);
}

/** The datasheet of a model; undefined until it is fetched. */
export const modelOf = (model: string | null | undefined): ModelSheet | undefined => (model ? sheets.get(model) : undefined);

// The pages of a centre, in one file: what they share is more than what each has of its own.
export { default as Config } from "./Config.svelte";
export { default as Commands } from "./Commands.svelte";
export { default as Order } from "./Order.svelte";
export { default as Site } from "./Site.svelte";
export { default as Sites } from "./Sites.svelte";
export { default as Switch } from "./Switch.svelte";

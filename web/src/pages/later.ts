// Every page but the first, in one file: what is alike in them is packed once, which saves a sixth
// of the whole.
import { more } from "../i18n/index.svelte";
import { later } from "../i18n/later";
export { default as Api } from "./Api.svelte";
export { default as Backup } from "./Backup.svelte";
export { default as Discover } from "./Discover.svelte";
export { default as Events } from "./Events.svelte";
export { default as Groups } from "./Groups.svelte";
export { default as Integrations } from "./Integrations.svelte";
export { default as Lines } from "./Lines.svelte";
export { default as Module } from "./Module.svelte";
export { default as Rules } from "./Rules.svelte";
export { default as Scope } from "./Scope.svelte";
export { default as Simulator } from "./Simulator.svelte";
export { default as System } from "./System.svelte";
export { default as Trends } from "./Trends.svelte";
export { default as Users } from "./Users.svelte";

more(later);

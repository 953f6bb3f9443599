// The table of pages. What is not in it does not exist: the rail, the bottom bar, the search and
// the router are all made of it. A page is loaded when it is first shown.
import type { Component } from "svelte";
import type { IconName } from "../components/icons";
import type { Key } from "../i18n/index.svelte";
import type { Role } from "../lib/types";

export interface Page {
  /** The address, as `/module/:name/:tab?`; its parameters become properties of the component. */
  path: string;
  title: Key;
  load: () => Promise<{ default: Component<any> }>;
  /** Its picture in the rail; pages without one are reached through others. */
  icon?: IconName;
  /** The group in the rail: the first is what is used daily. */
  group?: 0 | 1 | 2;
  /** The least role that may use it. */
  role: Role;
  /** Stands in the bottom bar of phones, which holds four. */
  daily?: true;
  /** Only where a line is simulated. */
  simulated?: true;
}

export const PAGES: readonly Page[] = [
  { path: "/", title: "nav_overview", load: () => import("./Overview.svelte"), icon: "overview", group: 0, role: "viewer", daily: true },
  { path: "/module/:name/:tab?", title: "module", load: () => import("./Module.svelte"), role: "viewer" },
  { path: "/lines", title: "nav_lines", load: () => import("./Lines.svelte"), icon: "lines", group: 0, role: "viewer", daily: true },
  { path: "/lines/:name/scope", title: "scope", load: () => import("./Scope.svelte"), role: "viewer" },
  { path: "/discover", title: "nav_discover", load: () => import("./Discover.svelte"), icon: "discover", group: 0, role: "engineer" },
  { path: "/trends", title: "nav_trends", load: () => import("./Trends.svelte"), icon: "trends", group: 0, role: "viewer", daily: true },
  { path: "/events/:tab?", title: "nav_events", load: () => import("./Events.svelte"), icon: "events", group: 0, role: "viewer", daily: true },
  { path: "/groups", title: "nav_groups", load: () => import("./Groups.svelte"), icon: "groups", group: 0, role: "viewer" },
  { path: "/backup", title: "nav_backup", load: () => import("./Backup.svelte"), icon: "backup", group: 2, role: "engineer" },
  {
    path: "/integrations",
    title: "nav_integrations",
    load: () => import("./Integrations.svelte"),
    icon: "plug",
    group: 2,
    role: "viewer",
  },
  { path: "/users", title: "nav_users", load: () => import("./Users.svelte"), icon: "users", group: 2, role: "admin" },
  { path: "/system", title: "nav_system", load: () => import("./System.svelte"), icon: "system", group: 2, role: "viewer" },
  { path: "/reference", title: "nav_api", load: () => import("./Api.svelte"), icon: "api", group: 2, role: "viewer" },
  {
    path: "/simulator",
    title: "nav_sim",
    load: () => import("./Simulator.svelte"),
    icon: "sim",
    group: 2,
    role: "engineer",
    simulated: true,
  },
];

// The table of pages, from which rail, bottom bar, search and router are made. Pages other than
// the first are loaded when they are opened.
import type { Component } from "svelte";
import type { IconName } from "../ui/icons";
import type { Key } from "../i18n/index.svelte";
import type { Role } from "../api/types";

export interface Page {
  /** The address, as `/module/:name/:tab?`; its parameters become properties of the component. */
  path: string;
  title: Key;
  load: () => Promise<{ default: Component<any> }>;
  /** Its icon in the rail; pages without one are reached through others. */
  icon?: IconName;
  /** The group in the rail: the first is what is used daily. */
  group?: 0 | 1 | 2;
  /** The lowest role that may open it. */
  role: Role;
  /** Shown in the bottom bar of phones, which holds four. */
  daily?: true;
  /** Only where a line is simulated. */
  simulated?: true;
  /** Only at the site itself, not at the centre of its fleet. */
  near?: true;
}

const later = (name: keyof typeof import("./later")) => async () => ({ default: (await import("./later"))[name] });

export const PAGES: readonly Page[] = [
  { path: "/", title: "nav_overview", load: () => import("../modules/Overview.svelte"), icon: "overview", group: 0, role: "viewer", daily: true },
  { path: "/module/:name/:tab?", title: "module", load: later("Module"), role: "viewer" },
  { path: "/lines", title: "nav_lines", load: later("Lines"), icon: "lines", group: 0, role: "viewer", daily: true },
  { path: "/lines/:name/scope", title: "scope", load: later("Scope"), role: "viewer", near: true },
  { path: "/discover", title: "nav_discover", load: later("Discover"), icon: "discover", group: 0, role: "engineer" },
  { path: "/trends", title: "nav_trends", load: later("Trends"), icon: "trends", group: 0, role: "viewer", daily: true },
  { path: "/events/:tab?", title: "nav_events", load: later("Events"), icon: "events", group: 0, role: "viewer", daily: true },
  { path: "/groups", title: "nav_groups", load: later("Groups"), icon: "groups", group: 0, role: "viewer" },
  { path: "/rules", title: "nav_rules", load: later("Rules"), icon: "rules", group: 0, role: "viewer" },
  { path: "/backup", title: "nav_backup", load: later("Backup"), icon: "backup", group: 2, role: "engineer" },
  {
    path: "/integrations",
    title: "nav_integrations",
    load: later("Integrations"),
    icon: "plug",
    group: 2,
    role: "viewer",
    near: true,
  },
  { path: "/users", title: "nav_users", load: later("Users"), icon: "users", group: 2, role: "admin" },
  { path: "/system", title: "nav_system", load: later("System"), icon: "system", group: 2, role: "viewer" },
  { path: "/reference", title: "nav_api", load: later("Api"), icon: "api", group: 2, role: "viewer" },
  {
    path: "/simulator",
    title: "nav_sim",
    load: later("Simulator"),
    icon: "sim",
    group: 2,
    role: "viewer",
    simulated: true,
    near: true,
  },
];

// The pages of a centre. The pages of a site are the site's own, at `/s/SITE/`.
import type { Page } from "../app/pages";

export const FLEET_PAGES: readonly Page[] = [
  { path: "/", title: "fleet_sites", load: () => import("./Sites.svelte"), icon: "overview", group: 0, role: "viewer", daily: true },
  { path: "/sites/:name", title: "fleet_site", load: () => import("./Site.svelte"), role: "viewer" },
  { path: "/commands", title: "fleet_commands", load: () => import("./Commands.svelte"), icon: "events", group: 0, role: "viewer", daily: true },
  {
    path: "/users",
    title: "nav_users",
    load: async () => ({ default: (await import("../app/later")).Users }),
    icon: "users",
    group: 1,
    role: "admin",
    daily: true,
  },
];

// The pages of a centre. The pages of a site are the site's own, at `/s/SITE/`.
import type { Page } from "../app/pages";

const later = (name: keyof typeof import("./later")) => async () => ({ default: (await import("./later"))[name] });

export const FLEET_PAGES: readonly Page[] = [
  { path: "/", title: "fleet_sites", load: later("Sites"), icon: "overview", group: 0, role: "viewer", daily: true },
  { path: "/sites/:name", title: "fleet_site", load: later("Site"), role: "viewer" },
  { path: "/sites/:name/config", title: "fleet_config", load: later("Config"), role: "engineer" },
  { path: "/switch", title: "fleet_switch", load: later("Switch"), role: "operator" },
  { path: "/commands", title: "fleet_commands", load: later("Commands"), icon: "events", group: 0, role: "viewer", daily: true },
  { path: "/commands/:name", title: "fleet_commands", load: later("Order"), role: "viewer" },
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

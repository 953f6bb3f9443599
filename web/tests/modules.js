// The page's own modules for tests, made by the tool that builds the page.
import { createServer } from "vite";
import { fileURLToPath } from "node:url";

const root = fileURLToPath(new URL("..", import.meta.url));

/** Loads modules of `src` by their paths; `close` ends it. */
export async function modules(...paths) {
  const vite = await createServer({
    root,
    configFile: false,
    logLevel: "error",
    appType: "custom",
    server: { middlewareMode: true, hmr: false, ws: false, watch: null },
    optimizeDeps: { noDiscovery: true },
  });
  const found = await Promise.all(paths.map((path) => vite.ssrLoadModule(`/src/${path}`)));
  return { found, close: () => vite.close() };
}

import { svelte } from "@sveltejs/vite-plugin-svelte";
import { defineConfig } from "vite";

// Where `npm run dev` finds a running daemon.
const daemon = process.env["RAILBUS_URL"] ?? "http://127.0.0.1:7485";

export default defineConfig({
  plugins: [svelte()],
  build: {
    target: "es2022",
    // The page's policy allows no `data:` addresses.
    assetsInlineLimit: 0,
    cssCodeSplit: false,
    modulePreload: false,
    // Says which files belong to which page: the budget is reckoned by it.
    manifest: "manifest.json",
    reportCompressedSize: false,
  },
  server: { proxy: { "/api": { target: daemon, changeOrigin: true, ws: true } } },
});

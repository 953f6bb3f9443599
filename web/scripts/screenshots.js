// The pictures of the README, of the real program with its demo line: `cargo xtask screenshots`.
import { mkdirSync } from "node:fs";
import { join } from "node:path";
import { fileURLToPath } from "node:url";
import { browse, open, serve } from "../tests/daemon.js";

const folder = fileURLToPath(new URL("../../docs/screenshots/", import.meta.url));

/** What is shown, to whom, and where. */
const PICTURES = [
  { name: "overview-en", path: "/", lang: "en", width: 1280, scheme: "light" },
  { name: "overview-zh", path: "/", lang: "zh", width: 1280, scheme: "light" },
  { name: "phone-zh", path: "/", lang: "zh", width: 360, scheme: "dark" },
  { name: "trends-en", path: "/trends?for=60&points=tank.ai1,pump.do0,oven.k1", lang: "en", width: 1280, scheme: "dark" },
  { name: "scope-en", path: "/lines/main/scope", lang: "en", width: 1280, scheme: "light" },
];
/** So long something happens before it is shown. */
const HAPPENS_MS = 8_000;

const daemon = await serve();
const browser = await browse();
const password = "correct horse battery";
mkdirSync(folder, { recursive: true });

/** Somebody who has logged in. */
async function logged_in(look, first) {
  const { context, page } = await open(browser, look);
  const key = new URL(daemon.link).hash.replace("#k=", "");
  const ask = first
    ? ["setup", { key, name: "li", password, lang: look.lang }]
    : ["login", { name: "li", password }];
  const answer = await context.request.post(`${daemon.origin}/api/v1/${ask[0]}`, { data: ask[1] });
  if (!answer.ok()) throw new Error(`${ask[0]}: ${answer.status()} ${await answer.text()}`);
  return { context, page, csrf: (await answer.json()).csrf };
}

try {
  const first = await logged_in(PICTURES[0], true);
  const headers = { "X-CSRF-Token": first.csrf };
  for (const path of ["pump/do0", "oven/k1", "oven/k3"]) {
    const data = { value: true };
    await first.context.request.put(`${daemon.origin}/api/v1/points/${path}`, { data, headers });
    await first.page.waitForTimeout(HAPPENS_MS / 4);
  }
  await first.context.close();
  for (const picture of PICTURES) {
    const { context, page } = await logged_in(picture, false);
    await page.goto(daemon.origin + picture.path);
    await page.waitForTimeout(HAPPENS_MS);
    await page.screenshot({ path: join(folder, `${picture.name}.png`) });
    console.log(`docs/screenshots/${picture.name}.png`);
    await context.close();
  }
} finally {
  await browser.close();
  await daemon.stop();
}

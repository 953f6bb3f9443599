// Every page in both languages, on a phone and on a desk, light and dark.
import assert from "node:assert/strict";
import { test } from "node:test";
import { faults, LOOKS, open, PASSWORD } from "./daemon.js";
import { browser, cookies, daemon } from "./site.js";

const PAGES = [
  "/",
  "/module/pump",
  "/module/tank",
  "/module/pump/trend",
  "/module/pump/about",
  "/module/pump/frames",
  "/lines",
  "/lines/main/scope",
  "/discover",
  "/trends",
  "/groups",
  "/events",
  "/events/audit",
  "/module/tank/trend",
  "/rules",
  "/backup",
  "/integrations",
  "/users",
  "/system",
  "/reference",
  "/simulator",
  "/no/such/page",
];

for (const look of LOOKS) {
  test(`pages: ${look.lang} ${look.width} ${look.scheme}`, async () => {
    const { context, page, wrong } = await open(browser, look);
    await context.addCookies(cookies);
    for (const path of PAGES) {
      await page.goto(daemon.origin + path);
      await page.locator("main h1").waitFor();
      // Values have come, and so has the first answer of what is asked again and again.
      await page.locator(".connection.live").waitFor({ state: "attached" });
      await page.waitForLoadState("networkidle");
      wrong.push(...(await faults(page)).map((fault) => `${path} ${fault}`));
    }
    assert.deepEqual(wrong, []);
    await context.close();
  });
}

test("signing in: a wrong password is told, the right one opens the site", async () => {
  const { context, page } = await open(browser, LOOKS[0]);
  await page.goto(`${daemon.origin}/lines`);
  await page.locator("#name").fill("admin");
  await page.locator("#password").fill("wrong password");
  assert.deepEqual(await faults(page), []);
  await page.locator("form button").click();
  await page.locator(".fault", { hasText: /\S/ }).waitFor();
  await page.locator("#password").fill(PASSWORD);
  await page.locator("form button").click();
  await page.locator("main h1", { hasText: "Lines" }).waitFor();
  await context.close();
});

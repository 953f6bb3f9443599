// A 0x55 board that has fewer relays than its configuration says: the pages pass on what the daemon
// makes of a channel that stays silent while the board answers.
import assert from "node:assert/strict";
import { test } from "node:test";
import { open } from "./daemon.js";
import { browser, cookies, csrf, daemon } from "./site.js";

const HINTS = {
  en: "the board answers, but not for k20: does it have that many relays? See outputs of yard",
  zh: "此板有应答，但 k20 无响应：是否有这么多路继电器？请核对 yard 的 outputs",
};

for (const [lang, hint] of Object.entries(HINTS)) {
  test(`a silent channel of a board that answers: ${lang}`, async () => {
    const { context, page } = await open(browser, { lang, width: 1280, scheme: "light" });
    await context.addCookies(cookies);
    const many = (outputs) =>
      context.request.patch(`${daemon.origin}/api/v1/config/modules/yard`, { data: { outputs }, headers: { "X-CSRF-Token": csrf } });
    assert.ok((await many(32)).ok());
    try {
      await page.goto(`${daemon.origin}/module/yard`);
      await page.getByRole("switch", { name: "yard.k20", exact: true }).click();
      const told = page.locator(".toast");
      await told.waitFor();
      assert.ok((await told.innerText()).includes(hint), await told.innerText());
    } finally {
      await many(8);
      await context.close();
    }
  });
}

// Many modules: a table with what is worst first, sorted and filtered, measured at every width.
import assert from "node:assert/strict";
import { test } from "node:test";
import { faults, open, words } from "./daemon.js";
import { misplaced } from "./geometry.js";
import { browser, cookies, csrf, daemon } from "./site.js";

for (const lang of ["en", "zh"]) {
  test(`the overview as a table: ${lang}`, async () => {
    const t = words(lang);
    const { context, page, wrong } = await open(browser, { lang, width: 1280, scheme: "light" });
    await context.addCookies(cookies);
    const power = (powered) =>
      context.request.put(`${daemon.origin}/api/v1/sim/main/tank`, { data: { powered }, headers: { "X-CSRF-Token": csrf } });
    assert.ok((await power(false)).ok());
    try {
      await page.goto(daemon.origin);
      await page.getByRole("button", { name: t("as_list"), exact: true }).click();
      const rows = page.locator("tbody tr");
      await rows.first().filter({ hasText: "tank" }).locator(".tag.bad").waitFor();
      assert.equal(await rows.first().locator("td").nth(3).innerText(), "?", "what is not known is no number");
      await page.getByRole("button", { name: t("module"), exact: true }).click();
      await rows.first().filter({ hasText: "gate" }).waitFor();
      for (const width of [360, 768, 1280, 1920]) {
        await page.setViewportSize({ width, height: 800 });
        assert.deepEqual(await misplaced(page), [], `${width}`);
        assert.deepEqual(await faults(page), [], `${width}`);
        if (process.env.SHOTS) await page.screenshot({ path: `${process.env.SHOTS}/table-${lang}-${width}.png` });
      }
      await page.getByLabel(t("filter_modules")).fill("oven");
      await page.waitForFunction(() => document.querySelectorAll("tbody tr").length === 1);
      // It is remembered.
      await page.reload();
      await rows.nth(4).waitFor();
      assert.deepEqual(wrong, []);
    } finally {
      await power(true);
      await context.close();
    }
  });
}

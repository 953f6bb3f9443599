// The theme: it is changed at once where no motion is wanted, down to the last cell of a table.
import assert from "node:assert/strict";
import { test } from "node:test";
import { open } from "./daemon.js";
import { browser, cookies, daemon } from "./site.js";

test("a theme is worn at once", async () => {
  const { context, page, wrong } = await open(browser, { lang: "en", width: 1280, scheme: "light" });
  await context.addCookies(cookies);
  try {
    await page.goto(daemon.origin);
    await page.locator("main button[role=switch]").nth(20).waitFor();
    const late = await page.evaluate(() => {
      const plain = [...document.querySelectorAll("main *")].filter(
        (one) => getComputedStyle(one).color === getComputedStyle(document.documentElement).color,
      );
      document.documentElement.dataset.theme = "dark";
      const probe = document.body.appendChild(document.createElement("i"));
      probe.style.color = "var(--ink)";
      const ink = getComputedStyle(probe).color;
      return { plain: plain.length, late: plain.filter((one) => getComputedStyle(one).color !== ink).length };
    });
    assert.ok(late.plain > 20, "there is text of the page's own colour");
    assert.equal(late.late, 0, "nothing keeps the colour of the theme before");
    assert.deepEqual(wrong, []);
  } finally {
    await context.close();
  }
});

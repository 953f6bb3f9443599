// What a new user does with the link that the daemon prints: language, password, scan, names,
// and then a relay is switched and seen to be confirmed. Nothing is edited by hand.
import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import { browse, faults, LOOKS, open, PASSWORD, PATIENCE_MS, serve, words } from "./daemon.js";

let browser;
before(async () => (browser = await browse()));
after(() => browser?.close());

for (const look of LOOKS) {
  test(`setup: ${look.lang} ${look.width} ${look.scheme}`, async () => {
    const daemon = await serve();
    const { context, page, wrong } = await open(browser, look);
    const t = words(look.lang);
    const press = (key) => page.getByRole("button", { name: t(key), exact: true }).click();
    const sound = async (where) => assert.deepEqual(await faults(page), [], where);
    try {
      await page.goto(daemon.link);
      await page.getByRole("button", { name: look.lang === "zh" ? "中文" : "English", exact: true }).last().click();
      await sound("language");
      await press("next");
      await page.locator("#admin").waitFor();
      await sound("password");
      await page.getByLabel(t("password"), { exact: true }).fill(PASSWORD);
      await press("next");
      await page.getByText(/main/).first().waitFor();
      await sound("line");
      await press("next");
      await press("scan_start");
      const ends = ["op_done", "op_cancelled", "op_failed"].map(t);
      const end = page.getByText(new RegExp(`^(${ends.join("|")})$`));
      // It asks every address, and waits for each that is silent.
      await end.waitFor({ timeout: 4 * PATIENCE_MS }).catch(async (error) => {
        throw new Error(`the scan does not end: ${await page.locator("main").innerText()}`, { cause: error });
      });
      assert.equal(await end.innerText(), t("op_done"));
      const pump = page.locator("li", { hasText: "EDA9060A" }).getByRole("textbox");
      await pump.fill("pump_house");
      await sound("scan");
      await press("next");
      await page.getByText(t("setup_done")).waitFor();
      await sound("done");
      await page.getByRole("link", { name: t("nav_overview") }).click();

      const relay = page.getByRole("switch", { name: /^pump_house\.do0/ });
      await relay.waitFor();
      assert.equal(await relay.getAttribute("aria-checked"), "false");
      // Watched for from before, and in the page: a good end is shown for a few seconds only.
      const ended = page.waitForFunction(() => document.querySelector(".outcome > span")?.textContent);
      await relay.click();
      assert.match(await (await ended).jsonValue(), new RegExp(`^\\s*${t("confirmed_readback")}`));
      assert.equal(await relay.getAttribute("aria-checked"), "true");
      assert.match(await relay.innerText(), new RegExp(t("on")));
      await sound("overview");
      await page.goto(`${daemon.origin}/events/audit`);
      await page.locator('td[title="do0=on"]', { hasText: t("on") }).first().waitFor();
      await sound("audit");
      await page.goto(`${daemon.origin}/trends?points=pump_house.do0`);
      await page.locator("canvas").first().waitFor();
      const past = await context.request.get(`${daemon.origin}/api/v1/history?point=pump_house.do0`);
      assert.match(await past.text(), /"v":1/, "the switching is in the history");
      await sound("trend");

      assert.deepEqual(wrong, []);
      assert.ok(!page.url().includes("#k="), "the key does not stay in the address");
    } finally {
      await context.close();
      await daemon.stop();
    }
  });
}

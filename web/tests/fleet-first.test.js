// The first evening with a fleet, from nothing and as the guide says: keys, three servers, a centre, two
// sites that are invited. Then, in one tab of the centre, the first user, a relay of the second site, its past.
import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import { browse, faults, foundFleet, LOOKS, open, PASSWORD, serve, until, words } from "./daemon.js";

/** How long all of it may take. */
const FIRST_MS = 10 * 60_000;

const began = Date.now();
let fleet, browser, cookies;
const sites = [];

before(async () => {
  fleet = await foundFleet();
  browser = await browse();
  for (const name of ["plant1", "plant2"]) {
    const site = await serve();
    sites.push(site);
    await fleet.invite(name, site);
  }
});

after(async () => {
  await browser?.close();
  for (const site of sites) await site.stop();
  await fleet?.stop();
});

/** A relay as the site itself has it. */
const isOn = async () => (await sites[1].owner("GET", "/points/oven/k3")).value;

for (const [at, look] of LOOKS.entries()) {
  test(`from the link to a relay of the second site and its past: ${look.lang} ${look.width} ${look.scheme}`, async () => {
    const { context, page, wrong } = await open(browser, look);
    const t = words(look.lang);
    const press = (key) => page.getByRole("button", { name: t(key), exact: true }).click();
    const sound = async (where) => assert.deepEqual(await faults(page), [], where);
    try {
      if (at === 0) {
        await page.goto(fleet.link);
        await press("next");
        await page.locator("#admin").waitFor();
        await page.getByLabel(t("password"), { exact: true }).fill(PASSWORD);
        await sound("password");
        await press("next");
      } else {
        await context.addCookies(cookies);
        await page.goto(fleet.origin);
      }
      const open2 = page.getByRole("link", { name: `${t("fleet_open")} plant2`, exact: true });
      await open2.waitFor();
      cookies ??= await context.cookies();
      await sound("sites");
      await open2.click();

      const relay = page.getByRole("switch", { name: /^oven\.k3/ });
      await relay.waitFor();
      const before = await isOn();
      // It may show what was so before the last look.
      await page.locator(`button.switch[aria-label^="oven.k3"][aria-checked="${before}"]`).waitFor();
      const ended = page.waitForFunction(() => document.querySelector(".outcome > span")?.textContent);
      await relay.click();
      assert.match(await (await ended).jsonValue(), new RegExp(`^\\s*${t("confirmed_readback")}`));
      assert.equal(await isOn(), !before, "the relay of the second site");
      await sound("the site");

      await page.goto(`${fleet.origin}/s/plant2/trends?points=oven.k3&for=600`);
      await page.locator("canvas").first().waitFor();
      const past = async () => (await context.request.get(`${fleet.origin}/s/plant2/api/v1/history?point=oven.k3`)).text();
      await until(async () => (await past()).includes(`"v":${before ? 0 : 1}`));
      await page.locator("tbody tr", { hasText: "oven.k3" }).waitFor();
      await sound("its past");
      assert.deepEqual(wrong, []);
      assert.ok(Date.now() - began < FIRST_MS, `${Math.round((Date.now() - began) / 1_000)} s`);
    } finally {
      await context.close();
    }
  });
}

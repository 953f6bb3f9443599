// The configuration of a far site on the pages of a centre, with a real fleet: what the site has is
// shown, what can't be is refused with its place, and how far the rest is, is said as it is.
import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import { browse, faults, LOOKS, open, PATIENCE_MS, serveFleet, setUp, until, words } from "./daemon.js";
import { misplaced } from "./geometry.js";

const WIDTHS = [360, 768, 1280, 1920];
/** Takes its configuration from the centre; as does `plant2`, and `plant3` does not. */
const SITE = "plant1";

let fleet, browser, cookies, csrf;

before(async () => {
  fleet = await serveFleet();
  browser = await browse();
  ({ cookies, csrf } = await setUp(browser, fleet));
});

after(async () => {
  await browser?.close();
  await fleet?.stop();
});

async function visitor(look) {
  const { context, page, wrong } = await open(browser, look);
  await context.addCookies(cookies);
  const t = words(look.lang);
  const say = (key, gaps) => t(key).replace(/\{(\w+)\}/g, (_, name) => String(gaps[name]));
  return { context, page, wrong, t, say };
}

const shot = (page, name) => process.env.SHOTS && page.screenshot({ path: `${process.env.SHOTS}/config-${name}.png`, fullPage: true });

const state = async (context, site = SITE) => (await (await context.request.get(`${fleet.origin}/fleet/v1/sites/${site}/config`)).json()).state;

async function send(page, t, text) {
  const field = page.getByRole("textbox", { name: t("config_text") });
  await field.fill(text);
  await page.getByRole("button", { name: t("fleet_config_send"), exact: true }).click();
  await page.getByRole("dialog").getByRole("button", { name: t("fleet_config_send"), exact: true }).click();
}

for (const look of LOOKS) {
  test(`a configuration is looked at, and a wrong one is refused: ${look.lang} ${look.width} ${look.scheme}`, async () => {
    const { context, page, wrong, t, say } = await visitor(look);
    try {
      await page.goto(`${fleet.origin}/sites/${SITE}`);
      await page.getByRole("link", { name: t("fleet_config"), exact: true }).click();
      await page.waitForURL(`${fleet.origin}/sites/${SITE}/config`);
      const field = page.getByRole("textbox", { name: t("config_text") });
      await field.waitFor();
      const text = await field.inputValue();
      assert.match(text, /\[module\.oven\]/);
      assert.doesNotMatch(text, /\[outlet/, "what is the site's own is not shown");
      const button = page.getByRole("button", { name: t("fleet_config_send"), exact: true });
      assert.ok(await button.isDisabled(), "nothing to send");
      assert.deepEqual(await faults(page), []);
      const before = (await state(context)).hash;
      const lines = text.split("\n");
      const at = lines.indexOf("[module.oven]");
      await send(page, t, [...lines.slice(0, at + 1), "modle = 1", ...lines.slice(at + 1)].join("\n"));
      await page.getByRole("button", { name: say("problem_at", { line: at + 2, column: 1 }) }).click();
      const selected = await field.evaluate((one) => one.value.slice(one.selectionStart, one.selectionEnd));
      assert.equal(selected, "modle = 1");
      await shot(page, `wrong-${look.lang}-${look.width}`);
      assert.deepEqual(await faults(page), []);
      assert.deepEqual(await misplaced(page), []);
      assert.equal((await state(context)).hash, before, "the site is as it was");
      // A site without the key.
      await page.goto(`${fleet.origin}/sites/plant3/config`);
      await page.getByText(t("fleet_cfg_none"), { exact: true }).waitFor();
      await page.getByText("E0942").waitFor();
      await page.getByRole("button", { name: t("retry"), exact: true }).waitFor();
      await shot(page, `none-${look.lang}-${look.width}`);
      assert.deepEqual(await faults(page), []);
      assert.deepEqual(wrong.filter((one) => !/409|422/.test(one)), []);
    } finally {
      await context.close();
    }
  });
}

test("a configuration is tried, and said to be", { timeout: 4 * PATIENCE_MS }, async () => {
  const { context, page, t, say } = await visitor({ lang: "en", width: 1280, scheme: "light" });
  try {
    await page.goto(`${fleet.origin}/sites/${SITE}/config`);
    const field = page.getByRole("textbox", { name: t("config_text") });
    await field.waitFor();
    await page.getByText(t("fleet_cfg_unmanaged")).waitFor();
    await send(page, t, `${await field.inputValue()}\n[group.tried]\nmembers = ["oven.k1"]\n`);
    const trying = page.getByText(t("fleet_cfg_trying"));
    await trying.waitFor();
    await page.getByText(say("fleet_config_wanted", { n: 1 })).waitFor();
    assert.equal((await state(context)).phase, "trying");
    const groups = await context.request.get(`${fleet.origin}/s/${SITE}/api/v1/groups`);
    assert.match(await groups.text(), /tried/, "it is in force");
    for (const width of WIDTHS) {
      await page.setViewportSize({ width, height: 800 });
      await shot(page, `trying-en-${width}`);
      assert.deepEqual(await faults(page), []);
      assert.deepEqual(await misplaced(page), []);
    }
    // The page of the site says it, too.
    await page.goto(`${fleet.origin}/sites/${SITE}`);
    await page.getByText(t("fleet_cfg_trying")).waitFor();
  } finally {
    await context.close();
  }
});

test("what somebody else gave meanwhile is not sent over, and what is typed is not lost", { timeout: 4 * PATIENCE_MS }, async () => {
  const SECOND = "plant2";
  const { context, page, t } = await visitor({ lang: "en", width: 1280, scheme: "light" });
  const address = `${fleet.origin}/fleet/v1/sites/${SECOND}/config`;
  try {
    await page.goto(`${fleet.origin}/sites/${SECOND}/config`);
    const field = page.getByRole("textbox", { name: t("config_text") });
    await field.waitFor();
    const text = await field.inputValue();
    await field.fill(`${text}# Mine.\n`);
    // Somebody else adopts what the site has: there is nothing to try.
    const { hash } = await (await context.request.get(`${address}/text`)).json();
    const headers = { "X-CSRF-Token": csrf };
    const other = await context.request.put(address, { data: { text, replaces: hash }, headers });
    assert.equal(other.status(), 200, await other.text());
    await until(async () => (await state(context, SECOND)).phase === "current");
    await page.getByText(t("fleet_config_outdated")).waitFor();
    assert.equal(await field.inputValue(), `${text}# Mine.\n`, "what is typed stays");
    const answer = page.waitForResponse((one) => one.url() === address && one.request().method() === "PUT");
    await send(page, t, `${text}# Mine.\n`);
    assert.equal((await answer).status(), 412);
    assert.equal(await field.inputValue(), `${text}# Mine.\n`, "and can be sent later");
    // What is typed while it is sent was not sent.
    await page.getByRole("button", { name: t("config_reload"), exact: true }).click();
    await until(async () => (await field.count()) === 1 && (await field.inputValue()) === text);
    let go;
    const held = new Promise((resolve) => (go = resolve));
    await page.route(address, async (route) => {
      if (route.request().method() === "PUT") await held;
      await route.continue();
    });
    await send(page, t, `${text}# One.\n`);
    await field.fill(`${text}# One.\n# Two.\n`);
    const sent = page.waitForResponse((one) => one.url() === address && one.request().method() === "PUT");
    go();
    assert.equal((await sent).status(), 200);
    await until(async () => (await state(context, SECOND)).version === 2);
    assert.equal(await field.inputValue(), `${text}# One.\n# Two.\n`);
    await until(async () => !(await page.getByRole("button", { name: t("fleet_config_send"), exact: true }).isDisabled()));
  } finally {
    await context.close();
  }
});

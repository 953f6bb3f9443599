// The pages of a centre, and those of its sites, of a real fleet: a server, a centre, three sites. From
// the link that the centre prints to a relay of a far site; and what is shown while a part is away.
import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import { browse, faults, LOOKS, open, PASSWORD, PATIENCE_MS, serveFleet, words } from "./daemon.js";
import { misplaced } from "./geometry.js";

const WIDTHS = [360, 768, 1280, 1920];
const PAGES = ["/", "/?state=attention", "/?search=plant2", "/?search=nothing", "/sites/plant1", "/sites/nowhere", "/commands", "/users"];
const FAR = ["/s/plant1/", "/s/plant1/module/oven", "/s/plant1/lines", "/s/plant1/events", "/s/plant1/system", "/s/plant1/trends?points=oven.k1"];
const GREEN = "main .tag.good:not(.past), main button.switch.on:not(.stale), main .value.high:not(.old)";

let fleet, browser, cookies;

before(async () => {
  fleet = await serveFleet();
  browser = await browse();
  const context = await browser.newContext();
  const key = new URL(fleet.link).hash.slice("#k=".length);
  const made = await context.request.post(`${fleet.origin}/api/v1/setup`, { data: { key, name: "admin", password: PASSWORD, lang: "en" } });
  assert.equal(made.status(), 200, await made.text());
  cookies = await context.cookies();
  await context.close();
});

after(async () => {
  await browser?.close();
  await fleet?.stop();
});

async function visitor(look, as = cookies) {
  const { context, page, wrong } = await open(browser, look);
  await context.addCookies(as);
  return { context, page, wrong, t: words(look.lang) };
}

const DESK = { lang: "en", width: 1280, scheme: "light" };

/** Waits until a page shows what was heard from afar, and nothing is being fetched for it. */
async function shown(page) {
  await page.locator("main h1").first().waitFor();
  await page.locator(".connection.live").waitFor({ state: "attached" });
  await page.waitForFunction((words) => !words.includes(document.querySelector("main p.muted")?.textContent), ["Loading…", "加载中…"]);
}

for (const lang of ["en", "zh"]) {
  test(`every page at every width: ${lang}`, async () => {
    const { context, page, wrong } = await visitor({ lang, width: 1280, scheme: "light" });
    try {
      for (const path of [...PAGES, ...FAR]) {
        await page.goto(fleet.origin + path);
        await shown(page);
        for (const width of WIDTHS) {
          await page.setViewportSize({ width, height: width < 900 ? 740 : 800 });
          const found = await misplaced(page);
          if (width === 360 || width === 1280) found.push(...(await faults(page)));
          wrong.push(...found.map((fault) => `${path} ${width}: ${fault}`));
          const name = path.replaceAll(/\W+/g, "_");
          if (process.env.SHOTS) await page.screenshot({ path: `${process.env.SHOTS}/fleet${name}-${lang}-${width}.png`, fullPage: true });
        }
      }
      // That there is no such site is an answer with a status of an error, which the console tells.
      assert.deepEqual(wrong.filter((one) => !/status of 404/.test(one)), []);
    } finally {
      await context.close();
    }
  });
}

for (const look of LOOKS) {
  test(`a relay of a far site is switched: ${look.lang} ${look.width} ${look.scheme}`, async () => {
    const { context, page, wrong, t } = await visitor(look);
    try {
      await page.goto(fleet.origin);
      await page.getByRole("link", { name: `${t("fleet_open")} plant1`, exact: true }).click();
      const relay = page.getByRole("switch", { name: /^oven\.k3/ });
      await relay.waitFor();
      const before = await relay.getAttribute("aria-checked");
      const ended = page.waitForFunction(() => document.querySelector(".outcome > span")?.textContent);
      await relay.click();
      assert.match(await (await ended).jsonValue(), new RegExp(`^\\s*${t("confirmed_readback")}`));
      const after = before === "true" ? "false" : "true";
      await page.locator(`button.switch[aria-label^="oven.k3"][aria-checked="${after}"]`).waitFor();
      assert.deepEqual(await faults(page), []);
      await page.getByRole("link", { name: t("far_sites") }).click();
      await page.waitForURL(`${fleet.origin}/`);
      await page.goto(`${fleet.origin}/commands`);
      const row = page.locator("tbody tr").first();
      await row.waitFor();
      assert.match(await row.innerText(), new RegExp(`plant1.*oven\\.k3 ${t(after === "true" ? "on" : "off")}.*${t("fleet_end_done")}.*admin`, "s"));
      assert.deepEqual(wrong, []);
    } finally {
      await context.close();
    }
  });
}

test("what the site does not allow is refused, and said so", async () => {
  const { context, page, t } = await visitor(DESK);
  try {
    // Nothing may be switched there through the centre.
    await page.goto(`${fleet.origin}/s/plant3/`);
    const relay = page.getByRole("switch", { name: /^oven\.k3/ });
    await relay.waitFor();
    const before = await relay.getAttribute("aria-checked");
    await relay.click();
    await page.getByText(t("verdict_failed_why")).first().waitFor();
    await page.getByText(t("far_grants")).waitFor();
    assert.equal(await relay.getAttribute("aria-checked"), before);
    await page.goto(`${fleet.origin}/commands`);
    await page.locator("tbody tr td.fault", { hasText: /E0941/ }).first().waitFor();
  } finally {
    await context.close();
  }
});

test("links between pages of a site stay at that site, and can be opened in a tab", async () => {
  const { context, page, t } = await visitor(DESK);
  try {
    for (const path of FAR) {
      await page.goto(fleet.origin + path);
      await shown(page);
      const links = await page.$$eval("a[href]", (all) => all.map((link) => link.getAttribute("href")));
      const outside = links.filter((href) => !href.startsWith("/s/plant1/") && !href.startsWith("#") && href !== "/");
      assert.ok(links.length > outside.length + 1, path);
      assert.deepEqual(outside, [], path);
    }
    await page.goto(`${fleet.origin}/s/plant2/`);
    await page.locator("article h2 a").first().waitFor();
    await page.locator("article h2 a").first().click();
    await page.waitForURL(/\/s\/plant2\/module\//);
    await page.reload();
    await page.locator("main h1").first().waitFor();
    await page.getByRole("link", { name: t("nav_lines") }).first().click();
    await page.waitForURL(`${fleet.origin}/s/plant2/lines`);
    await page.goBack();
    await page.waitForURL(/\/s\/plant2\/module\//);
  } finally {
    await context.close();
  }
});

test("a viewer looks, at the centre and at its sites", async () => {
  const admin = await visitor(DESK);
  const csrf = (await (await admin.context.request.get(`${fleet.origin}/api/v1/session`)).json()).csrf;
  const data = { name: "guest", role: "viewer", password: PASSWORD };
  const made = await admin.context.request.post(`${fleet.origin}/api/v1/users`, { data, headers: { "X-CSRF-Token": csrf } });
  assert.ok(made.ok(), await made.text());
  await admin.context.close();
  const { context, page, t } = await visitor(DESK, []);
  try {
    // Signing in works at the address of a site, too: the users are the centre's.
    await page.goto(`${fleet.origin}/s/plant1/`);
    await page.locator("#name").fill("guest");
    await page.locator("#password").fill(PASSWORD);
    await page.getByRole("button", { name: t("sign_in") }).click();
    const relay = page.getByRole("switch", { name: /^oven\.k3/ });
    await relay.waitFor();
    assert.equal(await relay.isDisabled(), true);
    await page.goto(`${fleet.origin}/`);
    await page.locator("tbody tr").first().waitFor();
    assert.equal(await page.getByRole("link", { name: t("nav_users") }).count(), 0);
  } finally {
    await context.close();
  }
});

test("nothing looks fresh while a site, the servers or the centre are away", { timeout: 4 * PATIENCE_MS }, async () => {
  const { context, page, t } = await visitor(DESK);
  const far = await context.newPage();
  const site = await context.newPage();
  const none = (where) => where.waitForFunction((green) => !document.querySelector(green), GREEN);
  try {
    await page.goto(`${fleet.origin}/`);
    await far.goto(`${fleet.origin}/s/plant2/`);
    await site.goto(`${fleet.origin}/sites/plant2`);
    await far.locator("article .switch").first().waitFor();
    await site.locator("tbody tr").first().waitFor();
    const row = page.locator("tbody tr", { hasText: "plant2" });
    await row.locator(".tag.good").waitFor();
    // What is looked for later is there now.
    for (const one of [page, far, site]) await one.locator(GREEN).first().waitFor();

    fleet.suspend("plant2");
    fleet.suspend("plant3");
    await far.bringToFront();
    await none(far);
    await far.locator("p.lost", { hasText: "plant2" }).waitFor();
    await far.getByRole("link", { name: t("far_known") }).waitFor();
    await page.bringToFront();
    await row.locator(".tag.bad", { hasText: t("fleet_is_offline") }).waitFor();
    await none(site);
    await site.getByText(t("fleet_pages_away")).waitFor();
    await page.getByRole("button", { name: /need attention/ }).click();
    await page.waitForFunction(() => document.querySelectorAll("tbody tr").length === 2);
    if (process.env.SHOTS) for (const [name, one] of Object.entries({ page, far, site })) await one.screenshot({ path: `${process.env.SHOTS}/away-${name}.png` });
    // What is gone can be removed.
    await site.goto(`${fleet.origin}/sites/plant3`);
    await site.getByRole("button", { name: t("fleet_remove") }).click();
    assert.deepEqual(await faults(site), []);
    await site.getByRole("dialog").getByRole("button", { name: t("fleet_remove_yes"), exact: true }).click();
    await site.waitForURL(`${fleet.origin}/`);
    await page.getByRole("button", { name: /^All 2/ }).waitFor();
    await site.goto(`${fleet.origin}/sites/plant3`);
    await site.getByText(t("fleet_site_none").replace("{name}", "plant3")).waitFor();
    await site.goto(`${fleet.origin}/sites/plant2`);
    fleet.resume("plant2");
    await far.bringToFront();
    await far.locator(".connection.live").waitFor({ state: "attached" });
    await page.bringToFront();
    await page.getByRole("button", { name: /^All/ }).click();
    await row.locator(".tag.good").waitFor();

    fleet.suspend("nats.conf");
    await page.getByText(t("fleet_deaf")).waitFor();
    await none(page);
    await none(site);
    if (process.env.SHOTS) await page.screenshot({ path: `${process.env.SHOTS}/deaf.png` });
    fleet.resume("nats.conf");
    await row.locator(".tag.good").waitFor();

    fleet.suspend("fleet\0serve");
    await page.locator("p.lost").waitFor();
    await none(page);
    await none(site);
    if (process.env.SHOTS) await page.screenshot({ path: `${process.env.SHOTS}/gone.png` });
    fleet.resume("fleet\0serve");
    await row.locator(".tag.good").waitFor();
  } finally {
    fleet.resumeAll();
    await context.close();
  }
});

/** Holds requests of a page until it is told to let them go on. */
async function hold(page, pattern) {
  const held = [];
  let holding = true;
  await page.route(pattern, (route) => (holding ? held.push(route) : route.continue()));
  return {
    held,
    async release() {
      holding = false;
      for (const route of held) await route.continue();
    },
  };
}

test("an answer of before does not look fresh because another one has come", async () => {
  const { context, page, t } = await visitor(DESK);
  const site = await context.newPage();
  try {
    await page.goto(`${fleet.origin}/`);
    await site.goto(`${fleet.origin}/sites/plant2`);
    for (const one of [page, site]) await one.locator(GREEN).first().waitFor();
    const rows = await hold(page, /fleet\/v1\/sites\?limit=100/);
    const points = await hold(site, /fleet\/v1\/sites\/plant2/);
    // The centre goes on answering how many sites there are.
    for (const one of [page, site]) {
      await one.waitForFunction((green) => !document.querySelector(green), GREEN);
      assert.equal(await one.locator(".connection.live").count(), 1);
    }
    assert.match(await page.locator("tbody tr").first().innerText(), new RegExp(t("fleet_is_unknown")));
    await rows.release();
    await points.release();
    for (const one of [page, site]) await one.locator(GREEN).first().waitFor();
  } finally {
    await context.close();
  }
});

test("a far site is not asked while nobody looks, and nothing is shown as if it were", async () => {
  const { context, page } = await visitor(DESK);
  const look = (hidden) =>
    page.evaluate((hidden) => {
      Object.defineProperty(document, "hidden", { value: hidden, configurable: true });
      document.dispatchEvent(new Event("visibilitychange"));
    }, hidden);
  try {
    await page.goto(`${fleet.origin}/s/plant1/`);
    await page.locator("article .switch").first().waitFor();
    await page.locator(GREEN).first().waitFor();
    await look(true);
    // It would never be so if it were asked.
    await page.locator(".connection.stale").waitFor({ state: "attached" });
    assert.equal(await page.locator(GREEN).count(), 0);
    await look(false);
    await page.locator(".connection.live").waitFor({ state: "attached" });
    await page.locator(GREEN).first().waitFor();
  } finally {
    await context.close();
  }
});

test("whatever was sent as a command is shown in the record", async () => {
  const { context, page, t } = await visitor(DESK);
  try {
    const { csrf } = await (await context.request.get(`${fleet.origin}/api/v1/session`)).json();
    const odd = [["PUT", "points/oven/k4", "null"], ["POST", "batch", '{"set":[null]}'], ["PUT", "modules/oven/outputs", '{"set":7}']];
    for (const [method, path, data] of odd) {
      const headers = { "X-CSRF-Token": csrf, "Content-Type": "application/json" };
      await context.request.fetch(`${fleet.origin}/s/plant1/api/v1/${path}`, { method, headers, data });
    }
    await page.goto(`${fleet.origin}/commands`);
    await page.locator("tbody tr", { hasText: "POST batch" }).first().waitFor();
    await page.goto(`${fleet.origin}/sites/plant1`);
    await page.getByRole("heading", { name: t("fleet_commands") }).waitFor();
  } finally {
    await context.close();
  }
});

for (const look of [LOOKS[0], LOOKS[3]]) {
  test(`a site is put in a group, and found by it: ${look.lang} ${look.width}`, async () => {
    const { context, page, t } = await visitor(look);
    const group = `north-${look.width}`;
    const dialog = page.getByRole("dialog");
    try {
      await page.goto(`${fleet.origin}/sites/plant1`);
      await page.getByRole("button", { name: t("fleet_groups_edit") }).click();
      await dialog.getByLabel(t("fleet_groups"), { exact: true }).fill("North!");
      await dialog.getByRole("button", { name: t("save") }).click();
      await dialog.getByRole("alert").filter({ hasText: /\S/ }).waitFor();
      assert.deepEqual(await faults(page), []);
      await dialog.getByLabel(t("fleet_groups"), { exact: true }).fill(`${group} line-a`);
      await dialog.getByRole("button", { name: t("save") }).click();
      await dialog.waitFor({ state: "detached" });
      await page.locator("dd", { hasText: group }).waitFor();
      await page.goto(`${fleet.origin}/`);
      await page.getByRole("combobox").selectOption(group);
      await page.waitForFunction(() => document.querySelectorAll("tbody tr").length === 1);
      assert.match(await page.locator("tbody tr").innerText(), /plant1/);
      assert.deepEqual([...(await faults(page)), ...(await misplaced(page))], []);
    } finally {
      await context.close();
    }
  });
}

test("a search that is refused can be changed", async () => {
  const { context, page } = await visitor(DESK);
  try {
    await page.goto(`${fleet.origin}/?search=a+b+c+d+e+f+g+h+i`);
    await page.getByRole("alert").filter({ hasText: "E0806" }).waitFor();
    await page.getByRole("searchbox").fill("plant2");
    await page.waitForFunction(() => document.querySelectorAll("tbody tr").length === 1);
    assert.deepEqual(await faults(page), []);
  } finally {
    await context.close();
  }
});

test("the first user is made by the link that the centre prints", async () => {
  const { context, page, t } = await visitor(DESK, []);
  try {
    await page.goto(fleet.link);
    // There is one already: the key was used.
    await page.getByText(t("setup_is_done")).waitFor();
    assert.deepEqual(await faults(page), []);
    await page.getByRole("link", { name: t("nav_overview") }).click();
    await page.locator("#name").waitFor();
  } finally {
    await context.close();
  }
});

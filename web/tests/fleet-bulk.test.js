// One command to many sites on the pages of a centre, with a real fleet: what is looked at is what is
// commanded, and nothing is told better than it is known.
import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import { browse, faults, LOOKS, open, PASSWORD, PATIENCE_MS, serveFleet, setUp, until, words } from "./daemon.js";
import { misplaced } from "./geometry.js";

const WIDTHS = [360, 768, 1280, 1920];
const GREEN = "main .tag.good:not(.past)";
const DESK = { lang: "en", width: 1280, scheme: "light" };
/** Names that no site has. */
const NOBODY = Array.from({ length: 9 }, (_, i) => `nobody${i + 1}`);
const LOOK = /fleet\/v1\/commands\/preview/;
const GIVE = /fleet\/v1\/commands\?/;

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

async function visitor(look, as = cookies) {
  const { context, page, wrong } = await open(browser, look);
  await context.addCookies(as);
  const t = words(look.lang);
  const say = (key, gaps) => t(key).replace(/\{(\w+)\}/g, (_, name) => String(gaps[name]));
  return { context, page, wrong, t, say };
}

const shot = (page, name) => process.env.SHOTS && page.screenshot({ path: `${process.env.SHOTS}/bulk-${name}.png`, fullPage: true });

/** Whether an output is on at a site: the site itself is asked. */
async function isOn(context, site, point = "oven/k4") {
  const answer = await context.request.get(`${fleet.origin}/s/${site}/api/v1/points/${point}`);
  assert.ok(answer.ok(), await answer.text());
  return (await answer.json()).value;
}

/** Writes what is wanted into the form, and asks for the preview. */
async function look(page, t, target, to) {
  await page.getByLabel(t("fleet_target")).fill(target);
  const word = { on: t("on"), off: t("off"), toggle: t("fleet_verb_toggle") }[to];
  const button = page.getByRole("group", { name: t("state"), exact: true }).getByRole("button", { name: word, exact: true });
  if ((await button.getAttribute("aria-pressed")) === "false") await button.click();
  await page.getByRole("button", { name: t("fleet_look"), exact: true }).click();
  await page.locator("main table tbody tr").first().waitFor();
}

const giver = (page, { t, say }, n) => page.getByRole("button", { name: say("fleet_give", { sites: n === 1 ? t("fleet_site_one") : say("fleet_site_many", { n }) }), exact: true });

/** Gives it, and waits for the page of the order. */
async function give(page, with_, n) {
  await giver(page, with_, n).click();
  await page.waitForURL(/\/commands\/[0-9a-f]{32}$/);
  await page.locator("main table tbody tr").first().waitFor();
}

/** The result at each site, as the page shows it. */
const results = (page) => page.$$eval("main tbody tr", (rows) => Object.fromEntries(rows.map((row) => [row.cells[0].innerText.trim(), row.cells[1].innerText.trim()])));

/** Adds sites to what is looked at of which the centre knows nothing. */
const withNobody = (page, names = NOBODY) =>
  page.route(LOOK, async (route) => {
    const answer = await route.fetch();
    const told = await answer.json();
    const sites = [...names.map((site) => ({ site, presence: "unknown", code: "E0168" })), ...told.sites];
    await route.fulfill({ response: answer, json: { ...told, sites } });
  });

for (const [i, look_] of LOOKS.entries()) {
  test(`relays of several sites are switched: ${look_.lang} ${look_.width} ${look_.scheme}`, async () => {
    const all = await visitor(look_);
    const { context, page, wrong, t, say } = all;
    const to = i % 2 === 0 ? "on" : "off";
    try {
      await page.goto(`${fleet.origin}/?search=plant`);
      await page.getByRole("link", { name: t("fleet_switch_these") }).click();
      await page.waitForURL(`${fleet.origin}/switch?search=plant`);
      assert.equal(await page.getByRole("button", { name: t("fleet_look"), exact: true }).isDisabled(), true);
      assert.deepEqual(await faults(page), []);
      await look(page, t, "oven.k4", to);
      await page.getByText(say("fleet_will", { n: 3, total: 3 })).waitFor();
      const row = page.locator("tbody tr", { hasText: "plant1" });
      const asItIs = new RegExp(`${t("fleet_is_online")}\\s+${t(to === "on" ? "off" : "on")}\\s+${t("fleet_good")}`);
      // At this moment not all that it said need have arrived.
      await until(async () => {
        if (asItIs.test(await row.innerText())) return true;
        await look(page, t, "oven.k4", to);
      });
      assert.deepEqual([...(await faults(page)), ...(await misplaced(page))], []);
      await shot(page, `look-${look_.lang}-${look_.width}`);
      // Nothing is switched by looking.
      assert.equal(await isOn(context, "plant1"), to !== "on");
      await give(page, all, 3);
      await until(async () => Object.values(await results(page)).filter((end) => end === t("fleet_end_done")).length === 2);
      const ends = await results(page);
      assert.deepEqual([ends.plant1, ends.plant2], [t("fleet_end_done"), t("fleet_end_done")]);
      // It lets its centre switch nothing.
      assert.match(ends.plant3, /^E0941 /);
      for (const site of ["plant1", "plant2"]) assert.equal(await isOn(context, site), to === "on", site);
      assert.equal(await isOn(context, "plant3"), false);
      assert.deepEqual([...(await faults(page)), ...(await misplaced(page))], []);
      await shot(page, `order-${look_.lang}-${look_.width}`);
      const id = new URL(page.url()).pathname.split("/").at(-1);
      await page.goto(`${fleet.origin}/commands`);
      const line = page.locator("tbody tr", { has: page.locator(`a[href="/commands/${id}"]`) });
      await line.waitFor();
      const told = await line.innerText();
      for (const word of [say("fleet_site_many", { n: 3 }), `oven.k4 ${t(to)}`, t("fleet_end_done"), t("fleet_end_failed"), "admin"]) assert.ok(told.includes(word), `${word}: ${told}`);
      assert.deepEqual([...(await faults(page)), ...(await misplaced(page))], []);
      await shot(page, `commands-${look_.lang}-${look_.width}`);
      await line.getByRole("link").click();
      await page.waitForURL(`${fleet.origin}/commands/${id}`);
      assert.deepEqual(wrong, []);
    } finally {
      await context.close();
    }
  });
}

/** What is typed, shown and sent. No site of the demo has groups. */
const ASKED = {
  en: ["oven.k6", "oven.k6", "/api/v1/points/oven/k6/toggle", {}],
  zh: ["＠上/下", "@上/下", "/api/v1/groups/%E4%B8%8A%2F%E4%B8%8B/set", { value: "toggle" }],
};

for (const lang of ["en", "zh"]) {
  test(`from ten sites on their number is typed, and exactly these are commanded: ${lang}`, async () => {
    const all = await visitor({ ...DESK, lang });
    const { context, page, t, say } = all;
    try {
      await withNobody(page);
      await page.goto(`${fleet.origin}/switch?search=plant`);
      const [typed, shown, path, body] = ASKED[lang];
      const before = await isOn(context, "plant1", "oven/k6");
      await look(page, t, typed, "toggle");
      await page.getByRole("heading", { name: `${shown} ${t("fleet_verb_toggle")}` }).waitFor();
      // What a group has is not known at the centre.
      assert.equal(await page.locator("tbody tr", { hasText: "plant1" }).locator("td").count(), lang === "en" ? 2 : 1);
      await page.getByText(say("fleet_will", { n: 3, total: 12 })).waitFor();
      const nobody = page.locator("tbody tr", { hasText: "nobody1" });
      assert.match(await nobody.innerText(), new RegExp(`${t("fleet_is_unknown")}.*E0168 ${t("fleet_no_E0168")}`, "s"));
      const button = giver(page, all, 12);
      const field = page.getByLabel(say("fleet_type", { n: 12 }));
      for (const wrong of ["", "1", "3", "112", "120", "12x"]) {
        await field.fill(wrong);
        assert.equal(await button.isDisabled(), true, wrong);
        await field.press("Enter");
      }
      await field.fill("１２");
      assert.equal(await button.isEnabled(), true);
      for (const width of WIDTHS) {
        await page.setViewportSize({ width, height: 800 });
        assert.deepEqual([...(await faults(page)), ...(await misplaced(page))], [], width);
        await shot(page, `many-${lang}-${width}`);
      }
      const asked = page.waitForRequest(GIVE);
      await give(page, all, 12);
      const request = await asked;
      const sent = request.postDataJSON();
      assert.deepEqual(sent, { sites: [...NOBODY, "plant1", "plant2", "plant3"], method: "POST", path, body });
      assert.ok(page.url().endsWith(request.headers()["idempotency-key"]));
      const never = page.getByRole("button", { name: new RegExp(`${t("fleet_end_never")}.*9`) });
      await never.waitFor();
      await until(async () => !Object.values(await results(page)).includes(t("fleet_end_sent")));
      assert.equal((await results(page)).plant1, lang === "en" ? t("fleet_end_done") : "E0860 没有此分组");
      assert.equal(await isOn(context, "plant1", "oven/k6"), lang === "en" ? !before : before);
      for (const width of WIDTHS) {
        await page.setViewportSize({ width, height: 800 });
        assert.deepEqual([...(await faults(page)), ...(await misplaced(page))], [], width);
        await shot(page, `many-order-${lang}-${width}`);
      }
      await never.click();
      await until(async () => (await page.locator("tbody tr").count()) === 9);
      for (const end of Object.values(await results(page))) assert.match(end, new RegExp(`^${t("fleet_end_never")}.*E0836`));
      await page.getByText(say("fleet_shown", { n: 9, total: 9 })).waitFor();
    } finally {
      await context.close();
    }
  });
}

test("long lists are shown a part at a time, and commanded as a whole", async () => {
  const all = await visitor(DESK);
  const { context, page, t, say } = all;
  const rows = async (n) => {
    await page.getByText(say("fleet_shown", { n, total: 151 })).waitFor();
    assert.equal(await page.locator("tbody tr").count(), n);
  };
  try {
    await withNobody(page, Array.from({ length: 150 }, (_, i) => `nobody${100 + i}`));
    await page.goto(`${fleet.origin}/switch?search=plant1`);
    await look(page, t, "oven.k7", "on");
    await rows(100);
    await page.getByLabel(say("fleet_type", { n: 151 })).fill("151");
    await give(page, all, 151);
    await rows(100);
    await page.getByRole("button", { name: t("fleet_more") }).click();
    await rows(151);
    await until(async () => (await results(page)).plant1 === t("fleet_end_done"));
    assert.equal(await isOn(context, "plant1", "oven/k7"), true);
    await page.goto(`${fleet.origin}/switch?search=plant1`);
    await look(page, t, "oven.k7", "on");
    await page.getByRole("button", { name: t("fleet_more") }).click();
    await rows(151);
  } finally {
    await context.close();
  }
});

test("a preview is gone when the form or the filter changes, and is not of now for long", async () => {
  const { context, page, t } = await visitor(DESK);
  const gone = () => page.locator("main table").waitFor({ state: "detached" });
  try {
    await page.goto(`${fleet.origin}/switch?search=plant`);
    await look(page, t, "oven.k4", "on");
    await page.getByLabel(t("fleet_target")).fill("oven.k5");
    await gone();
    await page.getByLabel(t("fleet_target")).fill("oven.k4");
    // Also where it is what it was: it is looked at again.
    assert.equal(await page.locator("main table").count(), 0);
    await look(page, t, "oven.k4", "on");
    await page.getByRole("button", { name: t("off"), exact: true }).click();
    await gone();
    await look(page, t, "oven.k4", "on");
    await page.evaluate(() => {
      history.pushState(null, "", "/switch?search=plant1");
      dispatchEvent(new PopStateEvent("popstate"));
    });
    await gone();
    await look(page, t, "oven.none", "on");
    assert.equal(await page.locator("tbody tr").count(), 1);
    await until(async () => {
      if ((await page.locator("tbody tr").innerText()).includes(`E0802 ${t("fleet_no_E0802")}`)) return true;
      await look(page, t, "oven.none", "on");
    });
    await look(page, t, "oven.k4", "on");
    await page.locator(GREEN).first().waitFor();
    await page.waitForFunction((green) => !document.querySelector(green), GREEN);
    assert.equal(await page.locator(".connection.live").count(), 1);
    assert.match(await page.locator("tbody tr").innerText(), /was online.*was (on|off).*unknown/s);
    // One that comes too late is none.
    let late;
    await page.route(LOOK, (route) => (late = route));
    await page.getByRole("button", { name: t("fleet_look"), exact: true }).click();
    await until(() => late);
    await page.getByLabel(t("fleet_target")).fill("oven.k5");
    await late.continue();
    await page.getByRole("button", { name: t("fleet_look"), exact: true, disabled: false }).waitFor();
    assert.equal(await page.locator("main table").count(), 0);
    // A filter that is misspelt would be none.
    await page.unroute(LOOK);
    await page.goto(`${fleet.origin}/switch?serach=plant1`);
    await page.getByLabel(t("fleet_target")).fill("oven.k4");
    await page.getByRole("button", { name: t("on"), exact: true }).click();
    await page.getByRole("button", { name: t("fleet_look"), exact: true }).click();
    await page.getByRole("alert").filter({ hasText: "E0806" }).waitFor();
  } finally {
    await context.close();
  }
});

test("what was refused was not given, and what has no answer may have been", async () => {
  const all = await visitor(DESK);
  const { context, page, t } = all;
  const orders = async () => (await (await context.request.get(`${fleet.origin}/fleet/v1/commands`)).json()).bulk?.length ?? 0;
  try {
    await page.goto(`${fleet.origin}/switch?search=plant1`);
    await look(page, t, "oven.k4", "off");
    const before = await orders();
    const perhaps = page.getByText(t("fleet_perhaps"));
    const refusal = { code: "E0105", title: "too many", status: 503, may_have_acted: false };
    await page.route(GIVE, (route) => route.fulfill({ status: 503, json: refusal }));
    await giver(page, all, 1).click();
    await page.getByRole("alert").filter({ hasText: "E0105" }).waitFor();
    assert.equal(await perhaps.count(), 0);
    await page.unroute(GIVE);
    await page.route(GIVE, async (route) => {
      await route.fetch();
      await route.abort();
    });
    await giver(page, all, 1).click();
    await perhaps.waitFor();
    assert.deepEqual(await faults(page), []);
    await shot(page, "perhaps");
    assert.equal(await orders(), before + 1);
    // Also who has left the page is told, not only until something else is answered.
    for (const [end, text] of [["refused", "too many"], ["lost", t("fleet_perhaps")]]) {
      await page.goto(`${fleet.origin}/switch?search=plant1`);
      await look(page, t, "oven.k4", "off");
      await page.unroute(GIVE);
      let held;
      await page.route(GIVE, (route) => (held = route));
      await giver(page, all, 1).click();
      await until(() => held);
      await page.getByRole("link", { name: t("fleet_commands") }).first().click();
      await page.waitForURL(`${fleet.origin}/commands`);
      if (end === "lost") await held.abort();
      else await held.fulfill({ status: 503, json: refusal });
      await page.getByText(text).waitFor();
      for (let answers = 0; answers < 2; answers++) await page.waitForResponse(/fleet\/v1\/sites/);
      assert.equal(await page.getByText(text).count(), 1);
    }
    await page.goto(`${fleet.origin}/switch?search=plant1`);
    await look(page, t, "oven.k4", "on");
    await page.unroute(GIVE);
    await page.route(GIVE, async (route) => {
      await route.fetch();
      await route.abort();
    });
    await giver(page, all, 1).click();
    await perhaps.waitFor();
    assert.equal(await orders(), before + 2);
    // Given again, it is the same one.
    await page.unroute(GIVE);
    const link = await page.getByRole("link", { name: t("fleet_perhaps_look") }).getAttribute("href");
    await give(page, all, 1);
    assert.equal(new URL(page.url()).pathname, link);
    assert.equal(await orders(), before + 2);
    // One of which nobody knows is looked for.
    await page.goto(`${fleet.origin}/commands/none`);
    await page.getByRole("alert").filter({ hasText: "E0837" }).waitFor();
    await page.waitForResponse(/commands\/none/);
  } finally {
    await context.close();
  }
});

test("a site that is away is sent nothing, and what was sent goes on when it is stopped", { timeout: 4 * PATIENCE_MS }, async () => {
  const all = await visitor(DESK);
  const { context, page, t, say } = all;
  try {
    await page.goto(`${fleet.origin}/switch?search=plant`);
    // It still seems to be there.
    fleet.suspend("plant2");
    await look(page, t, "oven.k5", "on");
    await give(page, all, 3);
    await until(async () => (await results(page)).plant2 === t("fleet_end_sent"));
    // With so few sites none is left that was not sent it.
    const stop = page.getByRole("button", { name: t("fleet_stop"), exact: true });
    assert.equal(await stop.count(), 0);
    const SEE = /fleet\/v1\/commands\/[0-9a-f]{32}\?/;
    await page.route(SEE, async (route) => {
      const answer = await route.fetch();
      const told = await answer.json();
      await route.fulfill({ response: answer, json: { ...told, counts: { ...told.counts, all: 4, waiting: 1 } } });
    });
    await stop.waitFor();
    assert.deepEqual(await faults(page), []);
    await shot(page, "stop");
    await stop.click();
    await page.getByText(say("fleet_stopped", { name: "admin" })).waitFor();
    await page.unroute(SEE);
    await stop.waitFor({ state: "detached" });
    assert.equal((await results(page)).plant2, t("fleet_end_sent"));
    // An answer of before does not look like one of now.
    const held = [];
    let holding = true;
    await page.route(SEE, (route) => (holding ? held.push(route) : route.continue()));
    await page.getByText(/^as of /).waitFor();
    assert.equal(await page.locator(".connection.live").count(), 1);
    holding = false;
    for (const route of held) await route.continue();
    await page.getByText(/^as of /).waitFor({ state: "detached" });

    const other = await context.newPage();
    await other.goto(`${fleet.origin}/?state=offline`);
    await other.locator("tbody tr", { hasText: "plant2" }).waitFor();
    await other.goto(`${fleet.origin}/switch?search=plant`);
    await look(other, t, "oven.k5", "off");
    await other.getByText(say("fleet_will", { n: 2, total: 3 })).waitFor();
    await other.getByText(t("fleet_will_not")).waitFor();
    const row = await other.locator("tbody tr", { hasText: "plant2" }).innerText();
    assert.match(row, new RegExp(`${t("fleet_is_offline")}.*E0168 ${t("fleet_no_E0168")}.*was (on|off).*site offline`, "s"));
    assert.deepEqual(await faults(other), []);
    await shot(other, "away");
    await give(other, all, 3);
    await until(async () => (await results(other)).plant1 === t("fleet_end_done"));
    assert.match((await results(other)).plant2, new RegExp(`^${t("fleet_end_never")}: E0168`));
    assert.equal(await isOn(context, "plant1", "oven/k5"), false);
    // Where nobody is there, there is nothing to give.
    await other.goto(`${fleet.origin}/switch?search=plant2`);
    await look(other, t, "oven.k5", "off");
    assert.equal(await giver(other, all, 1).count(), 0);
  } finally {
    fleet.resumeAll();
    await context.close();
  }
});

test("who may not command sites is not offered it", async () => {
  const admin = await visitor(DESK);
  const of = { name: "guest", role: "viewer", password: PASSWORD };
  const made = await admin.context.request.post(`${fleet.origin}/api/v1/users`, { data: of, headers: { "X-CSRF-Token": csrf } });
  assert.ok(made.ok(), await made.text());
  const data = { sites: ["plant1"], method: "POST", path: "/api/v1/points/oven/k1/toggle", body: {} };
  const given = await admin.context.request.post(`${fleet.origin}/fleet/v1/commands`, { data, headers: { "X-CSRF-Token": csrf } });
  const order = (await given.json()).id;
  await admin.context.close();
  const { context, page, t } = await visitor(DESK, []);
  try {
    await page.goto(`${fleet.origin}/`);
    await page.locator("#name").fill("guest");
    await page.locator("#password").fill(PASSWORD);
    await page.getByRole("button", { name: t("sign_in") }).click();
    await page.locator("tbody tr").first().waitFor();
    assert.equal(await page.getByRole("link", { name: t("fleet_switch_these") }).count(), 0);
    await page.goto(`${fleet.origin}/switch`);
    await page.getByRole("heading", { name: t("not_found") }).waitFor();
    // The record is everybody's; to stop one is not.
    await page.route(/fleet\/v1\/commands\/[0-9a-f]{32}\?/, async (route) => {
      const answer = await route.fetch();
      const { ended_at, ...told } = await answer.json();
      await route.fulfill({ response: answer, json: { ...told, counts: { ...told.counts, waiting: 1 } } });
    });
    await page.goto(`${fleet.origin}/commands/${order}`);
    await page.locator("tbody tr").first().waitFor();
    await page.getByRole("button", { name: new RegExp(t("fleet_end_waiting")) }).waitFor();
    assert.equal(await page.getByRole("button", { name: t("fleet_stop"), exact: true }).count(), 0);
  } finally {
    await context.close();
  }
});

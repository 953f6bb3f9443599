// The pages in the moment something is wrong, at every width and in both languages, measured: nothing
// old looks fresh, nothing overlaps or leaves its card, and no switch moves when it is pressed.
import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import { PATIENCE_MS, browse, faults, open, serve, setUp, words } from "./daemon.js";
import { misplaced, watchSwitches } from "./geometry.js";

/** Those between are where columns come and go. */
const WIDTHS = [360, 600, 768, 1280, 1300, 1920];
const LOOKS = ["en", "zh"].flatMap((lang) => [360, 768, 1280, 1920].map((width) => ({ lang, width, scheme: "light" })));
const PAGES = ["/", "/groups", "/module/oven", "/lines", "/rules", "/trends?points=oven.k1,tank.ai1&for=60"];
const GREEN = "main .tag.good, main button.switch.on:not(.stale), main .value.high:not(.old)";

let daemon, browser, cookies, csrf;

before(async () => {
  daemon = await serve();
  browser = await browse();
  ({ cookies, csrf } = await setUp(browser, daemon));
  await ask("PUT", "/points/oven/k1", { value: true });
  await ask("PUT", "/points/oven/k3", { value: true });
  await ask("PUT", "/rules/hot", {
    name: { en: "Too hot", zh: "过热" }, when: { point: "oven.k1", is: true }, for_ms: 1_000, then: [{ notify: "hot" }],
  });
});

after(async () => {
  await browser?.close();
  await daemon?.stop();
});

const cookie = () => cookies.map(({ name, value }) => `${name}=${value}`).join("; ");

async function ask(method, path, data) {
  const headers = { "Content-Type": "application/json", "X-CSRF-Token": csrf, Cookie: cookie(), Origin: daemon.origin };
  const body = data === undefined ? undefined : JSON.stringify(data);
  const answer = await fetch(`${daemon.origin}/api/v1${path}`, { method, headers, body });
  const said = await answer.text();
  assert.ok(answer.status < 300, `${method} ${path}: ${answer.status} ${said}`);
  return said && JSON.parse(said);
}

/** Somebody in front of the overview, with values on it. */
async function visitor(look) {
  const { context, page, wrong } = await open(browser, look);
  await context.addCookies(cookies);
  await page.goto(`${daemon.origin}/lines`);
  await page.locator(".connection.live").waitFor({ state: "attached" });
  await goTo(page, "/");
  await page.locator("article button.switch").first().waitFor();
  return { context, page, wrong, t: words(look.lang) };
}

/** Another page, without asking the daemon for it. */
async function goTo(page, path) {
  await page.evaluate((path) => {
    history.pushState(null, "", path);
    dispatchEvent(new PopStateEvent("popstate"));
  }, path);
  await page.locator("main h1").first().waitFor();
}

const at = (look) => `${look.lang} ${look.width}`;
const name = (text) => new RegExp(text.replace(/[.*+?^${}()|[\]\\]/g, "\\$&").replaceAll(/\\\{\w+\\\}/g, ".*"));

/** Everything wrong with the places on these pages; for readers of the screen at one width each. */
async function measure(page, look, paths = PAGES) {
  const found = [];
  for (const path of paths) {
    await goTo(page, path);
    if (path.startsWith("/groups")) await page.locator("article li").first().waitFor();
    if (path.startsWith("/lines")) await page.locator("article table").waitFor();
    if (path.startsWith("/rules")) await page.locator("article h2").waitFor();
    if (path.startsWith("/trends")) await page.locator("section table tbody tr").first().waitFor();
    const wrong = await misplaced(page);
    if (look.width === 360 || look.width === 1280) wrong.push(...(await faults(page)));
    found.push(...wrong.map((fault) => `${path}: ${fault}`));
    if (process.env.SHOTS) await page.screenshot({ path: `${process.env.SHOTS}/${process.env.SHOT_NAME ?? ""}${look.lang}-${look.width}${path.split("?")[0].replaceAll("/", "_")}.png`, fullPage: true });
  }
  return found;
}

for (const lang of ["en", "zh"]) {
  test(`a switch does not move when it is pressed: ${lang}`, async () => {
    const { context, page } = await visitor({ ...LOOKS[0], lang });
    let pressed = 0;
    let confirmed = 0;
    for (const width of WIDTHS) {
      await page.setViewportSize({ width, height: 800 });
      for (const path of ["/", "/module/oven"]) {
        await goTo(page, path);
        for (let times = 0; times < 2; times++) {
          const point = `oven.k${(pressed++ % 8) + 1}`;
          const row = page.locator(".output", { has: page.locator(`button[role=switch][aria-label^="${point}"]`) });
          // Where a reply came late, the end is shown for a minute.
          await row.locator(".outcome > span").waitFor({ state: "detached", timeout: 2 * PATIENCE_MS });
          const moved = await watchSwitches(page);
          // Watched for from before, and in the page: a good end is shown for a few seconds only.
          const ended = row.locator(".outcome > span").waitFor();
          await row.getByRole("switch").click();
          await ended;
          confirmed += await row.locator(".outcome > .good").count();
          assert.deepEqual(await misplaced(page), [], `${width} ${path}`);
          assert.ok((await moved()) < 0.5, `a switch moved by ${await moved()} px at ${width} ${path}`);
        }
      }
    }
    assert.ok(confirmed > 0, `none of ${pressed} commands was confirmed`);
    await context.close();
  });
}

for (const lang of ["en", "zh"]) {
  test(`a switch does not move when its module falls silent: ${lang}`, async () => {
    const { context, page } = await visitor({ ...LOOKS[0], lang });
    for (const width of [360, 1280]) {
      await page.setViewportSize({ width, height: 800 });
      for (const path of ["/", "/module/oven"]) {
        await goTo(page, path);
        const whole = path === "/" ? page.locator("article", { has: page.locator('a[href="/module/oven"]') }) : page.locator("main");
        const answers = whole.locator("button.switch:not(.stale)").first();
        await answers.waitFor();
        const moved = await watchSwitches(page);
        await ask("PUT", "/sim/main/oven", { powered: false });
        try {
          await whole.locator(".tag.bad").waitFor();
          if (path !== "/") await page.locator("main .note.warn").waitFor();
        } finally {
          await ask("PUT", "/sim/main/oven", { powered: true });
        }
        await answers.waitFor();
        assert.ok((await moved()) < 0.5, `a switch moved by ${await moved()} px at ${width} ${path}`);
      }
    }
    await context.close();
  });
}

test("all is well: measured", async () => {
  for (const look of LOOKS) {
    const { context, page } = await visitor(look);
    assert.deepEqual(await measure(page, look), [], at(look));
    await context.close();
  }
});

test("a module is dead: its values are of before, and everything stays in its place", async () => {
  await ask("PUT", "/sim/main/oven", { powered: false });
  try {
    for (const look of LOOKS) {
      const { context, page, t } = await visitor(look);
      const card = page.locator("article", { has: page.locator('a[href="/module/oven"]') });
      await card.locator(".tag.bad", { hasText: name(t("offline_for")) }).waitFor();
      assert.equal(await card.locator(".tag.warn, .tag.bad").count(), 1, "one badge a card");
      assert.equal(await card.locator("button.switch:not(.stale)").count(), 0);
      assert.deepEqual(await measure(page, look), [], at(look));

      await goTo(page, "/groups");
      const heater = page.locator("main li .tag", { hasText: "oven.k1" }).first();
      await heater.locator("b", { hasText: name(t("was")) }).waitFor();
      assert.ok(!(await heater.getAttribute("class")).includes("good"));
      await page.getByText(name(t("group_unknown").replace("{n}", "2"))).first().waitFor();

      await goTo(page, "/rules");
      await page.locator("article .tag.past", { hasText: "oven.k1" }).waitFor();
      await goTo(page, "/trends?points=oven.k1&for=60");
      await page.locator("td .tag.past").waitFor();
      await goTo(page, "/module/oven");
      assert.equal(await page.locator("main button.switch:not(.stale)").count(), 0);
      await page.locator("main .note.warn").waitFor();

      // A command whose end nobody knows has one verdict, on the row and in the notice.
      const control = page.locator('button[role=switch][aria-label^="oven.k4"]');
      const moved = await watchSwitches(page);
      await control.click();
      await page.locator("main .outcome", { hasText: t("verdict_unknown") }).waitFor();
      await page.locator(".toast", { hasText: t("verdict_unknown_why") }).waitFor();
      assert.equal(await page.getByText(t("verdict_failed"), { exact: true }).count(), 0);
      assert.ok((await moved()) < 0.5, "a switch moved");
      assert.deepEqual(await misplaced(page), []);
      await context.close();
    }
  } finally {
    await ask("PUT", "/sim/main/oven", { powered: true });
  }
});

test("the adapter is out: one note for the line, no module is online, nothing is measured", async () => {
  await ask("PUT", "/sim/main", { plugged: false });
  try {
    for (const look of LOOKS) {
      const { context, page, t } = await visitor(look);
      await page.locator("main .note.warn", { hasText: name(t("line_down_since")) }).waitFor();
      assert.equal(await page.locator(GREEN).count(), 0, `${at(look)} green on the overview`);
      assert.equal(await page.locator("article .tag.warn, article .tag.bad").count(), 0, "no badge a module");
      assert.equal(await page.locator("main").getByText(t("state_online"), { exact: true }).count(), 0);
      assert.deepEqual(await measure(page, look), [], at(look));
      await goTo(page, "/lines");
      await page.locator("article table").waitFor();
      assert.equal(await page.locator("main meter").count(), 0, "a busy bar of a line that is not there");
      assert.equal(await page.locator(GREEN).count(), 0, `${at(look)} green on the lines`);
      await goTo(page, "/groups");
      await page.locator("article li").first().waitFor();
      assert.equal(await page.locator(GREEN).count(), 0, `${at(look)} green on the groups`);
      await context.close();
    }
  } finally {
    await ask("PUT", "/sim/main", { plugged: true });
  }
});

test("the daemon is gone: everything is dated, and nothing is green", async () => {
  const all = [];
  for (const look of LOOKS) all.push({ look, ...(await visitor(look)) });
  // One has only ever seen the overview: the other pages are not loaded yet.
  const fresh = await open(browser, LOOKS[3]);
  await fresh.context.addCookies(cookies);
  await fresh.page.goto(daemon.origin);
  await fresh.page.locator("article button.switch").first().waitFor();
  await daemon.stop();
  const pages = PAGES.filter((path) => path !== "/groups" && path !== "/rules" && !path.startsWith("/trends"));
  for (const { look, context, page, t } of all) {
    await page.locator(".note.lost", { hasText: /\d\d:\d\d:\d\d/ }).waitFor();
    for (const path of pages) {
      await goTo(page, path);
      const green = await page.locator(GREEN).evaluateAll((all) =>
        all.filter((one) => !one.matches(".tag") || getComputedStyle(one).borderTopStyle !== "dashed").map((one) => one.outerHTML));
      assert.deepEqual(green, [], `${at(look)} ${path}`);
      assert.equal(await page.locator("main").getByText(t("state_online"), { exact: true }).count(), 0);
    }
    await goTo(page, "/lines");
    assert.equal(await page.locator("main meter").count(), 0);
    const read = await page.locator(".sr[role=status]").first().textContent();
    assert.match(read, /\d\d:\d\d:\d\d/);
    const found = [];
    for (const path of pages) {
      await goTo(page, path);
      found.push(...(await misplaced(page)).map((fault) => `${path}: ${fault}`));
      if (process.env.SHOTS) await page.screenshot({ path: `${process.env.SHOTS}/gone-${look.lang}-${look.width}${path.replaceAll("/", "_")}.png`, fullPage: true });
    }
    if (look.width === 360 || look.width === 1280) found.push(...(await faults(page)));
    assert.deepEqual(found, [], at(look));
    await context.close();
  }
  const t = words("en");
  await goTo(fresh.page, "/groups");
  await fresh.page.locator("main h1", { hasText: t("no_daemon") }).waitFor();
  assert.equal(await fresh.page.getByText(t("page_old")).count(), 0);
  await fresh.context.close();
});


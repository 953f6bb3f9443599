// Pages in states that are seldom seen, at every width and in both languages, measured: a form that is
// refused, somebody who may not, an integration that fails, and a daemon
// that ends while groups, rules, integrations and trends are looked at.
import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import { browse, faults, open, PASSWORD, serve, setUp, words } from "./daemon.js";
import { misplaced } from "./geometry.js";

const WIDTHS = [360, 768, 1280, 1920];
const GREEN = "main .tag.good:not(.past), main button.switch.on:not(.stale), main .value.high:not(.old)";

let daemon, browser, cookies, csrf;

before(async () => {
  daemon = await serve();
  browser = await browse();
  ({ cookies, csrf } = await setUp(browser, daemon));
  await ask("PUT", "/points/oven/k1", { value: true });
  await ask("PUT", "/rules/hot", {
    name: { en: "Too hot", zh: "过热" }, when: { point: "oven.k1", is: true }, for_ms: 1_000, then: [{ notify: "hot" }],
  });
  // Nothing listens there, which is for the owner to allow.
  await daemon.owner("PUT", "/outlets/webhook/dead", { url: "http://127.0.0.1:9/" });
  await ask("POST", "/users", { name: "guest", role: "viewer", password: PASSWORD });
});

after(async () => {
  await browser?.close();
  await daemon?.stop();
});

async function ask(method, path, data) {
  const cookie = cookies.map(({ name, value }) => `${name}=${value}`).join("; ");
  const headers = { "Content-Type": "application/json", "X-CSRF-Token": csrf, Cookie: cookie, Origin: daemon.origin };
  const answer = await fetch(`${daemon.origin}/api/v1${path}`, { method, headers, body: data && JSON.stringify(data) });
  const said = await answer.text();
  assert.ok(answer.status < 300, `${method} ${path}: ${answer.status} ${said}`);
  return said && JSON.parse(said);
}

async function visitor(lang, as = cookies) {
  const { context, page } = await open(browser, { lang, width: 1280, scheme: "light" });
  await context.addCookies(as);
  return { context, page, t: words(lang), dialog: page.getByRole("dialog") };
}

/** Everything wrong with the page, at every width. */
async function measure(page, what) {
  const found = [];
  for (const width of WIDTHS) {
    await page.setViewportSize({ width, height: width < 900 ? 740 : 800 });
    const wrong = [...(await misplaced(page)), ...(await faults(page))];
    found.push(...wrong.map((fault) => `${what} ${width}: ${fault}`));
    if (process.env.SHOTS) await page.screenshot({ path: `${process.env.SHOTS}/state-${what.replaceAll(/\W+/g, "_")}-${width}.png` });
  }
  return found;
}

for (const lang of ["en", "zh"]) {
  test(`a form that is refused says so in its place: ${lang}`, async () => {
    const { context, page, t, dialog } = await visitor(lang);
    await page.goto(`${daemon.origin}/module/oven`);
    await page.getByRole("button", { name: t("point_edit").replace("{point}", "oven"), exact: true }).click();
    await dialog.getByLabel(t("poll"), { exact: true }).fill("often");
    await dialog.getByRole("button", { name: t("save"), exact: true }).click();
    await dialog.getByRole("alert").waitFor();
    assert.equal(await page.locator(".toast").count(), 0, "nothing behind it");
    assert.deepEqual(await measure(page, `${lang} refused`), []);
    await context.close();
  });

  test(`who may only look is offered nothing to change: ${lang}`, async () => {
    const signing = await browser.newContext();
    const data = { name: "guest", password: PASSWORD };
    const entered = await signing.request.post(`${daemon.origin}/api/v1/login`, { data });
    assert.equal(entered.status(), 200, await entered.text());
    const { context, page } = await visitor(lang, await signing.cookies());
    await signing.close();
    for (const path of ["/", "/module/oven", "/lines", "/groups", "/rules", "/trends?points=oven.k1&for=60", "/users"]) {
      await page.goto(daemon.origin + path);
      await page.locator("main h1").first().waitFor();
      await page.waitForLoadState("networkidle");
      assert.equal(await page.locator("main .switch:not([aria-disabled=true])").count(), 0, path);
      const edits = page.locator("main .button.primary, main .button.quiet:not([aria-pressed])").and(page.locator(":enabled"));
      const offered = await edits.evaluateAll((all) => all.map((one) => one.getAttribute("aria-label") ?? one.textContent));
      if (!path.startsWith("/trends")) assert.deepEqual(offered, [], path);
      assert.deepEqual(await measure(page, `${lang} guest ${path}`), []);
    }
    await context.close();
  });
}

for (const lang of ["en", "zh"]) {
  test(`an integration that fails says why, and what to do: ${lang}`, async () => {
    const { context, page, t, dialog } = await visitor(lang);
    await page.goto(`${daemon.origin}/integrations`);
    const card = page.locator("article", { hasText: "dead" });
    await card.locator(".note.bad", { hasText: "E0857" }).waitFor();
    assert.ok((await card.locator(".note.bad p").count()) >= 3, await card.textContent());
    assert.deepEqual(await measure(page, `${lang} integration fails`), []);
    await page.getByText("Webhook", { exact: true }).last().click();
    await card.getByRole("button", { name: t("edit") }).click();
    await dialog.getByLabel(t("outlet_enabled")).waitFor();
    assert.deepEqual(await measure(page, `${lang} integration form`), []);
    await context.close();
  });
}

test("another model in a module's place is named on its card and page", async () => {
  await ask("PATCH", "/config/modules/pump", { model: "eda9050" });
  const found = [];
  for (const lang of ["en", "zh"]) {
    const { context, page, t } = await visitor(lang);
    const badge = page.locator("main .tag.bad", { hasText: t("state_other").replace("{model}", "EDA9060A") });
    for (const path of ["/", "/module/pump"]) {
      await page.goto(`${daemon.origin}${path}`);
      await badge.first().waitFor();
      found.push(...(await measure(page, `another model ${path} ${lang}`)));
    }
    // What it reads is not its own: each output and each input says why it shows nothing, and none is green.
    const why = t("reason_other");
    const said = page.locator("main").getByText(why).filter({ hasNotText: "EDA9060A" });
    await said.first().waitFor();
    const own = (await ask("GET", "/points")).points.filter((point) => point.module === "pump");
    assert.ok(own.length > 0 && own.every((point) => point.reason === "other_model"), JSON.stringify(own[0]));
    const outputs = own.filter((point) => point.kind === "output");
    assert.equal(await said.count(), outputs.length, lang);
    const values = page.locator("main button.value");
    const labels = await values.evaluateAll((all) => all.map((one) => one.getAttribute("aria-label")));
    assert.equal(labels.length, own.length - outputs.length, lang);
    for (const label of labels) assert.ok(label.endsWith(why), label);
    assert.equal(await page.locator(GREEN).count(), 0, `${lang}: green`);
    // A note about silence would be untrue: it answers.
    assert.equal(await page.locator("main .note", { hasText: t("values_last") }).count(), 0, lang);
    await context.close();
  }
  assert.deepEqual(found, []);
});

test("the daemon ends while groups, rules, integrations and trends are looked at", async () => {
  const all = [];
  const SEEN = [["/groups", "article li"], ["/rules", "article .tag"], ["/integrations", "article .tag.bad"], ["/trends?points=oven.k1,tank.ai1&for=60", "section table tbody tr"]];
  for (const lang of ["en", "zh"]) {
    for (const [path, seen] of SEEN) {
      const one = await visitor(lang);
      await one.page.goto(daemon.origin + path);
      await one.page.locator(`main ${seen}`).first().waitFor();
      await one.page.locator(".connection.live").waitFor({ state: "attached" });
      all.push({ what: `${lang} gone ${path.split("?")[0]}`, ...one });
    }
  }
  await daemon.stop();
  for (const { what, context, page, t } of all) {
    await page.locator(".note.lost", { hasText: /\d\d:\d\d:\d\d/ }).waitFor();
    assert.equal(await page.locator(GREEN).count(), 0, `${what}: green`);
    assert.equal(await page.getByText(t("page_old")).count(), 0, what);
    assert.deepEqual(await measure(page, what), []);
    await context.close();
  }
});

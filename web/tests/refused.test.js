// What is refused is said where one looks, in the words of who asked: in forms, in a conflict, and to
// somebody who has no right to it; measured at every width.
import assert from "node:assert/strict";
import { test } from "node:test";
import { faults, open, PASSWORD, words } from "./daemon.js";
import { misplaced } from "./geometry.js";
import { browser, cookies, csrf, daemon } from "./site.js";

const WIDTHS = [360, 768, 1280, 1920];
const headers = () => ({ "X-CSRF-Token": csrf });

for (const lang of ["en", "zh"]) {
  const t = words(lang);
  const enter = async (path, own = cookies) => {
    const { context, page } = await open(browser, { lang, width: 1280, scheme: "light" });
    await context.addCookies(own);
    await page.goto(daemon.origin + path);
    await page.locator("main h1").first().waitFor();
    await page.locator(".connection.live").waitFor({ state: "attached" });
    return { context, page };
  };
  const sound = async (page, what) => {
    for (const width of WIDTHS) {
      await page.setViewportSize({ width, height: 800 });
      assert.deepEqual(await misplaced(page), [], `${what} ${width}`);
      if (process.env.SHOTS) await page.screenshot({ path: `${process.env.SHOTS}/${what}-${lang}-${width}.png` });
      if (width === 360 || width === 1280) assert.deepEqual(await faults(page), [], `${what} ${width}`);
    }
  };

  test(`a form: its fault stands in it, without a place in a file, and goes with the next try: ${lang}`, async () => {
    const { context, page } = await enter("/lines");
    await page.getByRole("button", { name: t("line_add"), exact: true }).click();
    const dialog = page.getByRole("dialog");
    await dialog.getByLabel(t("port_other")).check();
    await dialog.locator("#other").fill("COM3");
    await dialog.getByLabel(t("line_name")).fill("side");
    await dialog.getByRole("button", { name: t("line_add"), exact: true }).click();
    const fault = dialog.locator("#other-fault", { hasText: /\S/ });
    await fault.waitFor();
    const said = await fault.innerText();
    assert.doesNotMatch(said, /railbus\.toml|line\.side\.port/, said);
    assert.equal(await dialog.locator("#other").getAttribute("aria-invalid"), "true");
    assert.equal(await page.locator(".toast").count(), 0, "nothing is said behind the dialog");
    await sound(page, "form");
    // What is put right takes the fault with it.
    await dialog.locator("#other").fill("/dev/ttyNone9");
    await dialog.getByRole("button", { name: t("line_add"), exact: true }).click();
    await dialog.waitFor({ state: "detached" });
    assert.equal(await page.getByRole("alert").filter({ hasText: /\S/ }).count(), 0);
    const gone = await context.request.delete(`${daemon.origin}/api/v1/config/lines/side?modules=1`, { headers: headers() });
    assert.ok(gone.ok(), await gone.text());
    await context.close();
  });

  test(`addresses that are none are told beside their field, and nothing is asked: ${lang}`, async () => {
    const { context, page } = await enter("/discover");
    const field = page.locator("#addresses");
    const start = page.getByRole("button", { name: t("scan_start"), exact: true });
    await field.fill("abc");
    await page.getByText(t("addresses_form")).waitFor();
    assert.ok(await start.isDisabled());
    await field.fill("1-3, 0x40");
    await page.getByText(t("addresses_form")).waitFor({ state: "detached" });
    assert.ok(await start.isEnabled());
    await context.close();
  });

  test(`two change the configuration: who is later is told, and keeps the text: ${lang}`, async () => {
    const { context, page } = await enter("/backup");
    const field = page.getByLabel(t("config_text"));
    await field.waitFor();
    const text = await field.inputValue();
    await field.fill(`# mine\n${text}`);
    const now = await (await context.request.get(`${daemon.origin}/api/v1/config`)).json();
    const other = await context.request.put(`${daemon.origin}/api/v1/config`, {
      data: { text: `# other\n${now.text}` }, headers: { ...headers(), "If-Match": `"${now.etag}"` },
    });
    assert.ok(other.ok(), await other.text());
    await page.getByRole("button", { name: t("config_save"), exact: true }).click();
    await page.getByText(t("config_conflict")).waitFor();
    assert.match(await field.inputValue(), /^# mine/);
    await sound(page, "conflict");
    await context.close();
  });

  test(`who may only look is told so, and no switch answers: ${lang}`, async () => {
    const guest = `guest_${lang}`;
    const made = await browser.newContext();
    await made.addCookies(cookies);
    const answer = await made.request.post(`${daemon.origin}/api/v1/users`, {
      data: { name: guest, role: "viewer", points: [], password: PASSWORD }, headers: headers(),
    });
    assert.ok(answer.ok(), await answer.text());
    await made.close();
    const their = await browser.newContext();
    const login = await their.request.post(`${daemon.origin}/api/v1/login`, { data: { name: guest, password: PASSWORD } });
    assert.equal(login.status(), 200);
    const { context, page } = await enter("/", await their.cookies());
    await their.close();
    const first = page.locator("main button[role=switch]").first();
    await first.waitFor();
    const was = await first.getAttribute("aria-checked");
    assert.equal(await first.getAttribute("aria-disabled"), "true");
    assert.match(await first.getAttribute("title"), new RegExp(t("no_right")));
    await first.click({ force: true });
    assert.equal(await first.getAttribute("aria-checked"), was);
    assert.equal(await page.locator(".outcome > *").count(), 0);
    await sound(page, "no-rights");
    // A page that is not theirs is none.
    await page.goto(`${daemon.origin}/users`);
    await page.locator("main h1", { hasText: t("not_found") }).waitFor();
    await context.close();
  });

  test(`the search is one of the keyboard alone: ${lang}`, async () => {
    const { context, page } = await enter("/");
    await page.locator("main button[role=switch]").first().waitFor();
    await page.keyboard.press("/");
    await page.getByRole("combobox").waitFor();
    await page.keyboard.type("tank");
    await page.keyboard.press("Enter");
    await page.locator("main h1", { hasText: "tank" }).waitFor();
    assert.equal(await page.getByRole("dialog").count(), 0);
    await context.close();
  });
}

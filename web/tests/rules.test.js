// A rule from its sentence to its act: written, tried against the history, armed, and heard of.
import assert from "node:assert/strict";
import { test } from "node:test";
import { faults, LOOKS, open, until, words } from "./daemon.js";
import { ask, browser, cookies, csrf, daemon } from "./site.js";

const SHOWN = LOOKS.filter(({ lang, width }) => (lang === "zh") === (width === 360));

for (const [n, look] of SHOWN.entries()) {
  // Each has a point of its own, of which the history knows nothing but rest.
  const label = `do${n}`;
  test(`a rule: ${look.lang} ${look.width} ${look.scheme}`, async () => {
    const t = words(look.lang);
    const { context, page, wrong } = await open(browser, look);
    await context.addCookies(cookies);
    const sound = async () => assert.deepEqual([...wrong, ...(await faults(page))], []);
    const press = (name) => page.getByRole("button", { name, exact: true }).click();
    const within = page.getByRole("dialog");
    const choose = (label, value) => within.getByLabel(label, { exact: true }).first().selectOption(value);
    /** It says that nothing acted, and is asked once. */
    const rests = () => within.getByRole("img", { name: t("rule_acts_none") }).waitFor();
    // What is tried is what was kept, and a busy disk takes its time to make the file of it.
    await until(async () => (await ask("GET", "/storage")).points > 0);
    await page.goto(`${daemon.origin}/rules`);
    await page.getByText(t("rules_none")).waitFor();
    await page.locator(".connection.live").waitFor({ state: "attached" });

    await press(t("rule_new"));
    await within.getByLabel(t("set_name"), { exact: true }).fill("lamp");
    await choose(t("rule_kind_point"), `pump.${label}`);
    await within.locator("input[type=number]").first().fill("0.2");
    await within.getByLabel(t("outputs"), { exact: true }).selectOption("oven.k1");
    await press(t("rule_add"));
    // A text is missing: the browser says so, and nothing is sent.
    await press(t("save"));
    await within.getByLabel(t("rule_text")).fill("lamp");
    await sound();
    await press(t("save"));

    // What is written is tried at once, and nothing acted yet.
    await rests();
    await press(t("rule_try_week"));
    await rests();
    await sound();
    await press(t("rule_arm"));
    const card = page.locator("article");
    await card.getByText(t("rule_state_waiting")).waitFor();
    const armed = card.getByRole("switch");
    assert.equal(await armed.isChecked(), true);

    const put = (path, value) =>
      context.request.put(`${daemon.origin}/api/v1/points/${path}`, { data: { value }, headers: { "X-CSRF-Token": csrf } });
    assert.equal((await put("oven/k1", true)).status(), 200);
    assert.equal((await put(`pump/${label}`, true)).status(), 200);
    await card.getByText(t("rule_state_acted")).waitFor();
    const point = () => context.request.get(`${daemon.origin}/api/v1/points/oven/k1`);
    await until(async () => (await (await point()).json()).value === false);
    await sound();
    await card.getByRole("button", { name: `${t("rule_try")} lamp` }).click();
    await within.locator("li").first().waitFor();
    await sound();
    await within.getByRole("button", { name: t("close"), exact: true }).last().click();

    await armed.click();
    await card.getByText(t("rule_state_disarmed")).waitFor();
    await card.getByRole("button", { name: `${t("edit")} lamp` }).click();
    await within.getByLabel(t("rule_text")).fill("  ");
    await press(t("save"));
    await within.getByRole("alert").waitFor();
    // What was refused is a 422, which the browser writes down.
    wrong.length = 0;
    await sound();
    await page.keyboard.press("Escape");
    await card.getByRole("button", { name: `${t("remove")} lamp` }).click();
    await within.getByRole("button", { name: t("remove"), exact: true }).click();
    await page.getByText(t("rules_none")).waitFor();
    assert.equal((await put(`pump/${label}`, false)).status(), 200);
    assert.deepEqual(wrong, []);
    await context.close();
  });
}

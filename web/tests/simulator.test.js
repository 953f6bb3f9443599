// The front panels of the demo's modules: pressed, turned, let go wrong, in both languages.
import assert from "node:assert/strict";
import { test } from "node:test";
import { faults, LOOKS, open, words } from "./daemon.js";
import { browser, cookies, csrf, daemon } from "./site.js";

/** The page of one module's panel, and how the daemon is asked past it. */
async function simulator(look) {
  const { context, page, wrong } = await open(browser, look);
  await context.addCookies(cookies);
  await page.addInitScript((lang) => localStorage.setItem("railbus.lang", lang), look.lang);
  await page.goto(`${daemon.origin}/simulator`);
  await page.locator(".connection.live").waitFor({ state: "attached" });
  const panel = (name) => page.getByRole("region", { name, exact: true });
  await panel("pump").waitFor();
  const ask = async (method, path, data) => {
    const answer = await context.request.fetch(`${daemon.origin}/api/v1${path}`, {
      method,
      data,
      headers: { "X-CSRF-Token": csrf },
    });
    return { status: answer.status(), body: await answer.json() };
  };
  return { context, page, wrong, panel, ask, t: words(look.lang) };
}

for (const look of LOOKS) {
  test(`panels: ${look.lang} ${look.width} ${look.scheme}`, async () => {
    const { context, page, wrong, panel, ask, t } = await simulator(look);

    // What is switched over the line is seen at the module.
    const k1 = panel("oven").getByRole("button", { name: /^k1\b/ });
    assert.equal((await ask("PUT", "/points/oven/k1", { value: true })).status, 200);
    await k1.getByText(t("on"), { exact: true }).waitFor();

    // A relay that sticks, by the keyboard.
    await k1.focus();
    await page.keyboard.press("Enter");
    await k1.and(page.locator("[aria-pressed=true]")).waitFor();
    const refused = await ask("PUT", "/points/oven/k1", { value: false });
    assert.equal(refused.body.code, "E0601", JSON.stringify(refused));
    await k1.getByText(t("on"), { exact: true }).waitFor();
    await page.keyboard.press("Enter");
    await k1.and(page.locator("[aria-pressed=false]")).waitFor();
    assert.equal((await ask("PUT", "/points/oven/k1", { value: false })).status, 200);
    await k1.getByText(t("off"), { exact: true }).waitFor();

    // An input, and its way back to itself.
    const di6 = panel("gate").getByRole("button", { name: /^di6\b/ });
    const before = await di6.getAttribute("aria-pressed");
    await di6.click();
    await di6.and(page.locator(`[aria-pressed=${before === "true" ? "false" : "true"}]`)).waitFor();
    await di6.getByText(t("sim_by_hand")).waitFor();
    assert.deepEqual(await faults(page), []);
    await panel("gate").getByRole("button", { name: t("sim_auto") }).click();
    await di6.getByText(t("sim_by_hand")).waitFor({ state: "detached" });

    // A level, turned by the keyboard.
    const level = panel("tank").getByRole("slider", { name: /^ai1\b/ });
    await level.focus();
    await page.keyboard.press("End");
    await panel("tank").getByText(/10\.00 V/).waitFor();
    await panel("tank").getByRole("button", { name: t("sim_auto") }).click();
    await panel("tank").getByText(/10\.00 V/).waitFor({ state: "detached" });

    // A fault that stands is shown with what is left of it, and ended.
    await panel("pump").getByRole("button", { name: t("sim_mute") }).click();
    const end = panel("pump").getByRole("button", { name: new RegExp(`${t("sim_end")}.*mute 30s`) });
    await end.getByText(/\d+/).first().waitFor();
    assert.deepEqual(await faults(page), []);
    await end.click();
    await end.waitFor({ state: "detached" });
    // One bad reply is over as soon as it was given.
    await panel("yard").getByRole("button", { name: t("sim_bad") }).click();
    await panel("yard").getByRole("list").waitFor({ state: "detached" });

    // Without power nothing shines; without an adapter the panel is still seen.
    const power = panel("yard").getByRole("switch", { name: t("sim_power") });
    await power.click();
    await panel("yard").getByText(t("sim_dark").replace("{module}", "yard")).waitFor({ state: "attached" });
    await power.click();
    await panel("yard").getByText(t("sim_lit").replace("{module}", "yard")).waitFor({ state: "attached" });
    await page.getByRole("button", { name: t("sim_unplug") }).click();
    await page.getByText(t("sim_unplugged")).waitFor();
    await page.getByRole("button", { name: t("sim_plug") }).click();
    await page.getByText(t("sim_unplugged")).waitFor({ state: "detached" });

    // What the test asked for in vain is no fault of the page.
    assert.deepEqual(wrong, []);
    await context.close();
  });
}

test("who may only look sees the panels, and presses nothing", async () => {
  const { ask } = await simulator(LOOKS[0]);
  const password = "correct horse battery";
  const made = await ask("POST", "/users", { name: "guest", role: "viewer", points: [], password });
  assert.ok(made.status < 300, JSON.stringify(made));
  const { context, page } = await open(browser, LOOKS[0]);
  const login = await context.request.post(`${daemon.origin}/api/v1/login`, { data: { name: "guest", password } });
  assert.equal(login.status(), 200);
  await page.goto(`${daemon.origin}/simulator`);
  const pump = page.getByRole("region", { name: "pump", exact: true });
  await pump.waitFor();
  assert.equal(await pump.getByRole("button", { disabled: false }).count(), 0);
  assert.ok((await pump.getByRole("button", { disabled: true }).count()) > 8);
  await context.close();
});

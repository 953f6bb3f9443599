// Groups and scenes are made, changed and taken out on their page.
import assert from "node:assert/strict";
import { test } from "node:test";
import { faults, LOOKS, open, words } from "./daemon.js";
import { browser, cookies, daemon } from "./site.js";

for (const look of LOOKS.filter(({ lang, width }) => (lang === "zh") === (width === 360))) {
  const t = words(look.lang);
  const dialog = (page) => page.getByRole("dialog");
  const button = (page, name) => page.getByRole("button", { name, exact: true });
  const save = async (page) => {
    await button(dialog(page), t("save")).click();
    await dialog(page).waitFor({ state: "detached" });
  };

  test(`groups and scenes are edited: ${look.lang}, ${look.width} px`, async () => {
    const { context, page, wrong } = await open(browser, look);
    await context.addCookies(cookies);
    await context.addInitScript((lang) => localStorage.setItem("railbus.lang", lang), look.lang);
    await page.goto(`${daemon.origin}/groups`);
    const kept = async (kind, id) => {
      const all = await (await context.request.get(`${daemon.origin}/api/v1/${kind}s`)).json();
      return all[`${kind}s`].find((one) => one[kind] === id);
    };

    await button(page, t("group_new")).click();
    await page.getByLabel(t("set_name"), { exact: true }).fill("pumps");
    await page.getByLabel(t("name_zh")).fill("水泵");
    await page.getByLabel(t("name_en")).fill("Pumps");
    for (const path of ["pump.do0", "pump.do1"]) await page.getByLabel(t("output_add")).selectOption(path);
    await button(page, t("move_up").replace("{what}", "pump.do1")).click();
    assert.deepEqual(await faults(page), []);
    await save(page);
    const group = await kept("group", "pumps");
    assert.deepEqual([group.members, group.name], [["pump.do1", "pump.do0"], { en: "Pumps", zh: "水泵" }]);

    await button(page, t("user_edit").replace("{name}", "pumps")).click();
    await button(page, t("remove_point").replace("{point}", "pump.do0")).click();
    await save(page);
    assert.deepEqual((await kept("group", "pumps")).members, ["pump.do1"]);

    await button(page, t("scene_new")).click();
    await page.getByLabel(t("set_name"), { exact: true }).fill("start");
    await page.getByLabel(t("output_add")).selectOption("pump.do0");
    await button(page, t("scene_pause_add")).click();
    await page.getByLabel(t("output_add")).selectOption("pump.do0");
    await page.getByLabel("pump.do0", { exact: true }).last().selectOption({ label: t("off") });
    await page.getByLabel(t("scene_pause"), { exact: true }).fill("250");
    assert.deepEqual(await faults(page), []);
    await save(page);
    const steps = [{ path: "pump.do0", value: true }, { wait_ms: 250 }, { path: "pump.do0", value: false }];
    assert.deepEqual((await kept("scene", "start")).steps, steps);

    for (const [kind, id] of [["group", "pumps"], ["scene", "start"]]) {
      await button(page, t("remove_point").replace("{point}", id)).click();
      assert.deepEqual(await faults(page), []);
      await button(dialog(page), t("remove")).click();
      await button(page, t("remove_point").replace("{point}", id)).waitFor({ state: "detached" });
      assert.equal(await kept(kind, id), undefined);
    }
    assert.deepEqual([...wrong, ...(await faults(page))], []);
    await context.close();
  });
}

// What people call lines, modules and points: asked for in the page's language first, shown before
// what they are called in the file; and what else is said of a module and of a point in their forms.
import assert from "node:assert/strict";
import { test } from "node:test";
import { faults, open, until, words } from "./daemon.js";
import { misplaced } from "./geometry.js";
import { ask, browser, cookies, daemon } from "./site.js";

async function visitor(lang, width) {
  const { context, page, wrong } = await open(browser, { lang, width, scheme: "light" });
  await context.addCookies(cookies);
  return { context, page, wrong, t: words(lang), dialog: page.getByRole("dialog") };
}

const fill = (text, gaps) => text.replace(/\{(\w+)\}/g, (_, name) => gaps[name]);
const sound = async (page, wrong) => assert.deepEqual([...wrong, ...(await misplaced(page)), ...(await faults(page))], []);

async function shot(page, name) {
  if (process.env.SHOTS) await page.screenshot({ path: `${process.env.SHOTS}/names-${name}.png`, fullPage: true });
}

const NAMES = {
  en: { module: "Pump house", line: "Yard line", area: "Cellar", other: "泵房" },
  zh: { module: "一号泵房", line: "院子总线", area: "地下室", other: "Pump house" },
};

for (const [lang, width] of [["en", 360], ["zh", 360], ["en", 1280], ["zh", 1280]]) {
  test(`a module and a line are called something, everywhere: ${lang} ${width}`, async () => {
    const { context, page, wrong, t, dialog } = await visitor(lang, width);
    const name = NAMES[lang];
    const edit = (what) => page.getByRole("button", { name: fill(t("point_edit"), { point: what }), exact: true });
    const save = async () => {
      await dialog.getByRole("button", { name: t("save"), exact: true }).click();
      await dialog.waitFor({ state: "detached" });
    };

    await page.goto(`${daemon.origin}/module/pump`);
    await edit("pump").click();
    // The first field is the name in the language of the page.
    const first = dialog.locator("input").first();
    assert.equal(await first.getAttribute("lang"), lang === "zh" ? "zh-CN" : "en");
    await first.fill(name.module);
    await dialog.getByLabel(t("area"), { exact: true }).fill(name.area);
    await until(async () => dialog.getByRole("button", { name: t("save"), exact: true }).isEnabled());
    await sound(page, wrong);
    await shot(page, `form-${lang}-${width}`);
    await save();
    await page.locator("main h1", { hasText: name.module }).waitFor();
    await sound(page, wrong);

    await page.goto(`${daemon.origin}/lines`);
    await edit("main").click();
    await dialog.locator("input").first().fill(name.line);
    await sound(page, wrong);
    await save();
    await page.locator("main h2", { hasText: name.line }).waitFor();
    await page.getByRole("link", { name: name.module, exact: true }).waitFor();
    await sound(page, wrong);
    await shot(page, `lines-${lang}-${width}`);

    await ask("PUT", "/points/pump/do1", { value: true, confirm: true });
    await page.goto(daemon.origin);
    const card = page.locator("article", { has: page.getByRole("link", { name: name.module, exact: true }) });
    await card.getByText("pump", { exact: true }).waitFor();
    await page.getByRole("heading", { name: name.area, exact: true }).waitFor();
    await sound(page, wrong);
    await shot(page, `overview-${lang}-${width}`);
    await page.getByLabel(t("area"), { exact: true }).selectOption(name.area);
    await until(async () => (await page.locator("article").count()) === 1);
    await page.getByRole("button", { name: t("as_list"), exact: true }).click();
    await page.getByRole("row", { name: new RegExp(`${name.module}.*pump.*${name.area}`, "s") }).waitFor();
    await sound(page, wrong);
    await page.getByRole("button", { name: t("as_list"), exact: true }).click();

    const point = new RegExp(`${name.module} · .* \\(pump\\.do1\\)`);
    for (const path of ["/events?kind=write", "/events/audit", "/trends?points=pump.do1&for=60"]) {
      await page.goto(daemon.origin + path);
      await page.locator("main").getByText(path.includes("audit") ? `${name.module} (pump)` : point).first().waitFor();
      await sound(page, wrong);
      await shot(page, `${path.slice(1, 6)}-${lang}-${width}`);
    }
    await page.goto(`${daemon.origin}/rules`);
    await page.getByRole("button", { name: t("rule_new"), exact: true }).click();
    // What it is about and what it does is chosen, and nothing is by itself.
    const about = dialog.getByLabel(t("rule_kind_point"), { exact: true });
    assert.equal(await about.inputValue(), "");
    assert.equal(await dialog.getByLabel(t("outputs"), { exact: true }).inputValue(), "");
    assert.match(await about.locator("option[value='pump.do1']").innerText(), point);
    await dialog.getByLabel(t("name_en"), { exact: true }).fill("Café  Pump 1");
    assert.equal(await dialog.getByLabel(t("set_name"), { exact: true }).inputValue(), "cafe_pump_1");
    await sound(page, wrong);
    await context.close();
    await ask("PATCH", "/config/modules/pump", { name: null, area: null });
    await ask("PATCH", "/config/lines/main", { name: null });
  });

  test(`what a point measures, what guards it, and that it is hidden: ${lang} ${width}`, async () => {
    const { context, page, wrong, t, dialog } = await visitor(lang, width);
    const edit = (what) => page.getByRole("button", { name: new RegExp(`^${t("point_edit").split("{")[0]}.*\\b${what.replace(".", "\\.")}\\b`) });
    const save = async () => {
      await dialog.getByRole("button", { name: t("save"), exact: true }).click();
      await dialog.waitFor({ state: "detached" });
    };
    const label = (key) => dialog.getByLabel(t(key), { exact: true });
    const of = async (module) => (await ask("GET", `/config/modules/${module}`)).keys;

    await page.goto(`${daemon.origin}/module/tank`);
    await edit("tank.ai1").click();
    await until(async () => dialog.getByRole("button", { name: t("save"), exact: true }).isEnabled());
    await label("point_range").selectOption("own");
    await label("range_signal").selectOption("0-10V");
    await label("range_low").fill("0");
    await label("range_high").fill("16");
    await label("range_unit").fill("bar");
    await sound(page, wrong);
    await shot(page, `range-${lang}-${width}`);
    await save();
    assert.deepEqual((await of("tank")).point.ai1.range, { signal: "0-10V", low: 0, high: 16, unit: "bar", decimals: 1 });
    // The value is what the register stands for, and never the old number in the new unit.
    let now;
    await until(async () => (now = await ask("GET", "/points/tank/ai1")).quality === "good");
    assert.equal(now.unit, "bar");
    assert.ok(Math.abs(now.value - (now.raw / 1_000) * 16) < 1e-9, JSON.stringify(now));
    await page.locator("main .value.analog", { hasText: "bar" }).first().waitFor();

    await page.goto(`${daemon.origin}/module/oven`);
    await edit("oven.k7").click();
    await until(async () => dialog.getByRole("button", { name: t("save"), exact: true }).isEnabled());
    await label("point_max_on").fill("90");
    await label("point_min_off").fill("0.5");
    await label("point_interlock").selectOption("oven.k8");
    await label("point_on_exit").selectOption("off");
    await label("point_on_offline").selectOption("hold");
    await label("point_hidden").check();
    await sound(page, wrong);
    await shot(page, `guards-${lang}-${width}`);
    await save();
    const kept = (await of("oven")).point.k7;
    assert.deepEqual(kept, { ...kept, max_on: "90s", min_off: "500ms", interlock: ["oven.k8"], on_exit: "off", on_offline: "hold", hidden: true });

    // It is left out until it is asked for.
    await page.locator("main #k7").waitFor({ state: "detached" });
    await page.goto(daemon.origin);
    const card = page.locator("article", { has: page.locator('a[href="/module/oven"]') });
    await card.locator("#k8").waitFor();
    assert.equal(await card.locator("#k7").count(), 0);
    await page.getByRole("button", { name: fill(t("show_hidden"), { n: 1 }), exact: true }).click();
    await card.locator("#k7").waitFor();
    await sound(page, wrong);

    await page.goto(`${daemon.origin}/module/oven`);
    await page.getByRole("button", { name: fill(t("show_hidden"), { n: 1 }), exact: true }).click();
    await edit("oven.k7").click();
    await until(async () => dialog.getByRole("button", { name: t("save"), exact: true }).isEnabled());
    assert.equal(await label("point_max_on").inputValue(), "90");
    assert.equal(await label("point_on_exit").inputValue(), "off");
    await label("point_max_on").fill("");
    await label("point_hidden").uncheck();
    await save();
    const after = (await of("oven")).point.k7;
    assert.deepEqual([after.max_on, after.hidden, after.on_exit], [undefined, undefined, "off"]);
    await context.close();
    await ask("PATCH", "/config/points/tank/ai1", { range: null });
    await ask("PATCH", "/config/points/oven/k7", { min_off: null, interlock: null, on_exit: null, on_offline: null });
  });
}

test("a board that does not tell its channels is asked for them, and a silent one is explained", async () => {
  await ask("DELETE", "/config/groups/night");
  await ask("DELETE", "/config/scenes/evening");
  await ask("DELETE", "/config/modules/yard");
  const { context, page, wrong, t, dialog } = await visitor("zh", 360);
  await page.goto(`${daemon.origin}/discover`);
  await page.getByRole("button", { name: t("scan_start"), exact: true }).click();
  const found = page.locator("main li", { hasText: "0x55" });
  await found.getByLabel(new RegExp(t("board_outputs"))).waitFor();
  await page.locator(".tag.good", { hasText: t("op_done") }).waitFor();
  const add = page.getByRole("button", { name: new RegExp(t("scan_add").split("{")[0]) });
  assert.equal(await add.isEnabled(), false, "not without their number");
  await sound(page, wrong);
  await shot(page, "board-zh-360");
  await found.getByPlaceholder(t("module_called")).fill("Yard board");
  await found.getByLabel(new RegExp(t("board_outputs"))).fill("30");
  assert.equal(await found.getByLabel(new RegExp(t("module_name"))).inputValue(), "yard_board");
  await add.click();
  await page.getByText(fill(t("scan_known"), { name: "Yard board (yard_board)" })).waitFor();
  const board = (await ask("GET", "/config/modules/yard_board")).keys;
  assert.deepEqual([board.outputs, board.name], [30, { zh: "Yard board" }]);
  await sound(page, wrong);

  await page.goto(`${daemon.origin}/module/yard_board`);
  await page.getByRole("button", { name: fill(t("point_edit"), { point: "yard_board" }), exact: true }).click();
  await dialog.getByLabel(t("board_outputs"), { exact: true }).fill("8");
  await dialog.getByRole("button", { name: t("save"), exact: true }).click();
  await dialog.waitFor({ state: "detached" });
  assert.equal((await ask("GET", "/config/modules/yard_board")).keys.outputs, 8);
  await context.close();
});

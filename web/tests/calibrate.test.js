// A calibration, led step by step from the settings of a module.
import assert from "node:assert/strict";
import { afterEach, test } from "node:test";
import { faults, LOOKS, open, words } from "./daemon.js";
import { browser, cookies, daemon } from "./site.js";

let context, page, wrong;

afterEach(() => context?.close());

// While the line is lent its modules can't be asked: a 503, which the browser writes down.
const sound = async () => assert.deepEqual([...wrong.filter((one) => !one.includes("503")), ...(await faults(page))], []);

async function begin(lang, width) {
  const look = LOOKS.find((one) => one.lang === lang && one.width === width);
  ({ context, page, wrong } = await open(browser, look));
  await context.addCookies(cookies);
  await page.goto(`${daemon.origin}/module/tank/settings`);
  return words(lang);
}

const press = (name) => page.getByRole("button", { name, exact: true }).click();
const zero = (t) => page.getByText(t("cal_zero").replace("{module}", "tank")).waitFor();

test("both steps are asked for and done, and the readings stand side by side", async () => {
  const t = await begin("en", 1280);
  await press(t("cal_begin"));
  await zero(t);
  await sound();
  // Who comes back finds it where it is.
  await page.reload();
  await zero(t);
  await press(t("cal_zero_go"));
  await page.getByText(t("cal_span").replace("{volts}", "5.00").replace("{module}", "tank")).waitFor();
  await press(t("cal_span_go"));
  await page.getByText(t("cal_done")).waitFor();
  for (const when of ["cal_before", "cal_after_zero", "cal_after_span"]) {
    const row = page.getByRole("row", { name: t(when) });
    assert.match(await row.innerText(), /\d\.\d\d\s+\d+\.\d\d/);
  }
  await sound();
});

test("it can be stopped at a step", async () => {
  const t = await begin("zh", 360);
  await press(t("cal_begin"));
  await zero(t);
  await sound();
  await press(t("cal_stop"));
  await page.getByText(t("cal_stopped")).waitFor();
  await sound();
});

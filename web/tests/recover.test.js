// A module that was lost is looked for from its own page.
import assert from "node:assert/strict";
import { afterEach, test } from "node:test";
import { faults, LOOKS, open, until, words } from "./daemon.js";
import { ask, browser, cookies, daemon } from "./site.js";

let context, page, wrong;

afterEach(() => context?.close());

// A module that does not answer is a 502 or a 504, which the browser writes down.
const sound = async () =>
  assert.deepEqual([...wrong.filter((one) => !/502|504/.test(one)), ...(await faults(page))], []);

async function begin(lang, width) {
  const look = LOOKS.find((one) => one.lang === lang && one.width === width);
  ({ context, page, wrong } = await open(browser, look));
  await context.addCookies(cookies);
  return words(lang);
}

/** A module gets address 9 behind the back of the configuration, by this frame. */
async function move(name, bytes) {
  await until(async () => {
    // On a busy machine the module may hear it in one piece with the request before, and ignore both; and
    // the reply may come too late. Once it has moved, nobody has this address.
    await ask("POST", "/lines/main/send", { protocol: "rtu", bytes, complete: true, confirm: ["settings"] });
    const { lines } = await ask("GET", "/sim");
    return lines[0].modules.find(({ module }) => module === name).address === 9;
  });
}

const press = (name) => page.getByRole("button", { name, exact: true }).click();

test("a module that moved is found, and the configuration follows", async () => {
  const t = await begin("en", 1280);
  await move("oven", "03 06 00 00 00 09");
  await page.goto(`${daemon.origin}/module/oven/settings`);
  await page.getByRole("heading", { name: t("rec"), exact: true }).waitFor();
  await sound();
  await press(t("rec_begin"));
  await page.getByText(t("rec_moved").replace("{place}", "9 (09h), 9600 8N1")).waitFor();
  assert.equal(await page.getByLabel(t("set_address"), { exact: true }).inputValue(), "9");
  await sound();
});

test("two on one address are parted step by step", async () => {
  const t = await begin("zh", 360);
  await move("tank", "05 06 00 01 00 09");
  await page.goto(`${daemon.origin}/module/oven/settings`);
  await press(t("rec_begin"));
  await page.getByRole("heading", { name: t("part"), exact: true }).waitFor();
  await page.getByText(t("part_plug"), { exact: true }).waitFor();
  await sound();
});

// A module that was lost is looked for from its own page.
import assert from "node:assert/strict";
import { afterEach, test } from "node:test";
import { faults, LOOKS, open, words } from "./daemon.js";
import { browser, cookies, csrf, daemon } from "./site.js";

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

/** Writes a register of a module behind the back of the configuration. */
async function write(bytes) {
  // On a busy machine a frame may be cut in two by a pause, and is none then.
  for (let tries = 0; tries < 3; tries++) {
    const sent = await context.request.post(`${daemon.origin}/api/v1/lines/main/send`, {
      data: { protocol: "rtu", bytes, complete: true, confirm: ["settings"] },
      headers: { "X-CSRF-Token": csrf },
    });
    assert.equal(sent.status(), 200, await sent.text());
    if ((await sent.json()).outcome === "answered") return;
  }
}

const press = (name) => page.getByRole("button", { name, exact: true }).click();

test("a module that moved is found, and the configuration follows", async () => {
  const t = await begin("en", 1280);
  await write("03 06 00 00 00 09");
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
  await write("05 06 00 01 00 09");
  await page.goto(`${daemon.origin}/module/oven/settings`);
  await press(t("rec_begin"));
  await page.getByRole("heading", { name: t("part"), exact: true }).waitFor();
  await page.getByText(t("part_plug"), { exact: true }).waitFor();
  await sound();
});

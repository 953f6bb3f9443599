// What a module keeps, changed from its page: the difference, the write, the proof, the way back.
import assert from "node:assert/strict";
import { afterEach, test } from "node:test";
import { faults, LOOKS, open, words } from "./daemon.js";
import { browser, cookies, csrf, daemon } from "./site.js";

let context, page, wrong;

afterEach(() => context?.close());

const sound = async () => assert.deepEqual([...wrong, ...(await faults(page))], []);

async function begin(lang, width) {
  const look = LOOKS.find((one) => one.lang === lang && one.width === width);
  ({ context, page, wrong } = await open(browser, look));
  await context.addCookies(cookies);
  return words(lang);
}

const told = async (path) => (await context.request.get(`${daemon.origin}/api/v1${path}`)).json();
const addressOf = async (name) =>
  (await told("/modules")).modules.find(({ module }) => module === name)?.address;
const one = (text) => text.replace("{n}", 1);
const press = (name) => page.getByRole("button", { name, exact: true }).click();

test("an address is compared, written, verified and taken back; a name too", async () => {
  const t = await begin("en", 1280);
  await page.goto(`${daemon.origin}/module/oven`);
  await page.getByRole("link", { name: t("tab_settings"), exact: true }).click();
  const address = page.getByLabel(t("set_address"), { exact: true });
  assert.equal(await address.inputValue(), "3");
  await page.getByText(t("set_none")).waitFor();
  await sound();

  // With the keyboard alone: Enter in the field compares.
  await address.fill("9");
  await address.press("Enter");
  const dialog = page.getByRole("dialog");
  const row = dialog.getByRole("row", { name: /^Address/ });
  assert.match(await row.innerText(), /3\s+9/);
  await dialog.getByText(/^03 06 /).waitFor();
  assert.equal(await addressOf("oven"), 3, "nothing was written");
  await sound();
  await dialog.getByRole("button", { name: t("set_write"), exact: true }).click();

  await page.getByText(/^Verified: read back at 9 \(09h\)/).waitFor();
  await page.getByText(/Address 3 → 9/).waitFor();
  assert.equal(await addressOf("oven"), 9);
  await sound();

  await press(one(t("set_undo_n")));
  const back = dialog.getByRole("row", { name: /^Address/ });
  assert.match(await back.innerText(), /9\s+3/);
  await dialog.getByRole("button", { name: t("set_write"), exact: true }).click();
  await page.getByText(/^Verified: read back at 3 \(03h\)/).waitFor();
  await page.getByText(one(t("set_undoes"))).waitFor();
  assert.equal(await addressOf("oven"), 3);

  await press(t("point_edit").replace("{point}", "oven"));
  await dialog.getByLabel(t("set_name"), { exact: true }).fill("kiln");
  await dialog.getByRole("button", { name: t("save"), exact: true }).click();
  await page.waitForURL("**/module/kiln/settings");
  assert.equal(await addressOf("kiln"), 3);
  await press(t("undo"));
  await page.waitForURL("**/module/oven/settings");
  await sound();
});

test("an address that is taken is refused, and told in Chinese on a phone", async () => {
  const t = await begin("zh", 360);
  await page.goto(`${daemon.origin}/module/oven/settings`);
  // Who is configured there is said at the field, before anything is asked.
  await page.getByLabel(t("set_address"), { exact: true }).fill("5");
  await page.getByText(t("set_address_taken").replace("{module}", "tank")).waitFor();
  assert.equal(await page.getByRole("button", { name: t("set_compare"), exact: true }).isEnabled(), false);
  await sound();
  // One that the configuration does not know is found by asking.
  const headers = { "X-CSRF-Token": csrf };
  const { text } = await (await context.request.get(`${daemon.origin}/api/v1/config`)).json();
  const gone = await context.request.delete(`${daemon.origin}/api/v1/config/modules/tank`, { headers });
  assert.equal(gone.status(), 200, await gone.text());
  await press(t("set_compare"));
  await sound();
  await page.getByRole("dialog").getByRole("button", { name: t("set_write"), exact: true }).click();
  await page.getByText("E0440").waitFor();
  await page.getByText(/新地址已被占用/).first().waitFor();
  assert.equal(await addressOf("oven"), 3);
  await sound();
  const back = await context.request.put(`${daemon.origin}/api/v1/config`, { data: { text }, headers: { ...headers, "If-Match": "*" } });
  assert.equal(back.status(), 200, await back.text());
});

test("the registers of a module stand beside what its data sheet says", async () => {
  const t = await begin("en", 360);
  await page.goto(`${daemon.origin}/module/tank/registers`);
  const row = page.getByRole("row", { name: /calibration voltage/ });
  assert.match(await row.innerText(), /^4\s.*500\s+500\s+01F4\s+0000 0001 1111 0100\s+\[EMD-2A2Q §4\.5\]/s);
  await page.getByRole("button", { name: t("set_reread"), exact: true }).waitFor();
  await sound();
});

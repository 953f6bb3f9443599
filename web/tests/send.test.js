// A frame of one's own: what it may do is told while it is typed, and nothing goes out that was not meant.
import assert from "node:assert/strict";
import { afterEach, test } from "node:test";
import { faults, LOOKS, open, words } from "./daemon.js";
import { browser, cookies, csrf, daemon } from "./site.js";

let context, page, wrong, dialog;

afterEach(() => context?.close());

// What is no frame yet is a 422, which the browser writes down.
const sound = async () => assert.deepEqual([...wrong.filter((one) => !one.includes("422")), ...(await faults(page))], []);
const told = async (path) => (await context.request.get(`${daemon.origin}/api/v1${path}`)).json();
const k1 = async () => (await told("/points/oven/k1?fresh=1")).value;

async function begin(lang, width) {
  const look = LOOKS.find((one) => one.lang === lang && one.width === width);
  ({ context, page, wrong } = await open(browser, look));
  await context.addCookies(cookies);
  const t = words(lang);
  await page.goto(`${daemon.origin}/lines/main/scope`);
  await page.getByRole("button", { name: t("send_open") }).click();
  dialog = page.getByRole("dialog");
  const go = dialog.getByRole("button", { name: t("send_now"), exact: true });
  const frame = dialog.getByLabel(t("send_bytes"), { exact: true });
  return { t, go, frame };
}

test("a read is decoded while it is typed, sent, and its reply told with the time", async () => {
  const { t, go, frame } = await begin("en", 1280);
  assert.equal(await go.isDisabled(), true);
  await frame.fill("03 01 00 3C 00 0");
  await dialog.getByText("E0808").waitFor();
  assert.equal(await go.isDisabled(), true);
  await frame.fill("03 01 00 3C 00 08");
  await dialog.getByText("03 01 00 3C 00 08 FC 22").waitFor();
  await dialog.getByText(t("send_reads")).waitFor();
  await sound();
  await frame.press("Enter");
  await dialog.getByText(/^after [\d.]+ ms$/).waitFor();
  await dialog.getByText("←").first().waitFor();
  // Nobody has address 30, and it is said.
  await frame.fill("1E 01 00 3C 00 08");
  await dialog.getByText(/^1E 01 00 3C 00 08 \w\w \w\w$/).waitFor();
  await go.click();
  await dialog.getByText(t("send_silent"), { exact: true }).waitFor();
  await dialog.getByLabel(t("protocol")).selectOption("ascii");
  await frame.fill("$016");
  await dialog.getByText("24 30 31 36 0D").waitFor();
  await sound();
});

test("what may change something is sent only where each of its dangers is meant", async () => {
  const { t, go, frame } = await begin("zh", 360);
  const lock = await context.request.patch(`${daemon.origin}/api/v1/config/points/oven/k2`, {
    data: { locked: true },
    headers: { "X-CSRF-Token": csrf },
  });
  assert.equal(lock.status(), 200);
  await frame.fill("03 05 00 3C FF 00");
  await dialog.getByText(t("send_may")).waitFor();
  await dialog.getByText(/oven\.k2 的限制：锁定/).waitFor();
  assert.equal(await go.isDisabled(), true);
  await dialog.getByLabel(t("send_mean_output")).check();
  assert.equal(await go.isDisabled(), true, "it goes past a lock");
  await dialog.getByLabel(t("send_mean_override")).check();
  await sound();
  assert.equal(await k1(), false, "nothing was sent");
  await go.click();
  await dialog.getByText(t("send_anew")).waitFor();
  assert.equal(await k1(), true);
  assert.equal(await go.isDisabled(), true, "each time it is meant anew");
  await sound();

  // For all modules at once it is typed.
  await dialog.getByLabel(t("protocol")).selectOption("r55");
  await frame.fill("55 F5 13 00 00 00 FF");
  const word = dialog.getByLabel(t("send_mean_broadcast").replace("{word}", "broadcast"));
  await word.fill("broadcas");
  assert.equal(await go.isDisabled(), true);
  await word.fill("broadcast");
  await go.click();
  await dialog.getByText(t("send_unanswered")).waitFor();
  assert.equal((await told("/points/yard/k1?fresh=1")).value, true);
});

// Pages against a mock that speaks the contract of the API: what the demo has none of, or what
// would take long there.
import assert from "node:assert/strict";
import { test } from "node:test";
import { faults, LOOKS, open, words } from "./daemon.js";
import { browser, server } from "./mocked.js";

const PAGES = ["/groups", "/system", "/users", "/events", "/trends", "/backup"];

for (const look of LOOKS) {
  test(`contract: ${look.lang} ${look.width} ${look.scheme}`, async () => {
    const { context, page, wrong } = await open(browser, look);
    for (const path of PAGES) {
      await page.goto(server.address + path);
      await page.locator("main h1").waitFor();
      await page.waitForLoadState("networkidle");
      wrong.push(...(await faults(page)).map((fault) => `${path} ${fault}`));
    }
    assert.deepEqual(wrong, []);
    await context.close();
  });
}

test("a group with a guarded output asks first, and tells what was not done", async () => {
  const t = words("en");
  const { context, page } = await open(browser, LOOKS[0]);
  await page.goto(`${server.address}/groups`);
  await page.getByRole("button", { name: t("group_on") }).click();
  await page.getByRole("dialog").getByText(/pump\.do0/).waitFor();
  assert.deepEqual(await faults(page), []);
  await page.getByRole("dialog").getByRole("button", { name: t("group_on") }).click();
  const told = page.getByRole("alert");
  await told.waitFor();
  assert.match(await told.innerText(), /pump\.do1\)? E0301/);
  await context.close();
});

test("an event is acknowledged with a comment", async () => {
  const t = words("en");
  const { context, page } = await open(browser, LOOKS[0]);
  await page.goto(`${server.address}/events`);
  const event = page.locator(".event", { hasText: t("code_module_offline") });
  await event.getByRole("button", { name: t("ack") }).click();
  await page.getByLabel(t("ack_comment")).fill("fuse replaced");
  await page.getByRole("dialog").getByRole("button", { name: t("ack") }).click();
  await event.getByText(/acknowledged by anna “fuse replaced”/).waitFor();
  assert.equal(await event.getByRole("button").count(), 0);
  await context.close();
});

test("a long list comes page by page, and a filter begins anew", async () => {
  const t = words("en");
  const { context, page } = await open(browser, LOOKS[0]);
  await page.goto(`${server.address}/events`);
  const events = page.locator(".event");
  await page.getByRole("button", { name: t("more_events") }).click();
  await page.getByText(t("events_end")).waitFor();
  assert.equal(await events.count(), 96);
  await page.getByLabel(t("kind"), { exact: true }).selectOption("module");
  await page.waitForFunction(() => document.querySelectorAll(".event").length === 2);
  assert.match(page.url(), /kind=module/);
  await context.close();
});

test("a configuration that somebody else has changed is not overwritten", async () => {
  const t = words("en");
  const { context, page } = await open(browser, LOOKS[0]);
  await page.goto(`${server.address}/backup`);
  const field = page.getByLabel(t("config_text"));
  const text = await field.inputValue();
  const other = await context.request.put(`${server.address}/api/v1/config`, {
    data: { text: `${text}# theirs\n` },
    headers: { "If-Match": '"e3"', "X-CSRF-Token": "proof" },
  });
  assert.equal(other.status(), 200);
  await field.fill(`${text}# mine\n`);
  await page.getByRole("button", { name: t("config_save") }).click();
  await page.getByText(t("config_conflict")).waitFor();
  assert.match(await field.inputValue(), /# mine/);
  await page.getByRole("button", { name: t("config_reload") }).click();
  await page.waitForFunction(() => document.querySelector("textarea").value.endsWith("# theirs\n"));
  await context.close();
});

test("what fails in a dialog is shown in it, until the next attempt", async () => {
  const t = words("en");
  const { context, page } = await open(browser, LOOKS[1]);
  const answers = [
    { status: 422, json: { status: 422, code: "E0905", title: "refused", detail: "the old password is wrong", help: ["ask an admin"] } },
    { status: 200, json: { changed: "anna" } },
  ];
  await page.route("**/api/v1/password", (route) => route.fulfill(answers.shift()));
  await page.goto(server.address);
  await page.getByRole("button", { name: t("user_menu") }).click();
  await page.getByRole("button", { name: t("password_change") }).click();
  const dialog = page.getByRole("dialog");
  await dialog.getByLabel(t("password_old")).fill("wrong horse");
  await dialog.getByLabel(t("password_new"), { exact: true }).fill("correct horse battery");
  await dialog.getByRole("button", { name: t("save") }).click();
  const told = dialog.getByRole("alert");
  await told.waitFor();
  assert.match(await told.innerText(), /E0905 the old password is wrong\s+ask an admin/);
  assert.equal(await page.locator(".toast").count(), 0, "nothing is shown behind the dialog");
  await dialog.getByRole("button", { name: t("save") }).click();
  await dialog.waitFor({ state: "detached" });
  await page.getByText(t("password_changed")).waitFor();
  await context.close();
});

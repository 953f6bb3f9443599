// What those do who look after a site: trends, events, users, tokens, the configuration.
import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { beforeEach, afterEach, test } from "node:test";
import { faults, LOOKS, open, PASSWORD, words } from "./daemon.js";
import { browser, cookies, csrf, daemon } from "./site.js";

const t = words("en");
let context, page, wrong;

beforeEach(async () => {
  ({ context, page, wrong } = await open(browser, LOOKS.find(({ lang, width }) => lang === "en" && width === 1280)));
  await context.addCookies(cookies);
});

afterEach(() => context.close());

const press = (name) => page.getByRole("button", { name, exact: true }).click();
const visit = (path) => page.goto(daemon.origin + path);
const sound = async () => assert.deepEqual([...wrong, ...(await faults(page))], []);
const put = (path, data) =>
  context.request.put(`${daemon.origin}/api/v1${path}`, { data, headers: { "X-CSRF-Token": csrf } });

test("a switched relay is in its trend, in the events and in the audit", async () => {
  const done = await put("/points/pump/do0", { value: true, confirm: true });
  assert.equal(done.status(), 200, await done.text());

  await visit("/trends?points=pump.do0,tank.ai1&for=60");
  const marks = page.locator(".marks li");
  await marks.first().waitFor();
  assert.match(await marks.first().innerText(), /admin\s+Pump 1 \(pump\.do0\): on/);
  const row = page.locator("tbody tr", { hasText: "pump.do0" });
  await row.getByText(/^on for/).waitFor();
  await sound();

  await visit("/events?kind=write");
  const event = page.locator(".event").first();
  await event.waitFor();
  assert.match(await event.innerText(), /Pump 1 \(pump\.do0\) on/);
  assert.match(await event.innerText(), /admin · http.* confirmed by read-back/s);

  await page.getByRole("link", { name: t("audit"), exact: true }).click();
  await press(t("audit_verify"));
  await page.getByText(/Intact: \d+ entries/).waitFor();
  await sound();
});

test("a chart is read, measured and moved with the keyboard alone", async () => {
  await visit("/trends?points=tank.ai1&for=60");
  const chart = page.getByRole("slider");
  await page.waitForFunction(() => /tank\.ai1\)? [\d.]+ V/.test(document.querySelector("[role=slider]")?.ariaValueText ?? ""));
  await press(t("go_live"));
  await chart.focus();
  for (const key of ["a", "End", "b", "End", "Shift+ArrowLeft"]) await page.keyboard.press(key);
  await page.getByText(/^A to B: 6(\.\d)? s$/).waitFor();
  assert.match(await chart.getAttribute("aria-valuetext"), /^B \d{4}-/);
  const { search, searchParams: before } = new URL(page.url());
  await page.keyboard.press("+");
  await page.waitForFunction((old) => location.search !== old, search);
  const after = new URL(page.url()).searchParams;
  const span = (asked) => Date.parse(asked.get("to")) - Date.parse(asked.get("from"));
  assert.ok(Math.abs(span(after) - span(before) / 2) <= 2, `${span(before)} then ${span(after)}`);
  await page.keyboard.press("Escape");
  await page.getByText(/^Visible range: 30 s$/).waitFor();
  // What was looked at is in the address.
  await page.reload();
  await page.getByText(/^Visible range: 30 s$/).waitFor();
});

test("a chart is zoomed by the wheel, dragged, measured by clicks, read as a table, saved as CSV", async () => {
  await visit("/trends?points=tank.ai1,pump.do0&for=600");
  const canvas = page.locator("canvas");
  await canvas.waitFor();
  const box = await canvas.boundingBox();
  const at = (part) => [box.x + 52 + (box.width - 62) * part, box.y + 120];
  await page.mouse.move(...at(1));
  await page.mouse.wheel(0, -462.4);
  await page.getByText(/^Visible range: 5 min$/).waitFor();
  const begin = () => Date.parse(new URL(page.url()).searchParams.get("from"));
  await page.waitForFunction(() => location.search.includes("from="));
  const before = begin();
  await page.mouse.move(...at(0.2));
  await page.mouse.down();
  await page.mouse.move(...at(0.7), { steps: 4 });
  await page.mouse.up();
  assert.ok(Math.abs(before - begin() - 150_000) < 2_000, `moved by ${before - begin()}`);
  await page.mouse.click(...at(0.25));
  await page.mouse.click(...at(0.75));
  await page.getByText(/^A to B: [23] min$/).waitFor();
  await press(t("as_table"));
  assert.equal(await page.locator("table").last().locator("tbody tr").count(), 24);
  const [file] = await Promise.all([page.waitForEvent("download"), press("CSV")]);
  const lines = readFileSync(await file.path(), "utf8").split("\r\n");
  assert.equal(lines[0], "time,tank.ai1.min,tank.ai1.max,tank.ai1.mean,pump.do0.min,pump.do0.max,pump.do0.mean");
  await sound();
});

test("a user is made, limited, locked out and removed", async () => {
  await visit("/users");
  await press(t("user_new"));
  await page.getByLabel(t("user_name"), { exact: true }).fill("li");
  await page.getByLabel(t("points_limited")).fill("pump.*, oven.k1");
  await page.getByLabel(t("password_new"), { exact: true }).fill("another long secret");
  await sound();
  await press(t("save"));
  const row = page.locator("tr", { hasText: "pump.*, oven.k1" });
  await row.waitFor();
  await press("Edit li");
  await page.getByLabel(t("user_lock")).check();
  await press(t("save"));
  await row.getByText(t("user_locked")).waitFor();
  await press("Remove li");
  await page.getByRole("dialog").getByRole("button", { name: "Remove", exact: true }).click();
  await row.waitFor({ state: "detached" });
});

test("a token is shown once, works, and is gone when it is removed", async () => {
  await visit("/users");
  await press(t("token_new"));
  await page.getByLabel(t("token_name"), { exact: true }).fill("grafana");
  await page.getByRole("dialog").getByRole("button", { name: t("token_new") }).click();
  const shown = page.getByRole("dialog").getByRole("textbox");
  await page.getByText(t("token_once")).waitFor();
  const token = await shown.inputValue();
  assert.match(token, /^rb_/);
  await sound();
  const ask = () => fetch(`${daemon.origin}/api/v1/points`, { headers: { Authorization: `Bearer ${token}` } });
  assert.equal((await ask()).status, 200);
  await page.getByRole("dialog").getByRole("button", { name: t("close") }).last().click();
  assert.ok(!(await page.content()).includes(token), "the token is not shown again");
  await press("Remove grafana");
  await page.getByRole("dialog").getByRole("button", { name: "Remove", exact: true }).click();
  await page.getByText(t("tokens_none")).waitFor();
  assert.equal((await ask()).status, 401);
});

test("the configuration: a fault is told where it is, a change is kept, and taken back", async () => {
  await visit("/backup");
  const field = page.getByLabel(t("config_text"));
  await field.waitFor();
  const text = await field.inputValue();
  await field.fill(`${text}\n[modul.x]\n`);
  await press(t("config_save"));
  const line = text.split("\n").length + 1;
  await page.getByRole("button", { name: new RegExp(`^Line ${line}, column`) }).click();
  const marked = await field.evaluate((field) => field.value.slice(0, field.selectionStart).split("\n").length);
  assert.equal(marked, line);
  // What was refused is a 422, which the browser writes down.
  wrong.length = 0;
  await sound();
  await field.fill(`# changed in the page\n${text}`);
  await press(t("config_save"));
  await page.getByText(t("config_kept")).waitFor();
  await press(t("compare"));
  await page.locator("ins", { hasText: "# changed in the page" }).waitFor();
  await page.getByRole("button", { name: new RegExp(`^${t("restore")} `) }).last().click();
  await page.getByRole("dialog").locator("del", { hasText: "# changed in the page" }).waitFor();
  await sound();
  await page.getByRole("dialog").getByRole("button", { name: t("restore"), exact: true }).click();
  await page.waitForFunction((text) => document.querySelector("textarea")?.value === text, text);

  const backup = `# first\n${text}# last\n`;
  const file = { name: "kept.toml", mimeType: "application/toml", buffer: Buffer.from(backup) };
  await page.getByLabel(t("restore_file")).setInputFiles(file);
  const dialog = page.getByRole("dialog", { name: /kept\.toml/ });
  await dialog.getByLabel("Change 1").uncheck();
  await sound();
  await dialog.getByRole("button", { name: t("restore"), exact: true }).click();
  await page.waitForFunction((text) => document.querySelector("textarea")?.value === text, `${text}# last\n`);
});

test("the reference: a call is found and tried", async () => {
  await visit("/reference");
  await page.getByLabel(t("api_filter")).fill("get /lines");
  const call = page.locator("details", { has: page.getByText("/lines", { exact: true }) });
  await call.locator("summary").click();
  await call.getByRole("button", { name: t("api_send") }).click();
  await call.getByText(/^200 OK, after/).waitFor();
  assert.match(await call.locator("pre").last().innerText(), /"line": "main"/);
  await sound();
});

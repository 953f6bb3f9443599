// Integrations: one is made, tested, mended and removed in the pages, in a form that is made from the
// settings of its kind, with a receiver of our own behind it.
import assert from "node:assert/strict";
import { createHmac } from "node:crypto";
import { createServer } from "node:http";
import { after, before, test } from "node:test";
import { faults, LOOKS, open, PATIENCE_MS, words } from "./daemon.js";
import { misplaced } from "./geometry.js";
import { browser, cookies, csrf, daemon } from "./site.js";

let receiver;
/** What came to the receiver, and what it answers. */
const came = [];
let status = 204;

before(async () => {
  receiver = createServer(async (request, response) => {
    let body = "";
    for await (const piece of request) body += piece;
    came.push({ url: request.url, headers: request.headers, body, event: JSON.parse(body).event });
    response.writeHead(status).end("ignored");
  });
  await new Promise((resolve) => receiver.listen(0, "127.0.0.1", resolve));
});

after(() => receiver?.close());

/** The texts of a kind and of its settings, as the daemon has them. */
async function kind(name, lang) {
  const { kinds } = await daemon.owner("GET", "/outlet-kinds");
  const found = kinds.find((one) => one.kind === name);
  return Object.fromEntries(found.fields.flatMap((field) => [
    [field.key, field.title[lang]],
    ...(field.choices ?? []).map((choice) => [`${field.key}.${choice.value}`, choice.title[lang]]),
  ]));
}

async function until(what, found) {
  const end = Date.now() + PATIENCE_MS;
  for (;;) {
    const it = found();
    if (it) return it;
    assert.ok(Date.now() < end, `${what}: it never came`);
    await new Promise((resolve) => setTimeout(resolve, 50));
  }
}

test("an integration is made, tested, works, and its failures are seen", async () => {
  const t = words("en");
  const label = await kind("webhook", "en");
  const { context, page, wrong } = await open(browser, LOOKS.find(({ lang, width }) => lang === "en" && width === 1280));
  await context.addCookies(cookies);
  // The receiver is on the daemon's own machine, which is for the owner to allow.
  const { text } = await daemon.owner("GET", "/config");
  const allow = `[webhooks]\nallow = ["127.0.0.1:${receiver.address().port}"]\n`;
  await daemon.owner("PUT", "/config", { text: `${text}\n${allow}` });
  const press = (name) => page.getByRole("button", { name, exact: true }).click();
  await page.goto(`${daemon.origin}/integrations`);
  await page.getByText(t("outlets_none")).waitFor();

  await press(t("outlet_new"));
  await page.getByLabel(t("outlet_name")).fill("alerts");
  const address = `http://127.0.0.1:${receiver.address().port}/hook`;
  await page.getByLabel(label.url, { exact: true }).fill(address);
  await page.getByLabel(label["events.write"], { exact: true }).check();
  await page.getByLabel(label.modules, { exact: true }).fill("pump");
  await press(t("outlet_make"));
  const secret = await page.getByLabel(label.secret, { exact: true }).inputValue();
  assert.match(secret, /^[0-9a-f]{64}$/);
  assert.deepEqual(await faults(page), []);
  await press(t("save"));
  const card = page.locator("article", { hasText: "alerts" });
  await card.getByText(t("outlet_secret")).waitFor();

  await card.getByRole("button", { name: t("outlet_test") }).click();
  await page.getByText(/alerts works: HTTP 204, \d+ ms/).waitFor();
  const tried = came.find(({ event }) => event.code === "webhook_test");
  const { "x-railbus-timestamp": at, "x-railbus-signature": signed, "x-railbus-event": id } = tried.headers;
  const wanted = createHmac("sha256", secret).update(`${at}.${tried.body}`).digest("hex");
  assert.deepEqual([signed, id], [`sha256=${wanted}`, tried.event.id]);

  const set = (path) =>
    context.request.put(`${daemon.origin}/api/v1/points/${path}`, {
      data: { value: true, confirm: true },
      headers: { "X-CSRF-Token": csrf },
    });
  for (const path of ["oven/k1", "pump/do0"]) assert.equal((await set(path)).status(), 200);
  const told = await until("the event of the pump", () => came.find(({ event }) => event.kind === "write"));
  assert.equal(told.event.module, "pump");
  assert.equal(JSON.parse(told.body).site, "demo");
  await card.getByText(t("outlet_state_running"), { exact: true }).waitFor();

  status = 500;
  await card.getByRole("button", { name: t("outlet_test") }).click();
  await page.getByText(/E0878.*HTTP 500/).waitFor();
  assert.equal((await set("pump/do1")).status(), 200);
  await card.getByText(t("outlet_state_waiting"), { exact: true }).waitFor();
  const note = card.locator(".note.bad");
  await note.getByText(t("outlet_error")).waitFor();
  // Its cause and the next step stand below it.
  assert.ok((await note.locator("p").count()) >= 3, await note.textContent());
  await note.getByText(t("outlet_retry").split(":")[0]).waitFor();
  assert.deepEqual([...wrong, ...(await faults(page))], []);
  status = 200;
  await card.getByText(t("outlet_state_running"), { exact: true }).waitFor();
  await until("the event again", () => came.filter(({ event }) => event.point === "pump.do1").length > 1);

  const document = await page.content();
  assert.ok(!document.includes(secret), "the secret is shown");
  await card.getByRole("button", { name: t("remove") }).click();
  await page.getByRole("dialog").getByRole("button", { name: t("remove"), exact: true }).click();
  await page.getByText(t("outlets_none")).waitFor();

  await page.goto(`${daemon.origin}/events?kind=config`);
  await page.getByText(`${t("code_config_changed")}: webhook.alerts`).first().waitFor();
  assert.deepEqual([...wrong, ...(await faults(page))], []);
  await context.close();
});

test("the page holds in every look", async () => {
  const made = await browser.newContext();
  await made.addCookies(cookies);
  const put = await made.request.put(`${daemon.origin}/api/v1/webhooks/a_name_that_is_as_long_as_can_be`, {
    data: { url: `https://hooks.example.com/${"x".repeat(120)}`, severity: "warning", lines: ["main"], enabled: false },
    headers: { "X-CSRF-Token": csrf },
  });
  assert.equal(put.status(), 200, await put.text());
  await daemon.owner("PUT", "/outlets/modbus_tcp/scada", { listen: "127.0.0.1:0", write: ["oven.*"] });
  const csv = await made.request.get(`${daemon.origin}/api/v1/outlets/modbus_tcp/scada/map?format=csv&lang=en`);
  assert.match(await csv.text(), /^Unit,Module,Point,.*\r\n(.*\r\n)*3,oven,k1,coil,60,"0 off, 1 on"\r\n/);
  await made.close();
  for (const look of LOOKS) {
    const t = words(look.lang);
    const { context, page, wrong } = await open(browser, look);
    await context.addCookies(cookies);
    await page.goto(`${daemon.origin}/integrations`);
    await page.getByText(t("outlet_state_off"), { exact: true }).waitFor();
    const scada = page.locator("article", { hasText: "scada" });
    await scada.getByText(t("outlet_state_running"), { exact: true }).waitFor();
    await scada.getByRole("button", { name: t("outlet_map") }).click();
    await page.getByRole("cell", { name: "60", exact: true }).first().waitFor();
    assert.deepEqual([...wrong, ...(await faults(page))], [], `${JSON.stringify(look)}: the addresses`);
    await page.keyboard.press("Escape");
    assert.deepEqual([...wrong, ...(await faults(page))], [], JSON.stringify(look));
    await page.getByRole("button", { name: t("outlet_new"), exact: true }).click();
    await page.getByLabel(t("outlet_name")).waitFor();
    assert.deepEqual([...wrong, ...(await faults(page))], [], `${JSON.stringify(look)}: the form`);
    await context.close();
  }
});

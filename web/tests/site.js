// For all tests of a file: a daemon with its demo line and its first user, and a browser.
import assert from "node:assert/strict";
import { after, before } from "node:test";
import { browse, serve, setUp } from "./daemon.js";

/** Filled before the first test. */
export let daemon, browser, cookies, csrf;

before(async () => {
  daemon = await serve();
  browser = await browse();
  ({ cookies, csrf } = await setUp(browser, daemon));
});

after(async () => {
  await browser?.close();
  await daemon?.stop();
});

/** Asks the API as the first user; gives back what it says. */
export async function ask(method, path, data) {
  const cookie = cookies.map(({ name, value }) => `${name}=${value}`).join("; ");
  const headers = { "Content-Type": "application/json", "X-CSRF-Token": csrf, Cookie: cookie, Origin: daemon.origin };
  const answer = await fetch(`${daemon.origin}/api/v1${path}`, { method, headers, body: data && JSON.stringify(data) });
  const said = await answer.text();
  assert.ok(answer.status < 300, `${method} ${path}: ${answer.status} ${said}`);
  return said && JSON.parse(said);
}

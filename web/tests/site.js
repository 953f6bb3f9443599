// For all tests of a file: a daemon with its demo line and its first user, and a browser.
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

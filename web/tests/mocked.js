// For all tests of a file: a mock that speaks the contract of the API, and a browser.
import { after, before } from "node:test";
import { browse } from "./daemon.js";
import { start } from "./mock/server.js";

/** Filled before the first test. */
export let server, browser;

before(async () => {
  server = await start();
  browser = await browse();
});

after(async () => {
  await browser?.close();
  server?.stop();
});

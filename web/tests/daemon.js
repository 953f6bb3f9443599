// The real daemon with its demo line, and a real browser in front of it.
import assert from "node:assert/strict";
import { spawn, spawnSync } from "node:child_process";
import { existsSync, mkdtempSync, readdirSync, readFileSync, rmSync } from "node:fs";
import { request } from "node:http";
import { createRequire } from "node:module";
import { createServer } from "node:net";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { createInterface } from "node:readline";
import { fileURLToPath } from "node:url";
import { chromium } from "playwright-core";
import { pairs, sources } from "../scripts/texts.js";

const root = fileURLToPath(new URL("../..", import.meta.url));
const built = join(process.env.CARGO_TARGET_DIR ?? join(root, "target"), "debug/railbus");

/** Only guards against hanging. */
export const PATIENCE_MS = Number(process.env.PATIENCE_MS ?? 60_000);

/** The link for the first user that a program prints at its start. */
async function linkOf(child) {
  let link;
  for await (const line of createInterface({ input: child.stdout })) {
    link ??= /^\s*setup\s+(https?:\/\/\S+)/.exec(line)?.[1];
    if (line.includes("Ctrl-C")) break;
  }
  if (!link) throw new Error(`no link was printed: ${child.spawnargs.join(" ")}`);
  child.stdout.resume();
  return link;
}

/** `railbus serve --demo`, and the link that it prints. */
export async function serve() {
  const folder = mkdtempSync(join(tmpdir(), "railbus-web-"));
  const args = ["serve", "--demo", "--listen", "127.0.0.1:0", "--socket", join(folder, "socket")];
  const env = { ...process.env, LANG: "C.UTF-8", RAILBUS_LANG: "en" };
  const child = spawn(built, args, { env, stdio: ["ignore", "pipe", "inherit"] });
  const ended = new Promise((resolve) => child.once("exit", resolve));
  const link = await linkOf(child);
  return {
    link,
    origin: new URL(link).origin,
    socket: join(folder, "socket"),
    /** Asks as the owner, over the daemon's socket; gives back what it says. */
    owner: (method, path, body) =>
      new Promise((resolve, reject) => {
        const headers = { host: "localhost", "content-type": "application/json", "if-match": "*" };
        const asks = request({ socketPath: join(folder, "socket"), method, path: `/api/v1${path}`, headers });
        asks.once("error", reject).once("response", async (answer) => {
          let text = "";
          for await (const piece of answer.setEncoding("utf8")) text += piece;
          if (answer.statusCode === 200) resolve(JSON.parse(text));
          else reject(new Error(`${method} ${path}: ${answer.statusCode} ${text}`));
        });
        asks.end(body && JSON.stringify(body));
      }),
    async stop() {
      child.kill("SIGTERM");
      await ended;
      rmSync(folder, { recursive: true, force: true });
    },
  };
}

/** The centre of a fleet that has neither servers nor sites. */
export async function serveCentre() {
  const folder = mkdtempSync(join(tmpdir(), "railbus-web-"));
  const fleet = join(folder, "acme");
  const env = { ...process.env, LANG: "C.UTF-8", RAILBUS_LANG: "en" };
  const made = spawnSync(built, ["fleet", "init", fleet, "--nats", "127.0.0.1:1"], { env });
  assert.equal(made.status, 0, String(made.stderr));
  const args = ["fleet", "serve", fleet, "--listen", "127.0.0.1:0", "--socket", join(folder, "socket")];
  const child = spawn(built, args, { env, stdio: ["ignore", "pipe", "inherit"] });
  const ended = new Promise((resolve) => child.once("exit", resolve));
  const link = await linkOf(child);
  return {
    link,
    origin: new URL(link).origin,
    async stop() {
      child.kill("SIGTERM");
      await ended;
      rmSync(folder, { recursive: true, force: true });
    },
  };
}

/** The server of a fleet: installed with the other peers, or the one on the PATH. */
const nats = join(root, "target/interop-venv/bin/nats-server");

/** How much higher the port is at which servers of a fleet reach each other. */
const ROUTE_OFFSET = 2_000;

/** Whether nobody listens there. */
const isFree = (port) =>
  new Promise((resolve) => {
    const server = createServer();
    server.once("error", () => resolve(false));
    server.listen(port, "127.0.0.1", () => server.close(() => resolve(true)));
  });

/** A port on which nothing listens, nor on that of its routes. */
async function freePort() {
  for (;;) {
    const port = 20_000 + Math.floor(Math.random() * 10_000);
    if ((await isFree(port)) && (await isFree(port + ROUTE_OFFSET))) return port;
  }
}

/** A fleet as the guide makes one: three servers, a centre with pages, and sites that are invited. */
export async function foundFleet() {
  const folder = mkdtempSync(join(tmpdir(), "railbus-web-"));
  const fleet = join(folder, "acme");
  const socket = join(folder, "socket");
  const env = { ...process.env, LANG: "C.UTF-8", RAILBUS_LANG: "en" };
  const run = (...args) => {
    const { status, stderr } = spawnSync(built, args, { env });
    return { done: status === 0, said: String(stderr) };
  };
  const must = (...args) => {
    const { done, said } = run(...args);
    assert.ok(done, `railbus ${args.join(" ")}: ${said}`);
  };
  const ports = [];
  while (ports.length < 3) {
    const port = await freePort();
    if (!ports.includes(port)) ports.push(port);
  }
  must("fleet", "init", fleet, "--nats", ports.map((port) => `127.0.0.1:${port}`).join(","));
  const running = ports.map((_, at) =>
    spawn(existsSync(nats) ? nats : "nats-server", ["-c", "nats.conf"], { cwd: join(fleet, `server${at + 1}`), stdio: "ignore" }),
  );
  const centre = spawn(built, ["fleet", "serve", fleet, "--listen", "127.0.0.1:0", "--socket", socket], { env, stdio: ["ignore", "pipe", "inherit"] });
  running.unshift(centre);
  const ended = running.map((child) => new Promise((resolve) => child.once("exit", resolve)));
  // If the tests are cut off, they end all the same.
  process.once("exit", () => running.forEach((child) => child.kill("SIGKILL")));
  const link = await linkOf(centre);
  return {
    link,
    origin: new URL(link).origin,
    /** A site joins by an invitation, and lets the centre switch all of it. */
    async invite(name, site) {
      const invitation = join(folder, `${name}.invitation`);
      must("fleet", "enrol", fleet, name, invitation);
      // Until the servers have found each other.
      await until(() => run("fleet", "join", invitation, "--socket", site.socket).done);
      const { outlets } = await site.owner("GET", "/outlets");
      const { outlet, settings } = outlets.find(({ kind }) => kind === "fleet");
      await site.owner("PUT", `/outlets/fleet/${outlet}`, { ...settings, write: ["*"] });
    },
    async stop() {
      running.forEach((child) => child.kill("SIGTERM"));
      await Promise.all(ended);
      rmSync(folder, { recursive: true, force: true });
    },
  };
}

/** `railbus fleet demo`: a server, a centre and three sites; the link to set up the centre. */
export async function serveFleet() {
  const folder = mkdtempSync(join(tmpdir(), "railbus-web-"));
  const server = ["--nats-server", existsSync(nats) ? nats : "nats-server"];
  const args = ["fleet", "demo", "--socket", join(folder, "socket"), "--output", "json", ...server];
  const env = { ...process.env, LANG: "C.UTF-8", RAILBUS_LANG: "en" };
  const child = spawn(built, args, { env, stdio: ["ignore", "pipe", "inherit"] });
  const ended = new Promise((resolve) => child.once("exit", resolve));
  // If the tests are cut off, it ends all the same.
  process.once("exit", () => child.kill("SIGTERM"));
  const lines = createInterface({ input: child.stdout });
  const said = await Promise.race([new Promise((resolve) => lines.once("line", resolve)), ended]);
  if (typeof said !== "string") throw new Error("the demo of a fleet ended");
  const link = JSON.parse(said).centre;
  /** The processes of the demo, by a word of their command line. */
  const processes = (word) =>
    readdirSync("/proc").filter((pid) => {
      try {
        // The fourth field of its state is its parent; its name may contain anything but the last bracket.
        const parent = readFileSync(`/proc/${pid}/stat`, "utf8").split(") ").at(-1).split(" ")[1];
        return parent === String(child.pid) && readFileSync(`/proc/${pid}/cmdline`, "utf8").includes(word);
      } catch {
        return false;
      }
    });
  const signal = (word, name) => {
    const pids = processes(word);
    assert.equal(pids.length, 1, `one process with ${word}`);
    process.kill(Number(pids[0]), name);
  };
  return {
    link,
    origin: new URL(link).origin,
    /** Suspends a process of it, as if its machine were gone. */
    suspend: (word) => signal(word, "SIGSTOP"),
    resume: (word) => signal(word, "SIGCONT"),
    resumeAll: () => processes("").forEach((pid) => process.kill(Number(pid), "SIGCONT")),
    async stop() {
      child.kill("SIGTERM");
      await ended;
      rmSync(folder, { recursive: true, force: true });
    },
  };
}

/** Looks again until it is so, such as what takes a moment to be everywhere. */
export async function until(so) {
  const end = Date.now() + PATIENCE_MS;
  while (!(await so())) {
    assert.ok(Date.now() < end, `it never was so: ${so}`);
    await new Promise((resolve) => setTimeout(resolve, 50));
  }
}

/** Languages, phone and desk, light and dark: every pair of values, in half of all combinations. */
export const LOOKS = [
  { lang: "en", width: 360, scheme: "light" },
  { lang: "en", width: 1280, scheme: "dark" },
  { lang: "zh", width: 360, scheme: "dark" },
  { lang: "zh", width: 1280, scheme: "light" },
];

export const browse = () =>
  chromium.launch({ executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium-headless-shell", args: ["--no-sandbox"] });

/** A page that writes down what goes wrong in it. */
export async function open(browser, { lang, width, scheme }) {
  const context = await browser.newContext({
    viewport: { width, height: width < 900 ? 740 : 800 },
    colorScheme: scheme,
    locale: lang === "zh" ? "zh-CN" : "en-US",
    reducedMotion: "reduce",
  });
  context.setDefaultTimeout(PATIENCE_MS);
  const page = await context.newPage();
  const wrong = [];
  page.on("console", (message) => message.type() === "error" && wrong.push(`console: ${message.text()}`));
  // What the console leaves out.
  page.on("response", async (answer) => {
    // Its body is gone with the page.
    const body = () => answer.text().catch(() => "");
    if (answer.status() >= 500) console.log(`# ${answer.url()}: ${answer.status()} ${await body()}`);
  });
  page.on("pageerror", (error) => wrong.push(`error: ${error.message}`));
  await page.exposeFunction("reportPolicy", (what) => wrong.push(`policy: ${what}`));
  await page.addInitScript(() => {
    document.addEventListener("securitypolicyviolation", (event) =>
      window.reportPolicy(`${event.violatedDirective} ${event.blockedURI}`),
    );
  });
  return { context, page, wrong };
}

export const PASSWORD = "correct horse battery";

/** Makes the first user; answers with what makes a browser, and a request, that user's. */
export async function setUp(browser, daemon) {
  const context = await browser.newContext();
  const key = new URL(daemon.link).hash.slice("#k=".length);
  const made = await context.request.post(`${daemon.origin}/api/v1/setup`, {
    data: { key, name: "admin", password: PASSWORD, lang: "en" },
  });
  if (made.status() !== 200) throw new Error(await made.text());
  const { csrf } = await made.json();
  const cookies = await context.cookies();
  await context.close();
  return { cookies, csrf };
}

const catalogue = Object.fromEntries(
  sources(fileURLToPath(new URL("../src/i18n", import.meta.url)))
    .flatMap(({ text }) => pairs(text))
    .map(({ key, en, zh }) => [key, { en, zh }]),
);

/** A text of the page. */
export const words = (lang) => (key) => {
  const text = catalogue[key]?.[lang];
  if (!text) throw new Error(`there is no text ${key}`);
  return text;
};

const axe = readFileSync(createRequire(import.meta.url).resolve("axe-core/axe.min.js"), "utf8");

/** What is wrong with a page as it is now: for readers of the screen, for fingers, for phones. */
export async function faults(page) {
  await page.evaluate(axe);
  // What lies under the header, or the bar of phones, comes out by scrolling: it is not hidden.
  const pin = (pinned) =>
    page.evaluate((pinned) => {
      for (const bar of document.querySelectorAll(".frame > header, .frame > nav.bottom")) {
        if (pinned) bar.style.removeProperty("position");
        else bar.style.setProperty("position", "static");
      }
    }, pinned);
  await pin(false);
  const violations = await page.evaluate(async () => {
    const { violations } = await window.axe.run(document, {
      runOnly: ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"],
    });
    return violations.flatMap((one) => one.nodes.map((node) => `axe ${one.id}: ${node.html} ${node.failureSummary}`));
  });
  await pin(true);
  const shape = await page.evaluate(() => {
    const found = [];
    const { scrollWidth, clientWidth } = document.documentElement;
    if (scrollWidth > clientWidth) found.push(`it scrolls sideways: ${scrollWidth} > ${clientWidth}`);
    const targets = "a[href], button, input, select, textarea, summary, [role=switch], [role=option]";
    for (const element of document.querySelectorAll(targets)) {
      // A box and its words are one target; a link within a sentence is as high as its line.
      const target = element.closest("label") ?? element;
      const { width, height } = target.getBoundingClientRect();
      const inText = element.matches("p a, li > p a") && getComputedStyle(element).display === "inline";
      const hidden = !element.checkVisibility({ opacityProperty: true, visibilityProperty: true });
      // Rows of the scope are one list to the keyboard, and dense by their nature.
      const inList = element.closest("[role=listbox]:not(#search-hits)");
      if (hidden || inText || inList || element.matches(".skip") || width === 0) continue;
      if (width < 43.9 || height < 43.9) {
        found.push(`too small: ${Math.round(width)} x ${Math.round(height)} ${element.outerHTML.slice(0, 120)}`);
      }
    }
    return found;
  });
  return [...violations, ...shape];
}

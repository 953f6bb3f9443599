// What happened, in the language of the page: whatever the daemon writes down has words in both.
import assert from "node:assert/strict";
import { readdirSync, readFileSync } from "node:fs";
import { join } from "node:path";
import { test } from "node:test";
import { fileURLToPath } from "node:url";
import { open, words } from "./daemon.js";
import { sources as catalogues } from "../scripts/texts.js";
import * as site from "./mock/site.js";
import { browser, server } from "./mocked.js";

const crates = fileURLToPath(new URL("../../crates", import.meta.url));

/** The sources of crates, without their tests. */
const sources = readdirSync(crates)
  .flatMap((crate) => {
    const src = join(crates, crate, "src");
    return readdirSync(src, { recursive: true }).map((path) => join(src, path));
  })
  .filter((path) => path.endsWith(".rs") && !path.endsWith("tests.rs"))
  .map((path) => readFileSync(path, "utf8").split("#[cfg(test)]")[0]);

const all = (pattern) => sources.flatMap((text) => [...text.matchAll(pattern)].map((match) => match[1]));

/** What is no event of the history: the command itself, and a test that only its webhook gets. */
const NONE = ["write", "webhook_test"];

/** No command that was begun ends so, and no rule: what it names, and whether it may, is asked before. */
const NEVER = ["no_such_group", "no_such_scene", "no_such_line", "no_such_module", "no_such_point", "not_an_output", "playing", "no_lease", "lease_time", "role_too_low"];

/** The events about integrations: each last word, after what the codes of a kind begin with. */
function outlets() {
  const begin = ["outlet", ...all(/\bevents: "([a-z_]+)"/g)];
  const end = new Set(all(/\.event\((?:self\.kind, )?"([a-z_]+)"/g));
  assert.equal(end.size, 4, `${[...end]} are found in the sources`);
  return begin.flatMap((first) => [...end].map((last) => `${first}_${last}`));
}

test("every event that the daemon knows has words", () => {
  const codes = new Set([
    ...all(/Severity::\w+,\s*"([a-z_]+)"/g),
    ...all(/\b(?:note_change|noted)\(\(?&?site, [^"]*"([a-z_]+)"/g),
    ...all(/\btold\("([a-z_]+)", &/g),
    ...outlets(),
  ]);
  for (const code of NONE) codes.delete(code);
  assert.ok(codes.size > 30, `${codes.size} are found in the sources`);
  for (const code of codes) for (const lang of ["en", "zh"]) words(lang)(`code_${code}`);
});

test("every end of a command has words", () => {
  const failures = readFileSync(join(crates, "site/src/failure.rs"), "utf8");
  const faults = readFileSync(join(crates, "bus/src/event.rs"), "utf8");
  const named = [...`${failures}${faults}`.matchAll(/=> "([a-z_]+)",/g)].map((match) => match[1]);
  const ends = named.filter((end) => !NEVER.includes(end));
  assert.ok(ends.length > 20, `${ends.length} are found in the sources`);
  for (const end of ends) for (const lang of ["en", "zh"]) words(lang)(`end_${end}`);
});

test("a state has one word, in the pages and on the command line", () => {
  const texts = ["app", "railbus"]
    .map((crate) => readFileSync(join(crates, crate, "src/texts.rs"), "utf8"))
    .join("\n");
  for (const [key, name] of [["on", "On"], ["off", "Off"]]) {
    const [, en, zh] = new RegExp(`^ +${name} \\{ en: "(.*)", zh: "(.*)" \\}$`, "m").exec(texts);
    assert.deepEqual([words("en")(key), words("zh")(key)], [en, zh]);
  }
  const pages = catalogues(fileURLToPath(new URL("../src/i18n", import.meta.url)));
  const said = [texts, ...pages.map(({ text }) => text)].join("\n");
  assert.doesNotMatch(said, /吸合|闭合|释放/);
});

/** What is written down of commands, as the daemon does it, and by whom. */
const COMMANDS = [
  ["end of pulse do0", "pulse"],
  ["end of lease do0", "lease"],
  ["lease do0=on 5000ms", "anna"],
  ["do0=off after 600000ms", "max_on"],
  ["do0=off", "on_offline"],
  ["do0=on", "on_return"],
  ["do0=off", "on_exit"],
  ["do0=on", "rule:night"],
  ["toggle do0", "owner", "socket"],
  ["pulse do0 500ms by host", "anna"],
  ["settings address=9 pulse_width=1.5 s", "anna"],
  ["calibrate zero, span at 5.00 V", "anna"],
  ["send output+settings: 01 05 00 00 FF 00 8C 3A (main)", "anna"],
];

/** And of what else happens. */
const HAPPENED = [
  { kind: "system", code: "end_dropped", module: "pump", line: "main", text: "address 3, output 2" },
  { kind: "rule", code: "rule_fired", who: "rule:night", via: "program", what: "pump.do0=off, pulse pump.do1 500ms, notify" },
  { kind: "rule", code: "rule_failed", who: "rule:night", via: "program", what: "pump.do0=off", text: "no_reply", end: "no_reply" },
  { kind: "rule", code: "rule_failed", who: "rule:night", via: "program", what: "pump.do0=off", text: "busy" },
  { kind: "rule", code: "notify", who: "rule:night", via: "program", text: "水位过高" },
  { kind: "line", code: "line_down", line: "main", text: "missing" },
  { kind: "line", code: "line_down", line: "main", text: "permission" },
  { kind: "system", code: "history_works", text: "dropped 12" },
  { kind: "login", code: "user_added", who: "anna", via: "http 192.168.1.7", what: "li", text: "operator" },
  { kind: "login", code: "user_changed", who: "anna", via: "http 192.168.1.7", what: "li", text: "role points password locked" },
  { kind: "login", code: "login_refused", who: "an unknown name", via: "http 192.168.1.7", text: "E0904" },
  { kind: "config", code: "config_reloaded", who: "owner", via: "signal", what: "module.pump" },
];

/** Names, paths, bytes and what is not translated. */
const NAMES = /\b(adapter replaced|anna|li|night|pump|tank|main|module\.\w+|railbus|webhook|HTTP|http|CSV|NDJSON|do\d|max_on|E\d{4}|V|s|FF|[0-9A-F]{2})\b/g;

test("events and the audit log are told in Chinese on a Chinese page", async () => {
  const at = new Date().toISOString();
  const told = HAPPENED.map((one, n) => ({ id: `01JH${String(n).padStart(22, "0")}`, at, severity: "warning", ...one }));
  const done = COMMANDS.map(([what, who, via], n) => ({
    id: `01JG${String(n).padStart(22, "0")}`, at, kind: "write", severity: "info", module: "pump", code: "write",
    who, via: via ?? (/^[a-z]+$/.test(who) && who === "anna" ? "http 192.168.1.7" : "program"), what, end: "pulse_width", hash: "12".repeat(32),
  }));
  site.events.unshift(...told, ...done);
  site.audit.unshift(...done);
  const t = words("zh");
  const { context, page } = await open(browser, { lang: "zh", width: 1280, scheme: "light" });
  for (const [path, rows] of [["/events", ".event .grow"], ["/events/audit", "tbody tr"]]) {
    await page.goto(server.address + path);
    await page.locator(rows).first().waitFor();
    const found = [];
    for (const text of await page.locator(rows).allInnerTexts()) {
      const left = text.replace(NAMES, "").match(/[A-Za-z_]{2,}/g);
      if (left) found.push(`${left}: ${text.replaceAll("\n", " | ")}`);
    }
    assert.deepEqual(found, [], path);
  }
  await page.goto(`${server.address}/events`);
  await page.getByText(t("dropped_at").replace("{address}", "3").replace("{output}", "2")).waitFor();
  await page.getByText(`${t("tab_settings")}：${t("set_address")} 9、${t("set_pulse_width")} 1.5 s`).waitFor();
  await context.close();
});

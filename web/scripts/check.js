// Types, markup and texts. Each check is also shown something bad, which it must refuse: a
// check that has gone blind would pass everything.
import { spawnSync } from "node:child_process";
import { fileURLToPath } from "node:url";
import { faults, sources } from "./texts.js";

const web = fileURLToPath(new URL("..", import.meta.url));
const bad = `${web}tests/must-fail`;

function svelteCheck(...args) {
  const run = spawnSync(process.execPath, [`${web}node_modules/svelte-check/bin/svelte-check`, "--fail-on-warnings", ...args], {
    cwd: web,
    encoding: "utf8",
  });
  return { passed: run.status === 0, said: run.stdout + run.stderr };
}

function fail(what) {
  console.error(what);
  process.exit(1);
}

const types = svelteCheck("--tsconfig", "./tsconfig.json");
console.log(types.said.trim());
if (!types.passed) fail("svelte-check found faults");

const blind = svelteCheck("--tsconfig", `${bad}/tsconfig.json`, "--output", "machine");
const expected = ["Type 'string' is not assignable", "no_such_text", "a11y_missing_attribute"];
const missed = expected.filter((fault) => !blind.said.includes(fault));
if (blind.passed || missed.length) {
  fail(`svelte-check did not see the faults of tests/must-fail: ${missed.join(", ")}\n${blind.said}`);
}

const texts = faults(sources(`${web}src/i18n`), sources(`${web}src`));
if (texts.length) fail(texts.join("\n"));
const planted = faults(sources(`${bad}/i18n`), sources(`${bad}/i18n`));
if (planted.length !== 3) fail(`the check of texts saw ${planted.length} of 3 planted faults`);
console.log("texts: every key used once or more, placeholders equal in both languages");

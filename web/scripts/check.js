// Types and markup. The check is also shown something bad, which it must refuse: one that has
// gone blind would pass everything.
import { spawnSync } from "node:child_process";
import { fileURLToPath } from "node:url";

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
const expected = ["Type 'string' is not assignable", `Type '\\"unknown\\"' is not assignable`, "no_such_text", "a11y_missing_attribute"];
const missed = expected.filter((fault) => !blind.said.includes(fault));
if (blind.passed || missed.length) {
  fail(`svelte-check did not see the faults of tests/must-fail: ${missed.join(", ")}\n${blind.said}`);
}

// What every page is made of knows nothing of what is shown with it: `ui`, `lib` and `i18n` import
// from each other only, so that no type of the API gets in.
import assert from "node:assert/strict";
import { join, relative } from "node:path";
import { test } from "node:test";
import { fileURLToPath } from "node:url";
import { sources } from "../scripts/texts.js";

const src = fileURLToPath(new URL("../src", import.meta.url));
const BASE = ["ui", "lib", "i18n"];

/** What a file of a base folder imports from outside of them. */
function strays(path, text) {
  const imports = [...text.matchAll(/(?:from |import\(|import )"(\.[^"]+)"/g)].map((match) => match[1]);
  const folder = (to) => relative(src, join(path, "..", to)).split("/")[0];
  return imports.filter((to) => !BASE.includes(folder(to)));
}

test("components that every page uses know no type of the API", () => {
  const files = BASE.flatMap((folder) => sources(join(src, folder)));
  assert.ok(files.length > 30, `${files.length} are looked at`);
  for (const { path, text } of files) assert.deepEqual(strays(path, text), [], relative(src, path));
});

test("each way to import is seen", () => {
  const bad = [
    'import type { Problem } from "../api/types";',
    'import { points } from "../api/live.svelte";',
    'const late = await import("../api/client");',
    'import "../api/problems";',
  ];
  assert.equal(strays(join(src, "ui/Bad.svelte"), bad.join("\n")).length, bad.length);
  const good = 'import Icon from "./Icon.svelte"; import { t } from "../i18n/index.svelte"; import "svelte";';
  assert.deepEqual(strays(join(src, "ui/Good.svelte"), good), []);
});

// After the build: writes every file once more as .br and .gz, so that the daemon never
// compresses, and holds the page to its budget.
import { readdirSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { join } from "node:path";
import { fileURLToPath } from "node:url";
import { brotliCompressSync, gzipSync } from "node:zlib";

/** What a browser loads before it shows the first page, and all pages together; gzip. */
const FIRST_MOST = 60_000;
const ALL_MOST = 150_000;
/** What is loaded first: the frame, and the page at `/`. */
const FIRST = ["index.html", "src/modules/Overview.svelte"];

const dist = fileURLToPath(new URL("../dist/", import.meta.url));
const manifest = JSON.parse(readFileSync(join(dist, "manifest.json"), "utf8"));
rmSync(join(dist, "manifest.json"));

const names = readdirSync(dist, { recursive: true, withFileTypes: true })
  .filter((entry) => entry.isFile() && !/\.(br|gz)$/.test(entry.name))
  .map((entry) => join(entry.parentPath, entry.name).slice(dist.length));

/** The files of a part of the page, and of all that it needs. */
function filesOf(part, files = new Set(["index.html"])) {
  const { file, css = [], imports = [] } = manifest[part];
  if (files.has(file)) return files;
  for (const one of [file, ...css]) files.add(one);
  for (const other of imports) filesOf(other, files);
  return files;
}

const first = new Set(FIRST.flatMap((part) => [...filesOf(part)]));
// There is one sheet of styles for all pages.
for (const name of names) if (name.endsWith(".css")) first.add(name);

let [firstSize, allSize] = [0, 0];
for (const name of names) {
  const bytes = readFileSync(join(dist, name));
  const [gzip, brotli] = [gzipSync(bytes, { level: 9 }), brotliCompressSync(bytes)];
  writeFileSync(join(dist, `${name}.gz`), gzip);
  writeFileSync(join(dist, `${name}.br`), brotli);
  allSize += gzip.length;
  if (first.has(name)) firstSize += gzip.length;
  console.log(`${String(gzip.length).padStart(7)} ${first.has(name) ? "first" : "later"}  ${name}`);
}
console.log(`${String(firstSize).padStart(7)} of ${FIRST_MOST} bytes (gzip) before the first page is shown`);
console.log(`${String(allSize).padStart(7)} of ${ALL_MOST} bytes (gzip) with all pages`);
if (firstSize > FIRST_MOST || allSize > ALL_MOST) {
  console.error("the page is over its budget");
  process.exit(1);
}

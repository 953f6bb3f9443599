// After the build: writes every file once more as .br and .gz, so that the daemon never
// compresses, and holds the pages to their budgets.
import { readdirSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { join } from "node:path";
import { fileURLToPath } from "node:url";
import { brotliCompressSync, gzipSync } from "node:zlib";

/** What a browser loads before it shows the first page of a site, all pages of a site, and what those of a centre add; gzip. */
const FIRST_MOST = 60_000;
const ALL_MOST = 150_000;
const CENTRE_MOST = 17_000;
/** What is loaded first: the frame, and the page at `/`. */
const FIRST = ["index.html", "src/modules/Overview.svelte"];
/** The pages of a centre, which are loaded there only. */
const CENTRE = /^src\/fleet\//;

const dist = fileURLToPath(new URL("../dist/", import.meta.url));
const manifest = JSON.parse(readFileSync(join(dist, "manifest.json"), "utf8"));
rmSync(join(dist, "manifest.json"));

const names = readdirSync(dist, { recursive: true, withFileTypes: true })
  .filter((entry) => entry.isFile() && !/\.(br|gz)$/.test(entry.name))
  .map((entry) => join(entry.parentPath, entry.name).slice(dist.length));

/** The files of a part of the pages and of all that it needs, `later` of what it may need. */
function filesOf(part, later, files = new Set(["index.html"])) {
  const { file, css = [], imports = [], dynamicImports = [] } = manifest[part];
  if (files.has(file)) return files;
  for (const one of [file, ...css]) files.add(one);
  const others = later ? [...imports, ...dynamicImports] : imports;
  for (const other of others) if (!CENTRE.test(other)) filesOf(other, later, files);
  return files;
}

const first = new Set(FIRST.flatMap((part) => [...filesOf(part, false)]));
const ofSite = filesOf("index.html", true);
// There is one sheet of styles for all pages.
for (const name of names) if (name.endsWith(".css")) first.add(name);

const sizes = { first: 0, later: 0, centre: 0 };
for (const name of names) {
  const bytes = readFileSync(join(dist, name));
  const [gzip, brotli] = [gzipSync(bytes, { level: 9 }), brotliCompressSync(bytes)];
  writeFileSync(join(dist, `${name}.gz`), gzip);
  writeFileSync(join(dist, `${name}.br`), brotli);
  const code = name.startsWith("assets/") || name.endsWith(".html");
  const when = first.has(name) ? "first" : ofSite.has(name) || !code ? "later" : "centre";
  sizes[when] += gzip.length;
  console.log(`${String(gzip.length).padStart(7)} ${when.padEnd(6)}  ${name}`);
}

const budgets = [
  [sizes.first, FIRST_MOST, "before the first page of a site is shown"],
  [sizes.first + sizes.later, ALL_MOST, "with all pages of a site"],
  [sizes.centre, CENTRE_MOST, "more with those of a centre"],
];
for (const [size, most, what] of budgets) console.log(`${String(size).padStart(7)} of ${most} bytes (gzip) ${what}`);
if (budgets.some(([size, most]) => size > most)) {
  console.error("the pages are over their budget");
  process.exit(1);
}

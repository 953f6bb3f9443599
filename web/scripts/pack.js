// After the build: writes every file once more as .br and .gz, so that the daemon never
// compresses, and holds the whole to its budget.
import { readdirSync, readFileSync, writeFileSync } from "node:fs";
import { join } from "node:path";
import { fileURLToPath } from "node:url";
import { brotliCompressSync, constants, gzipSync } from "node:zlib";

const BUDGET = 60_000;
const dist = fileURLToPath(new URL("../dist/", import.meta.url));

const files = readdirSync(dist, { recursive: true, withFileTypes: true })
  .filter((entry) => entry.isFile() && !/\.(br|gz)$/.test(entry.name))
  .map((entry) => join(entry.parentPath, entry.name));

let total = 0;
for (const file of files) {
  const bytes = readFileSync(file);
  const gzip = gzipSync(bytes, { level: 9 });
  const brotli = brotliCompressSync(bytes, {
    params: { [constants.BROTLI_PARAM_SIZE_HINT]: bytes.length },
  });
  writeFileSync(`${file}.gz`, gzip);
  writeFileSync(`${file}.br`, brotli);
  total += gzip.length;
  console.log(`${String(gzip.length).padStart(7)} gz ${String(brotli.length).padStart(7)} br  ${file.slice(dist.length)}`);
}
console.log(`${String(total).padStart(7)} gz in all; the budget is ${BUDGET}`);
if (total > BUDGET) {
  console.error(`the page is ${total - BUDGET} bytes over its budget`);
  process.exit(1);
}

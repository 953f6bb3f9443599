// The texts. The check is also shown faults, which it must find.
import { fileURLToPath } from "node:url";
import { faults, sources } from "./texts.js";

const web = fileURLToPath(new URL("..", import.meta.url));
const bad = `${web}tests/must-fail/i18n`;

const found = faults(sources(`${web}src/i18n`), sources(`${web}src`));
const planted = faults(sources(bad), sources(bad));
if (planted.length !== 3) found.push(`the check of texts saw ${planted.length} of 3 planted faults`);
if (found.length) {
  console.error(found.join("\n"));
  process.exit(1);
}
console.log("texts: every key used once or more, placeholders equal in both languages");

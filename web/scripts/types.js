// Writes the types of the API to `generated/`, from the OpenAPI document of the built program:
// for the type check, and for editors.
import { mkdirSync, writeFileSync } from "node:fs";
import { fileURLToPath } from "node:url";
import openapi, { astToString } from "openapi-typescript";
import { serve } from "../tests/daemon.js";

const folder = new URL("../generated/", import.meta.url);

const isNull = (schema) => schema.type === "null";

/** A schema without null. */
function withoutNull(schema) {
  if (Array.isArray(schema.type)) return { ...schema, type: schema.type.filter((type) => type !== "null") };
  if (schema.oneOf?.some(isNull)) return { ...schema, oneOf: schema.oneOf.filter((one) => !isNull(one)) };
  return schema;
}

/** What is not required is left out and never null: so the daemon answers, and so it may be asked. */
function strict({ properties = {}, required = [], ...schema }) {
  const each = Object.entries(properties).map(([name, of]) => [name, required.includes(name) ? of : withoutNull(of)]);
  const parts = schema.allOf && { allOf: schema.allOf.map(strict) };
  return { ...schema, ...parts, ...(each.length && { properties: Object.fromEntries(each) }), required };
}

const daemon = await serve();
try {
  const document = await (await fetch(`${daemon.origin}/api/v1/openapi.json`)).json();
  const schemas = Object.fromEntries(Object.entries(document.components.schemas).map(([name, of]) => [name, strict(of)]));
  // Pages name their addresses themselves: only the values are of use to them.
  const types = await openapi({ ...document, paths: {}, components: { schemas } }, { arrayLength: true, defaultNonNullable: false });
  mkdirSync(folder, { recursive: true });
  writeFileSync(new URL("openapi.d.ts", folder), astToString(types));
  console.log(`${fileURLToPath(folder)}openapi.d.ts: ${Object.keys(schemas).length} types`);
} finally {
  await daemon.stop();
}

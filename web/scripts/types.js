// Writes the types of both APIs to `generated/`, from the OpenAPI documents of the built program:
// for the type check, and for editors.
import { mkdirSync, writeFileSync } from "node:fs";
import { fileURLToPath } from "node:url";
import openapi, { astToString } from "openapi-typescript";
import { serve, serveCentre } from "../tests/daemon.js";

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

/** Writes the types of a program's API. */
async function write(name, program, path) {
  try {
    const document = await (await fetch(program.origin + path)).json();
    const schemas = Object.fromEntries(Object.entries(document.components.schemas).map(([name, of]) => [name, strict(of)]));
    // Pages name their addresses themselves: only the values are of use to them.
    const types = await openapi({ ...document, paths: {}, components: { schemas } }, { arrayLength: true, defaultNonNullable: false });
    writeFileSync(new URL(name, folder), astToString(types));
    console.log(`${fileURLToPath(folder)}${name}: ${Object.keys(schemas).length} types`);
  } finally {
    await program.stop();
  }
}

mkdirSync(folder, { recursive: true });
await write("openapi.d.ts", await serve(), "/api/v1/openapi.json");
await write("fleet.d.ts", await serveCentre(), "/fleet/v1/openapi.json");

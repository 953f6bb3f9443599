// The parts of an OpenAPI document that are shown.

export interface Schema {
  $ref?: string;
  type?: string | string[];
  format?: string;
  description?: string;
  enum?: unknown[];
  const?: unknown;
  properties?: Record<string, Schema>;
  required?: string[];
  items?: Schema;
  oneOf?: Schema[];
  anyOf?: Schema[];
  allOf?: Schema[];
  additionalProperties?: Schema | boolean;
}

export interface Param {
  name: string;
  in: "path" | "query" | "header" | "cookie";
  required?: boolean;
  description?: string;
}

type Content = Record<string, { schema?: Schema }>;

interface Operation {
  summary?: string;
  description?: string;
  tags?: string[];
  parameters?: Param[];
  requestBody?: { content?: Content };
  responses?: Record<string, { content?: Content }>;
}

export interface Document {
  info: { title: string; version: string; description?: string };
  paths: Record<string, Record<string, Operation>>;
  components?: { schemas?: Record<string, Schema> };
}

export interface Call {
  id: string;
  method: string;
  path: string;
  tag: string;
  summary: string;
  about: string;
  params: Param[];
  takes?: Schema | undefined;
  answers?: Schema | undefined;
}

const METHODS = ["get", "put", "post", "patch", "delete"];

/** Every call of the document, in its order. */
export function callsOf(document: Document): Call[] {
  return Object.entries(document.paths).flatMap(([path, item]) =>
    METHODS.flatMap((method) => {
      const operation = item[method];
      return operation ? [callOf(method.toUpperCase(), path, operation)] : [];
    }),
  );
}

function callOf(method: string, path: string, operation: Operation): Call {
  // Where 200 is a dry run's plan, the last 2xx is the answer proper.
  const good = Object.entries(operation.responses ?? {}).findLast(([status]) => status.startsWith("2"));
  return {
    id: `${method} ${path}`,
    method,
    path,
    tag: operation.tags?.[0] ?? path.split("/")[1] ?? "",
    summary: operation.summary ?? "",
    about: operation.description ?? "",
    params: (operation.parameters ?? []).filter((param) => param.in === "path" || param.in === "query"),
    takes: schemaOf(operation.requestBody?.content),
    answers: schemaOf(good?.[1].content),
  };
}

const schemaOf = (content: Content | undefined): Schema | undefined => Object.values(content ?? {})[0]?.schema;

/** How deep references are followed: some schemas contain themselves. */
const DEEP = 4;

/** A schema as an outline of JSON: `{ "value": boolean, "if"?: boolean }`. */
export function outline(document: Document, schema: Schema, deep = 0, indent = ""): string {
  const named = schema.$ref?.split("/").at(-1);
  if (named) {
    const found = document.components?.schemas?.[named];
    return found && deep < DEEP ? outline(document, found, deep + 1, indent) : named;
  }
  const one = (inner: Schema): string => outline(document, inner, deep, indent);
  const several = schema.oneOf ?? schema.anyOf;
  if (several) return [...new Set(several.map(one))].join(" | ");
  if (schema.allOf?.length === 1 && schema.allOf[0]) return one(schema.allOf[0]);
  if (schema.const !== undefined) return JSON.stringify(schema.const);
  if (schema.enum) return schema.enum.map((value) => JSON.stringify(value)).join(" | ");
  if (schema.items) return `[${one(schema.items)}, …]`;
  if (schema.properties) return objectOf(document, schema, deep, indent);
  if (typeof schema.additionalProperties === "object") return `{ …: ${one(schema.additionalProperties)} }`;
  return [schema.type ?? "any"].flat().join(" | ");
}

function objectOf(document: Document, schema: Schema, deep: number, indent: string): string {
  const more = `${indent}  `;
  const lines = Object.entries(schema.properties ?? {}).map(([name, inner]) => {
    const optional = schema.required?.includes(name) ? "" : "?";
    const about = inner.description ? `  // ${inner.description.split("\n")[0]}` : "";
    return `${more}"${name}"${optional}: ${outline(document, inner, deep, more)},${about}`;
  });
  return ["{", ...lines, `${indent}}`].join("\n");
}

/** The address of a call with its gaps filled; query parameters only where something is given. */
export function addressOf(call: Call, given: Record<string, string>): string {
  const path = call.path.replace(/\{(\w+)\}/g, (_, name: string) => encodeURIComponent(given[name] ?? ""));
  const asked = new URLSearchParams();
  for (const param of call.params) {
    const value = given[param.name];
    if (param.in === "query" && value) asked.set(param.name, value);
  }
  return asked.size ? `${path}?${asked}` : path;
}

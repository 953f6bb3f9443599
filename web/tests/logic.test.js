// What pages compute: differences of texts, and what a document of an API says.
import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import { modules } from "./modules.js";

let diff, openapi, patterns, close;

before(async () => {
  const loaded = await modules("ui/diff.ts", "reference/openapi.ts", "points/patterns.ts");
  [diff, openapi, patterns] = loaded.found;
  close = loaded.close;
});
after(() => close());

const signs = { same: " ", added: "+", gone: "-" };
const told = (a, b) => diff.diff(a, b).map(({ kind, text }) => signs[kind] + text);

test("a diff tells what was added and what is gone, each line once", () => {
  assert.deepEqual(told("a\nb\nc", "a\nx\nc"), [" a", "-b", "+x", " c"]);
  assert.deepEqual(told("a\nb", "b\na"), ["-a", " b", "+a"]);
  assert.deepEqual(told("", "a"), ["-", "+a"]);
  assert.deepEqual(told("a", "a"), [" a"]);
});

test("a diff gives back both texts, whatever they are", () => {
  let seed = 7;
  const random = (n) => (seed = (seed * 48_271) % 2_147_483_647) % n;
  const text = () => Array.from({ length: random(12) }, () => "abc"[random(3)]).join("\n");
  for (let i = 0; i < 500; i++) {
    const [a, b] = [text(), text()];
    const lines = diff.diff(a, b);
    const side = (not) => lines.filter(({ kind }) => kind !== not).map(({ text }) => text).join("\n");
    assert.deepEqual([side("added"), side("gone")], [a, b]);
  }
});

test("some of the changes are made, the others are not", () => {
  const lines = diff.diff("a\nb\nc\nd", "a\nB\nc\nd\ne");
  assert.deepEqual(diff.changes(lines), [-1, 0, 0, -1, -1, 1]);
  assert.equal(diff.partly(lines, (change) => change === 0), "a\nB\nc\nd");
  assert.equal(diff.partly(lines, (change) => change === 1), "a\nb\nc\nd\ne");
  assert.equal(diff.partly(lines, () => false), "a\nb\nc\nd");
});

test("texts that are long and wholly different do not take forever", () => {
  const many = (word) => Array.from({ length: 5_000 }, (_, i) => `${word} ${i}`).join("\n");
  assert.equal(diff.diff(many("a"), many("b")).length, 10_000);
});

test("long equal parts are folded", () => {
  const same = Array.from({ length: 20 }, (_, i) => `line ${i}`).join("\n");
  const folded = diff.folded(diff.diff(`${same}\nold\n${same}`, `${same}\nnew\n${same}`));
  assert.deepEqual([folded[0], folded.at(-1), folded.length], [17, 17, 10]);
});

test("patterns are divided by commas of either kind and by blanks", () => {
  assert.deepEqual(patterns.patterns(" pump.*，oven.k1,  pump.* 、a.b"), ["pump.*", "oven.k1", "a.b"]);
  assert.deepEqual(patterns.patterns("  "), []);
});

const document = {
  info: { title: "x", version: "1" },
  paths: {
    "/points/{module}/{label}": {
      get: { summary: "One", parameters: [{ name: "module", in: "path" }, { name: "label", in: "path" }, { name: "fresh", in: "query" }] },
      put: { requestBody: { content: { "application/json": { schema: { $ref: "#/components/schemas/Set" } } } } },
    },
  },
  components: {
    schemas: {
      Set: { type: "object", required: ["value"], properties: { value: { type: "boolean" }, by: { enum: ["a", "b"] }, self: { $ref: "#/components/schemas/Set" } } },
    },
  },
};

test("the calls of a document, and the address of one", () => {
  const [get, put] = openapi.callsOf(document);
  assert.deepEqual([get.id, get.tag, put.id], ["GET /points/{module}/{label}", "points", "PUT /points/{module}/{label}"]);
  assert.equal(openapi.addressOf(get, { module: "a/b", label: "do0", fresh: "1" }), "/points/a%2Fb/do0?fresh=1");
  assert.equal(openapi.addressOf(get, { module: "a", label: "b", fresh: "" }), "/points/a/b");
  assert.ok(put.takes);
});

test("a schema is outlined; one that contains itself ends", () => {
  const text = openapi.outline(document, { $ref: "#/components/schemas/Set" });
  assert.match(text, /"value": boolean,/);
  assert.match(text, /"by"\?: "a" \| "b",/);
  assert.match(text, /"self"\?: Set,/);
});

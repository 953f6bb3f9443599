// A site as the contract of the API describes it, for tests of pages: always the same answers.
export const NOW = Date.now();
const iso = (ago) => new Date(NOW - ago).toISOString();

export const session = {
  user: { name: "anna", role: "admin", points: [] },
  setup: false,
  csrf: "proof",
  demo: true,
  simulated: true,
  version: "0.1.0",
  lang: "en",
  site: "Pump house",
};

export const lines = [
  { line: "main", port: "sim:main", state: "up", baud: 9600, format: "8N1", babble: false, modules: ["pump", "tank"] },
];

const module = (name, title, model) => ({
  module: name, line: "main", address: 3, protocol: "rtu", model, title, state: "online", rtt_ms: 17, errors_1h: 0, late_1h: 0,
});
export const modules = [module("pump", "EDA9060A", "eda9060"), module("tank", "EMD-2A2Q", "emd")];

const point = (path, kind, index, value, more = {}) => ({
  path, module: path.split(".")[0], label: path.split(".")[1], kind, index, value, quality: "good", age_ms: 40, ...more,
});
export const points = [
  point("pump.do0", "output", 0, true, { name: { en: "Pump 1", zh: "一号水泵" } }),
  point("pump.do1", "output", 1, false, { name: { en: "Valve", zh: "阀门" } }),
  point("pump.di0", "input", 0, true),
  point("tank.ai1", "analog", 1, 8.71, { unit: "V", decimals: 2, name: { en: "Level", zh: "液位" } }),
  point("tank.ai2", "analog", 2, 21.4, { unit: "mA", decimals: 1 }),
];

const wave = (path, t) => {
  const slow = Math.sin(t / 140_000) + 0.3 * Math.sin(t / 17_000);
  return path.endsWith("ai2") ? 12 + 4 * slow : 6 + 2.2 * slow;
};

/** Two minutes in ten the module was away. */
const away = (t) => t % 600_000 > 430_000 && t % 600_000 < 480_000;

function sample(path, t) {
  if (away(t)) return { t, v: null, q: "bad" };
  if (path.includes(".ai")) return { t, v: Number(wave(path, t).toFixed(3)), q: "good" };
  const period = path.endsWith("do1") ? 90_000 : 47_000;
  return { t, v: Math.floor(t / period) % 2, q: "good" };
}

export function history(path, from, to, buckets) {
  const step = path.includes(".ai") ? 1_000 : 5_000;
  const start = Math.ceil(from / step) * step;
  const base = { schema: 1, point: path, from: new Date(from).toISOString(), to: new Date(to).toISOString(), unit: null };
  if ((to - start) / step <= buckets * 2) {
    const samples = [];
    for (let t = start; t < to; t += step) samples.push(sample(path, t));
    return { ...base, raw: true, samples };
  }
  const width = Math.ceil((to - from) / buckets);
  const found = [];
  for (let t = from; t < to; t += width) {
    const values = Array.from({ length: 12 }, (_, i) => sample(path, t + (i * width) / 12).v).filter((v) => v !== null);
    const some = values.length > 0;
    const mean = values.reduce((sum, v) => sum + v, 0) / values.length;
    found.push({ t, min: some ? Math.min(...values) : null, max: some ? Math.max(...values) : null, mean: some ? mean : null, n: values.length });
  }
  return { ...base, raw: false, buckets: found };
}

const id = (n) => `01JD${String(n).padStart(22, "0")}`;
const written = (n, ago, who, after, end = "readback") => ({
  id: id(n), at: iso(ago), kind: "write", severity: end === "readback" ? "info" : "warning", module: "pump", point: "pump.do0",
  who, via: who.startsWith("rule:") ? "program" : "http 192.168.1.7", what: after, before: after.endsWith("on") ? "do0=off" : "do0=on", after, end, code: "write",
});
export const events = [
  { id: id(120), at: iso(9_000), kind: "module", severity: "info", module: "tank", line: "main", code: "module_online" },
  written(119, 61_000, "anna", "do0=off"),
  { id: id(118), at: iso(90_000), kind: "module", severity: "warning", module: "tank", line: "main", code: "module_offline" },
  written(117, 180_000, "li", "do0=on", "not_verified"),
  { id: id(116), at: iso(240_000), kind: "line", severity: "error", line: "main", code: "line_down", text: "missing",
    acked: { who: "li", at: iso(200_000), comment: "adapter replaced" } },
  { id: id(115), at: iso(300_000), kind: "config", severity: "info", who: "anna", via: "http 192.168.1.7", code: "config_reloaded" },
  ...Array.from({ length: 90 }, (_, i) => written(114 - i, 400_000 + i * 1_900_000, i % 3 ? "anna" : "rule:night", i % 2 ? "do0=on" : "do0=off")),
];

export const audit = events.filter((event) => event.kind === "write").map((event) => ({
  id: event.id, at: event.at, who: event.who, via: event.via, module: event.module, what: event.what,
  before: event.before, after: event.after, end: event.end, hash: Buffer.from(event.id).toString("hex").slice(0, 64),
}));

export const users = [
  { name: "anna", role: "admin", points: [], locked: false, created: iso(86_400_000 * 30) },
  { name: "li", role: "operator", points: ["pump.*"], locked: false, created: iso(86_400_000 * 9) },
  { name: "guest", role: "viewer", points: [], locked: true, created: iso(86_400_000) },
];
export const tokens = [
  { id: "t1", name: "grafana", role: "viewer", points: [], by: "anna", created: iso(9e8), expires: iso(-5e9) },
  { id: "t2", name: "old script", role: "operator", points: ["pump.do1"], by: "li", created: iso(9e9), expires: iso(1e6), expired: true },
];
export const sessions = [
  { id: "s1", user: "anna", address: "192.168.1.7", began: iso(4e6), used: iso(500), current: true },
  { id: "s2", user: "li", address: "192.168.1.12", began: iso(9e6), used: iso(6e5), current: false },
];

export const groups = [
  { group: "night", name: { en: "Night", zh: "夜间" }, members: ["pump.do0", "pump.do1"], frames: 1 },
];
export const scenes = [
  {
    scene: "evening", name: { en: "Evening", zh: "傍晚" },
    steps: [{ path: "pump.do0", value: true }, { wait_ms: 2_000 }, { path: "pump.do1", value: false }],
  },
];
points[0].confirm = true;

const TEXT = `# Pump house
[line.main]
port = "/dev/serial/by-id/usb-FTDI_A50285BI"
baud = 9600

[module.pump]
line = "main"
model = "eda9060a"
address = 3

[module.pump.point.do0]
name = { en = "Pump 1", zh = "一号水泵" }
`;
export const generations = [
  { id: 3, at: iso(3e5), who: "anna", bytes: TEXT.length, text: TEXT },
  { id: 2, at: iso(9e7), who: "li", bytes: TEXT.length - 10, text: TEXT.replace("9600", "4800") },
  { id: 1, at: iso(3e8), who: "anna", bytes: 90, text: TEXT.split("\n").slice(0, 9).join("\n") + "\n" },
];
export const config = () => ({ text: generations[0].text, etag: `e${generations[0].id}` });
export function write(text) {
  const id = generations[0].id + 1;
  generations.unshift({ id, at: new Date().toISOString(), who: "anna", bytes: text.length, text });
  return { schema: 1, etag: `e${id}`, kept: ["main"], opened: [], closed: [] };
}

export const system = {
  schema: 1, version: "0.1.0", uptime_ms: 93_000_000, started: iso(93_000_000),
  rss_bytes: 23_400_000, lines: 1, modules: 2, points: 5,
};
export const storage = { schema: 1, history_bytes: 48_200_000, samples: 910_000, oldest: iso(86_400_000 * 12), disk_full: false };
export const doctor = {
  schema: 1, errors: 1, warnings: 1,
  findings: [
    { section: "system", state: "ok", code: null, message: "clock 2026-11-21, locale C.UTF-8", likely: null, hint: [], fix: [] },
    { section: "port", state: "warning", code: "D212", message: "/dev/ttyUSB0: latency timer 16 ms", likely: "every reply takes up to 16 ms longer", hint: [], fix: ["echo 1 > /sys/bus/usb-serial/devices/ttyUSB0/latency_timer"] },
    { section: "line", state: "error", code: "L101", message: "tank does not answer", likely: "A and B are swapped", hint: ["railbus scan main"], fix: [] },
  ],
};

const schema = (name) => ({ content: { "application/json": { schema: { $ref: `#/components/schemas/${name}` } } } });
export const document = {
  openapi: "3.1.0",
  info: { title: "railbus", version: "0.1.0" },
  paths: {
    "/points/{module}/{label}": {
      get: {
        tags: ["points"], summary: "One point", description: "For a viewer and above",
        parameters: [{ name: "module", in: "path", required: true }, { name: "label", in: "path", required: true }],
        responses: { 200: schema("PointInfo") },
      },
      put: {
        tags: ["points"], summary: "Switches an output",
        parameters: [{ name: "module", in: "path", required: true }, { name: "label", in: "path", required: true }],
        requestBody: schema("SetRequest"), responses: { 200: schema("PointInfo") },
      },
    },
    "/system": { get: { tags: ["system"], summary: "The program itself", responses: { 200: { content: {} } } } },
  },
  components: {
    schemas: {
      PointInfo: {
        type: "object", required: ["path", "value"],
        properties: {
          path: { type: "string", description: "`pump.do0`" }, value: { type: ["boolean", "null"] },
          quality: { enum: ["good", "stale", "bad"] }, twin: { $ref: "#/components/schemas/PointInfo" },
        },
      },
      SetRequest: { type: "object", required: ["value"], properties: { value: { type: "boolean" }, confirm: { type: "boolean" } } },
    },
  },
};

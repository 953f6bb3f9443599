// A site as the contract of the API describes it, for tests of pages: always the same answers.
export const NOW = Date.now();
const iso = (ago) => new Date(NOW - ago).toISOString();

export const session = {
  user: { name: "anna", role: "admin", points: [] },
  setup: false,
  csrf: "proof",
  demo: true,
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
const write = (n, ago, who, after, end = "readback") => ({
  id: id(n), at: iso(ago), kind: "write", severity: end === "readback" ? "info" : "warning", module: "pump", point: "do0",
  who, via: "http 192.168.1.7", what: after, before: after.endsWith("on") ? "do0=off" : "do0=on", after, end, code: "write",
});
export const events = [
  { id: id(120), at: iso(9_000), kind: "module", severity: "info", module: "tank", line: "main", code: "module_online" },
  write(119, 61_000, "anna", "do0=off"),
  { id: id(118), at: iso(90_000), kind: "module", severity: "warning", module: "tank", line: "main", code: "module_offline" },
  write(117, 180_000, "li", "do0=on", "not_verified"),
  { id: id(116), at: iso(240_000), kind: "line", severity: "error", line: "main", code: "line_down", text: "unplugged",
    acked: { who: "li", at: iso(200_000), comment: "adapter replaced" } },
  { id: id(115), at: iso(300_000), kind: "config", severity: "info", who: "anna", via: "http 192.168.1.7", code: "config_reloaded" },
  ...Array.from({ length: 90 }, (_, i) => write(114 - i, 400_000 + i * 1_900_000, i % 3 ? "anna" : "rule:night", i % 2 ? "do0=on" : "do0=off")),
];

export const audit = events.filter((event) => event.kind === "write").map((event) => ({
  id: event.id, at: event.at, who: event.who, via: event.via, module: event.module, what: event.what,
  before: event.before, after: event.after, end: event.end, hash: Buffer.from(event.id).toString("hex").slice(0, 64),
}));

// What the API answers: only fields that the page uses. Unknown fields are ignored.

export type Role = "viewer" | "operator" | "engineer" | "admin";

export interface Session {
  user: { name: string; role: Role; points: string[] } | null;
  /** Nobody can sign in yet: the first user is to be made. */
  setup: boolean;
  csrf: string | null;
  demo: boolean;
  version: string;
  lang: "en" | "zh";
  site?: string;
}

export interface LineInfo {
  line: string;
  port: string;
  state: "opening" | "up" | "absent" | "busy" | "closed";
  reason?: string;
  holder?: string;
  baud: number;
  format: string;
  babble: boolean;
  modules: string[];
}

export interface ModuleInfo {
  module: string;
  line: string;
  address: number;
  protocol: string;
  model: string;
  title: string;
  baud?: number;
  format?: string;
  checksum?: boolean;
  state: "online" | "offline" | "unheard";
  rtt_ms?: number;
  errors_1h: number;
  late_1h: number;
}

export type PointValue = boolean | number | null;

export interface PointInfo {
  path: string;
  module: string;
  label: string;
  kind: "output" | "input" | "analog" | "variable";
  index: number;
  name?: Partial<Record<string, string>>;
  value: PointValue;
  unit?: string;
  decimals?: number;
  raw?: number;
  quality: "good" | "stale" | "bad" | "offline" | "unknown";
  reason?: string;
  age_ms?: number;
  max_age_ms?: number;
  time?: string;
  locked?: boolean;
  confirm?: boolean;
  interlock?: string[];
  pulse_ms?: number;
  pulse_until?: string;
  max_on_ms?: number;
  lease?: { until: string };
}

/** What came of a write. */
export interface Written {
  value: boolean | null;
  before: boolean | null;
  confirmed: "readback" | "reply" | "sent";
  took_ms: number;
  audit: string;
}

/** Why something was not done [RFC 9457]. */
export interface Problem {
  code: string;
  title: string;
  status: number;
  /** The same in the language of who asked. */
  detail?: string;
  /** What to do, in the language of who asked. */
  help?: string[];
  hint?: string[];
  may_have_acted?: boolean;
  [more: string]: unknown;
}

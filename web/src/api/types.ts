// What the API answers: only fields that the page uses. Unknown fields are ignored.

export type Role = "viewer" | "operator" | "engineer" | "admin";

export interface Session {
  user: { name: string; role: Role; points: string[] } | null;
  /** Nobody can sign in yet: the first user is to be made. */
  setup: boolean;
  csrf: string | null;
  demo: boolean;
  /** Some of its lines are simulated, and take orders. */
  simulated: boolean;
  version: string;
  lang: "en" | "zh";
  site?: string;
}

export type Names = Partial<Record<string, string>>;

export interface LineInfo {
  line: string;
  name?: Names;
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
  name?: Names;
  /** Where it stands. */
  area?: string;
  line: string;
  address: number;
  protocol: string;
  model: string;
  title: string;
  baud?: number;
  format?: string;
  checksum?: boolean;
  state: "online" | "offline" | "unheard" | "other_model";
  /** The other model that answers in its place. */
  answers_as?: string;
  rtt_ms?: number;
  errors_1h: number;
  late_1h: number;
  /** What came of the last requests, where it is not online. */
  lost?: { attempts: number; garbled: number; rx_bytes: number; why?: string };
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
  /** When it was read, by the clock of this browser. */
  read_at?: number;
  /** Left out, unless it is asked for. */
  hidden?: boolean;
  locked?: boolean;
  confirm?: boolean;
  interlock?: string[];
  pulse_ms?: number;
  pulse_until?: string;
  max_on_ms?: number;
  min_off_ms?: number;
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

/** A frame on a line, or a reply that did not come: as `railbus sniff -o json` tells it. */
export interface FrameRecord {
  event: "frame" | "no_reply";
  time: string;
  line: string;
  role: "request" | "reply" | null;
  protocol: string | null;
  address: number | null;
  module: string | null;
  meaning: string;
  verdict: "good" | "refused" | "bad" | "unknown" | "missing";
  bytes: string;
  gap_ms?: number | null;
  after_ms?: number | null;
  late?: boolean;
}

/** Something that takes longer than an answer may: a scan, a change of settings. */
export interface Operation {
  op: string;
  kind: string;
  state: "running" | "done" | "cancelled" | "failed";
  done: number;
  total: number;
  percent: number;
  found: number;
  left_ms?: number;
  estimate_ms?: number;
  result?: ScanResult;
  settings?: SettingsRun;
  error?: Problem;
}

export interface ScanResult {
  modules: Found[];
  complete: boolean;
  /** Where two modules seem to be. */
  conflicts: { line: string; address: number; protocol: string; baud: number }[];
  /** Modules of the configuration that did not answer. */
  missing?: string[];
  /** Lines on which modules were found only by a longer wait: others may be missing. */
  slow?: string[];
}

export interface Found {
  line: string;
  address: number;
  protocol: string;
  model: string | null;
  title: string;
  baud: number;
  format: string;
  checksum: boolean | null;
  rtt_ms?: number;
  verdict: "ok" | "could_be" | "refused" | "odd" | "garbled" | "silent";
  /** The models that it could be, where nothing proves one. */
  could_be: string[];
  evidence: string[];
  /** Its name where the configuration has it. */
  name?: string;
  /** The configuration says that it is another model. */
  differs?: boolean;
  suggest?: string;
}

export interface PortInfo {
  path: string;
  stable?: string;
  by_id?: string;
  driver?: string;
  description?: string;
  in_use_by?: string;
  line?: string;
}

export interface Load {
  busy_percent: number;
  polls: { module: string; share_percent: number; max_age_ms: number }[];
  exchanges: number;
  errors: Record<string, number>;
}

/** A step of a scene: an output and its new state, or a pause. */
export interface Step {
  path?: string;
  value?: boolean;
  wait_ms?: number;
}

/** A group or a scene, as it is edited. */
export interface GroupOrScene {
  id: string;
  name?: Partial<Record<string, string>>;
  steps: Step[];
}

/** A setting that a module keeps. */
export interface Setting {
  setting: string;
  value: string | null;
  range: string;
  words?: string[];
  min?: number;
  max?: number;
  unit?: string;
  writable: boolean;
  access: "written" | "at_power_up" | "makers_software" | "init_pin" | "in_ascii" | "fixed";
  source: "module" | "place" | "unknown";
}

export interface Settings {
  etag: string;
  settings: Setting[];
  /** A change of which nobody knows how it ended. */
  open?: number;
}

export interface SettingChange {
  setting: string;
  before: string;
  after: string;
}

/** What a change takes. */
export interface SettingsPlan {
  etag: string;
  changes: SettingChange[];
  frames: { frame: string; meaning: string }[];
  warnings: string[];
  power_cycle: boolean;
}

/** A change under way. */
export interface SettingsRun {
  module: string;
  change: number;
  stage: "reading" | "vacancy" | "writing" | "looking" | "power_cycle" | "calibrating";
  power_left_s?: number;
  changes: SettingChange[];
  end?: string;
  place?: string;
  /** Where it is being looked for. */
  looking?: string;
  /** How two on one address are parted. */
  parting?: "plug" | "pin" | "boards";
  /** What is asked now. */
  question?: { step: "zero" | "span"; readings: [number, number]; voltage?: number; wait_s: number };
  calibration?: Record<"before" | "zero" | "span", [number, number] | null>;
}

/** A change in the journal. */
export interface LoggedChange {
  change: number;
  at: string;
  state: "intent" | "done" | "filed" | "pending" | "unchanged" | "elsewhere" | "lost" | "untold";
  undoes?: number;
  rolled_back: boolean;
  undoable: boolean;
  set: Record<string, [string, string]>;
}

/** What a frame of one's own is and may do. */
export interface SendPlan {
  protocol: string;
  bytes: string;
  meaning: string;
  risk: string;
  /** Somebody answers it. */
  answered: boolean;
  modules: string[];
  may: string[];
  /** The words that the request must hold to be sent. */
  needs: ("output" | "settings" | "broadcast" | "override")[];
}

export interface SendAnswer {
  bytes: string;
  outcome: "answered" | "garbled" | "silent" | "unsafe";
  says?: string;
  refused: boolean;
  after_ms: number;
  audit?: string;
}

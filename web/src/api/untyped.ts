// What the OpenAPI document does not describe: kept by hand, only the fields that the pages use.

/** A frame on a line, or a missing reply: a record of `railbus sniff -o json`, over the WebSocket. */
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

/** A port, as `/ports` lists it. */
export interface PortInfo {
  path: string;
  stable?: string;
  by_id?: string;
  driver?: string;
  description?: string;
  in_use_by?: string;
  line?: string;
}

/** A finding of `/doctor`. */
export interface Finding {
  section: string;
  state: "ok" | "warning" | "error";
  code?: string | null;
  message: string;
  likely?: string | null;
  hint?: string[];
  fix?: string[];
}

/** The configuration, as `/config` answers it. */
export interface ConfigFile {
  file: string;
  text: string;
  etag: string;
}

/** What is wrong with a configuration, as `/config/check` and refused changes say it. */
export interface ConfigProblem {
  line?: number;
  column?: number;
  code?: string;
  reason?: string;
  message?: string;
}

/** An earlier version of the configuration. */
export interface Generation {
  id: number | string;
  at: string;
  who: string;
  bytes: number;
}

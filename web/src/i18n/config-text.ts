import type { Pair } from "./index.svelte";

/** The text of a configuration, on the pages of a site and of a centre. */
export const configText = {
  config_text: ["Text of the configuration", "配置内容"],
  config_reload: ["Discard changes", "放弃并重新加载"],
  problem_at: ["Line {line}, column {column}", "第 {line} 行，第 {column} 列"],
} as const satisfies Record<string, Pair>;

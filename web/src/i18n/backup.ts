import type { Pair } from "./index.svelte";

/** The configuration, its generations, and what differs. */
export const backup = {
  config_file: ["File", "文件"],
  config_text: ["Text of the configuration", "配置内容"],
  config_check: ["Check", "检查"],
  config_save: ["Save and use", "保存并启用"],
  config_good: ["Nothing is wrong with it.", "检查通过。"],
  config_kept: ["The configuration is saved and in use", "配置已保存并生效"],
  config_conflict: [
    "Somebody else changed it meanwhile. Load it again; your text stays in this field until you do.",
    "配置已被他人修改。请重新加载；加载前您的内容仍保留在此。",
  ],
  config_reload: ["Throw away and load", "放弃并重新加载"],
  config_changed: ["changed", "已修改"],
  problem_at: ["Line {line}, column {column}", "第 {line} 行，第 {column} 列"],
  download: ["Download", "下载"],
  generations: ["Generations", "历史版本"],
  generations_why: [
    "Every change keeps the text before it. Choose two to compare; any of them can come back.",
    "每次修改都会保留之前的内容。可选择两个版本比较，也可恢复任一版本。",
  ],
  generations_none: ["Nothing was changed yet.", "尚无修改。"],
  generation_now: ["as it is now", "当前内容"],
  compare: ["Compare", "比较"],
  compare_from: ["From", "从"],
  compare_to: ["to", "到"],
  diff_same: ["There is no difference.", "没有差异。"],
  diff_counts: ["{n} lines added, {m} taken away", "增加 {n} 行，删除 {m} 行"],
  diff_skipped: ["{n} equal lines", "{n} 行相同"],
  restore: ["Restore", "恢复"],
  restore_title: ["Restore the text of {at}", "恢复 {at} 的内容"],
  restore_why: ["This is what will change. Untick what shall stay as it is.", "将产生以下变化，取消勾选即保留现状。"],
  restore_file: ["Restore from a file…", "从文件恢复…"],
  diff_take: ["Change {n}", "变更 {n}"],
} as const satisfies Record<string, Pair>;

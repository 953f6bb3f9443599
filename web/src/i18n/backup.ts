import type { Pair } from "./index.svelte";

/** The configuration, its generations, and what differs. */
export const backup = {
  config_file: ["File", "文件"],
  config_check: ["Check", "检查"],
  config_save: ["Save and apply", "保存并启用"],
  config_good: ["Valid.", "检查通过。"],
  config_kept: ["Configuration saved and applied", "配置已保存并生效"],
  config_conflict: [
    "It was changed elsewhere. Reload it; your text stays in this field until you do.",
    "配置已被他人修改。请重新加载；加载前您的内容仍保留在此。",
  ],
  config_changed: ["changed", "已修改"],
  download: ["Download", "下载"],
  generations: ["History", "历史版本"],
  generations_why: [
    "Every change is kept. Compare two versions or restore one.",
    "每次修改都会保留之前的内容。可选择两个版本比较，也可恢复任一版本。",
  ],
  generations_none: ["No changes yet.", "尚无修改。"],
  generation_now: ["current version", "当前内容"],
  compare: ["Compare", "比较"],
  compare_from: ["From", "从"],
  compare_to: ["to", "到"],
  diff_same: ["No differences.", "没有差异。"],
  diff_counts: ["{n} lines added, {m} removed", "增加 {n} 行，删除 {m} 行"],
  diff_skipped: ["{n} identical lines", "{n} 行相同"],
  restore: ["Restore", "恢复"],
  restore_title: ["Restore version of {at}", "恢复 {at} 的内容"],
  restore_why: ["These changes will be made. Untick what should stay as it is.", "将产生以下变化，取消勾选即保留现状。"],
  restore_file: ["Restore from a file…", "从文件恢复…"],
  diff_take: ["Change {n}", "变更 {n}"],
} as const satisfies Record<string, Pair>;

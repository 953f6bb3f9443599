import type { Pair } from "./index.svelte";

/** The program itself, and what it is connected with. */
export const system = {
  version: ["Version", "版本"],
  uptime: ["Uptime", "已运行"],
  memory: ["Memory", "内存"],
  contains: ["Site", "站点"],
  contains_n: ["lines: {lines}, modules: {modules}, points: {points}", "{lines} 条总线，{modules} 个模块，{points} 个点位"],
  storage: ["History", "历史存储"],
  storage_size: ["{size}, since {oldest}", "{size}，自 {oldest} 起"],
  storage_full: ["Disk full: history is paused, control still works.", "磁盘已满：不再保存历史，控制不受影响。"],
  doctor: ["Diagnostics", "诊断"],
  doctor_again: ["Run again", "重新诊断"],
  doctor_well: ["No problems found.", "一切正常。"],
  state_ok: ["OK", "正常"],
  state_warning: ["Check", "需注意"],
  state_error: ["Fault", "故障"],
  doctor_likely: ["Likely: {why}", "可能原因：{why}"],
  doctor_fix: ["Run this", "可执行"],
  metrics: ["Metrics", "指标"],
  metrics_why: [
    "Prometheus-compatible metrics. Create a viewer token and save it to a file.",
    "Prometheus 等可在此读取指标。请创建查看者令牌并存入文件。",
  ],
  metrics_address: ["Address", "地址"],
  metrics_config: ["For prometheus.yml", "用于 prometheus.yml"],
  metrics_sample: ["Preview", "查看当前内容"],
  http_api: ["HTTP and WebSocket", "HTTP 与 WebSocket"],
  http_api_why: ["Everything in this UI is available through the API.", "本页面的所有功能均可由程序调用。"],
} as const satisfies Record<string, Pair>;

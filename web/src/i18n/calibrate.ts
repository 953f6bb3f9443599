import type { Pair } from "./index.svelte";

/** A calibration, step by step. */
export const calibrate = {
  cal: ["Calibration", "校准"],
  cal_about: [
    "Two steps: zero with all inputs disconnected, then span with a known voltage at all of them. Steps cannot be undone. Polling of the line pauses until you finish.",
    "分两步：先断开所有输入校零，再给所有输入加上已知电压校满度。每步均无法撤销；结束前独占总线，暂停轮询。",
  ],
  cal_voltage: ["Voltage of the second step", "第二步所加电压"],
  cal_begin: ["Start…", "开始…"],
  cal_zero: ["Step 1 of 2: disconnect all inputs of {module}", "第 1 步（共 2 步）：断开 {module} 的所有输入"],
  cal_span: ["Step 2 of 2: put {volts} V at all inputs of {module}", "第 2 步（共 2 步）：给 {module} 的所有输入加上 {volts} V"],
  cal_zero_go: ["They are disconnected: zero", "已断开：校零"],
  cal_span_go: ["It is applied: span", "已加上：校满度"],
  cal_stop: ["Stop here", "到此停止"],
  cal_now: ["The inputs read now: {first} and {second}", "输入现在的读数：{first} 和 {second}"],
  cal_wait: ["Without an answer it ends after {n} minutes.", "{n} 分钟内无操作则自动停止。"],
  cal_before: ["before", "校准前"],
  cal_after_zero: ["after zero", "校零后"],
  cal_after_span: ["after span", "校满度后"],
  cal_readings: ["Readings", "读数"],
  cal_done: ["Calibrated (confirmed by the module)", "校准完成：模块已报告"],
  cal_stopped: ["Stopped; completed steps stay", "已停止；此前完成的步骤保留"],
} as const satisfies Record<string, Pair>;

import type { Pair } from "./index.svelte";

export const demo = {
  sim_what: [
    "These modules are simulated. Press their inputs, or let something go wrong, and watch what the site makes of it.",
    "这些模块是模拟的。可以按动输入或制造故障，看看站点如何反应。",
  ],
  sim_power_on: ["power on", "已通电"],
  sim_power_off: ["power off", "已断电"],
  sim_faults: ["Faults", "故障"],
  fault_mute: ["mute", "不应答"],
  fault_dead: ["dead", "断电"],
  fault_delay: ["slow", "应答慢"],
  fault_flip: ["bit errors", "误码"],
  fault_drop: ["lost frames", "丢帧"],
  sim_once: ["bad replies for 2 s", "2 秒坏应答"],
  sim_once_done: ["{module} answers badly for 2 s", "{module} 将在 2 秒内给出坏应答"],
  sim_clear: ["all well again", "恢复正常"],
  sim_order: ["Order of the simulator", "模拟器命令"],
  sim_give: ["Send", "发送"],
} as const satisfies Record<string, Pair>;

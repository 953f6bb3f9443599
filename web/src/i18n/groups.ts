import type { Pair } from "./index.svelte";

/** Groups and scenes. */
export const groups = {
  groups: ["Groups", "组"],
  scenes: ["Scenes", "场景"],
  group_on: ["All on", "组吸合"],
  group_off: ["All off", "组断开"],
  group_toggle: ["Toggle", "组翻转"],
  group_members: ["{n} outputs, {m} on", "{n} 个输出，{m} 个吸合"],
  group_frames: ["goes out in {n} frames", "以 {n} 帧发送"],
  group_done: ["{name}: {n} of {m} confirmed", "{name}：{m} 个中 {n} 个已确认"],
  group_undone: ["{name}: not everything could be done, so all was taken back", "{name}：未能全部执行，已全部撤回"],
  group_sure: ["{what}: {name}?", "{what}：{name}？"],
  group_sure_why: [
    "Among the outputs are some that may only be switched on purpose: {points}",
    "其中部分输出须确认后才能操作：{points}",
  ],
  scene_run: ["Run", "执行"],
  scene_wait: ["wait {time}", "等待 {time}"],
  groups_none: ["There are no groups and no scenes yet.", "还没有组和场景。"],
  group_new: ["New group", "新建组"],
  scene_new: ["New scene", "新建场景"],
  together_id: ["Short name", "标识"],
  together_id_hint: ["Small letters, digits and _; programs use it.", "小写字母、数字和下划线，供程序使用。"],
  output_add: ["Add an output", "添加输出"],
  scene_pause: ["Pause, ms", "等待（毫秒）"],
  scene_pause_add: ["Add a pause", "添加等待"],
  move_up: ["Move {what} up", "上移 {what}"],
  move_down: ["Move {what} down", "下移 {what}"],
  together_remove_what: [
    "No output is switched. Under Backup the configuration can be brought back.",
    "不会切换任何输出。可在“备份”中恢复配置。",
  ],
} as const satisfies Record<string, Pair>;

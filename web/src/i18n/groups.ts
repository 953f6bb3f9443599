import type { Pair } from "./index.svelte";

/** Groups and scenes. */
export const groups = {
  nav_groups: ["Groups & scenes", "组与场景"],
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
  groups_how: [
    "Groups and scenes stand in the configuration, for example:",
    "组与场景写在配置文件中，例如：",
  ],
  groups_edit: ["Edit the configuration", "编辑配置"],
} as const satisfies Record<string, Pair>;

import type { Pair } from "./index.svelte";

/** Looking for a module, and parting two on one address. */
export const recover = {
  rec: ["Look for the module", "查找模块"],
  rec_about: [
    "Looks at the configured address first, then at every address and speed of this family. Read-only. If found, the configuration is updated. This may take minutes; polling of the line pauses.",
    "先在配置的位置查找，再逐一尝试该型号的各种波特率和地址。只读取，不写入；找到后自动更新配置。可能需要几分钟，期间暂停轮询该总线。",
  ],
  rec_begin: ["Start", "开始查找"],
  rec_looking: ["looking at {place}", "正在查找 {place}"],
  rec_stop: ["Stop", "停止"],
  rec_stopped: ["Stopped: not found yet", "已停止：尚未找到"],
  rec_in_place: ["Found in its place: {place}", "在原位：{place}"],
  rec_moved: ["Found at {place}; configuration updated", "在 {place} 找到；配置已更新"],
  rec_done: ["Found at {place}: the change was carried out", "在 {place} 找到：更改已完成"],
  rec_unchanged: ["Found at {place}: the change was not carried out", "在 {place} 找到：更改未执行"],
  rec_pending: [
    "Found at {place}: the change is not in effect yet; this model usually applies it at the next power-up",
    "在 {place} 找到：更改尚未生效，该型号通常在下次上电时生效",
  ],
  rec_elsewhere: ["Found at {place}: values are neither the old nor all of the new ones", "在 {place} 找到：既非原值也非全部新值"],
  rec_untold: ["Found at {place}: cannot be confirmed", "在 {place} 找到：无法确认"],
  part: ["Separate the two modules", "分开两个模块"],
  part_plug: ["Unplug one of the two from the line.", "将其中一个从总线上拔下。"],
  part_pin: ["Ground INIT* of one of the two: it then speaks LC-02 and leaves the other alone.", "将其中一个的 INIT* 接地：它改用 LC-02，另一个便单独应答。"],
  part_boards: ["Take one of the two boards off the line.", "将其中一块板从总线断开。"],
  part_address: [
    "Give the other a free address: in the settings of the module above, as soon as they can be read again.",
    "给另一个设置空闲地址：在上方的模块设置中，待能读取后更改。",
  ],
  part_plug_back: ["Plug the first in again: it is alone at the old address. Then scan and add it.", "重新插上第一个：原地址上只剩它。然后扫描并添加。"],
  part_pin_back: ["Open INIT* again.", "断开 INIT*。"],
  part_boards_back: ["Connect the first board again: it is alone at the old address. Then scan and add it.", "接回第一块板：原地址上只剩它。然后扫描并添加。"],
  part_known: ["Address {address}: separate them in the settings of {module}", "地址 {address}：在 {module} 的设置中分开"],
  part_unknown: [
    "Unplug one of the two, scan again, add the other and give it a free address; then reconnect the first.",
    "拔下其中一个，重新扫描，添加另一个并设置空闲地址；然后接回第一个。",
  ],
} as const satisfies Record<string, Pair>;

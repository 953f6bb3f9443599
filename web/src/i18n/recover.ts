import type { Pair } from "./index.svelte";

/** Looking for a module, and parting two on one address. */
export const recover = {
  rec: ["Look for the module", "寻找模块"],
  rec_about: [
    "It is asked where it should be, then at every speed and address of its kind. Nothing is written to it; where it is found, the configuration follows. This may take minutes, while the other modules of the line are not polled.",
    "先在应在的位置询问，再逐一尝试该型号的各种波特率和地址。不向模块写入任何内容；找到后配置随之更新。可能需要几分钟，期间总线上其他模块暂停轮询。",
  ],
  rec_begin: ["Look for it", "开始寻找"],
  rec_looking: ["looking at {place}", "正在查找 {place}"],
  rec_stop: ["Stop", "停止"],
  rec_stopped: ["Stopped: it was not found yet", "已停止：尚未找到"],
  rec_in_place: ["It is where it should be: {place}", "在原位：{place}"],
  rec_moved: ["Found at {place}; the configuration says so now", "在 {place} 找到；配置已更新"],
  rec_done: ["Found at {place}: the change was carried out", "在 {place} 找到：更改已完成"],
  rec_unchanged: ["Found at {place}: the change was not carried out", "在 {place} 找到：更改未执行"],
  rec_pending: ["Found at {place}: the change acts at its next power-up", "在 {place} 找到：更改在下次上电时生效"],
  rec_elsewhere: ["Found at {place}: it keeps neither the old nor all of the new values", "在 {place} 找到：既非原值也非全部新值"],
  rec_untold: ["Found at {place}: it does not tell whether this was done", "在 {place} 找到：模块不报告是否已执行"],
  part: ["To part the two", "分开两个模块"],
  part_plug: ["Unplug one of the two from the line.", "将其中一个从总线上拔下。"],
  part_pin: ["Ground INIT* of one of the two: it then speaks LC-02 and leaves the other alone.", "将其中一个的 INIT* 接地：它改用 LC-02，另一个便单独应答。"],
  part_boards: ["Take one of the two boards off the line.", "将其中一块板从总线断开。"],
  part_address: [
    "Give the other a free address: in the settings of the module above, as soon as they can be read again.",
    "给另一个设置空闲地址：在上方的模块设置中，待能读取后更改。",
  ],
  part_plug_back: ["Plug the first in again: it is alone at the old address. Then search for modules and add it.", "重新插上第一个：原地址上只剩它。然后搜索模块并添加。"],
  part_pin_back: ["Open INIT* again.", "断开 INIT*。"],
  part_boards_back: ["Connect the first board again: it is alone at the old address. Then search for modules and add it.", "接回第一块板：原地址上只剩它。然后搜索模块并添加。"],
  part_known: ["Address {address}: part them from the settings of {module}", "地址 {address}：在 {module} 的设置中分开"],
  part_unknown: [
    "Address {address}: no module of the configuration. Unplug one of the two, search again, add the other and give it a free address; then plug the first in.",
    "地址 {address}：配置中没有该模块。拔下其中一个，重新搜索，添加另一个并设置空闲地址；然后插上第一个。",
  ],
} as const satisfies Record<string, Pair>;

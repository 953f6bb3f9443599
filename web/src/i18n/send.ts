import type { Pair } from "./index.svelte";

/** Sending a raw frame. */
export const send = {
  send_open: ["Send frame…", "发送报文…"],
  send_title: ["Send a frame on line {line}", "在总线 {line} 上发送一条报文"],
  send_bytes: ["Frame", "报文"],
  send_form_hex: ["Hexadecimal, as 03 01 00 3C 00 08", "十六进制，如 03 01 00 3C 00 08"],
  send_form_text: ["As it is, such as $016, or in hexadecimal", "原样输入，如 $016；也可用十六进制"],
  send_complete: ["Add checksum and end", "自动补上校验和与结束符"],
  send_whole: ["Sent as", "实际发送"],
  send_reads: ["Read-only: nothing changes.", "只读取，不造成任何改变。"],
  send_may: ["Possible effects", "可能造成的改变"],
  send_mean_output: ["Yes, switch outputs", "确认：用此报文动作输出"],
  send_mean_settings: ["Yes, change the module's settings", "确认：用此报文更改模块保存的设置"],
  send_mean_broadcast: ["All modules will obey: type “{word}” to confirm", "所有模块都会执行：确认请输入“{word}”"],
  send_mean_override: ["Yes, override the configured locks", "确认：绕过配置中的限制"],
  send_now: ["Send", "发送"],
  send_log: ["Sent", "已发送"],
  send_after: ["after {ms} ms", "{ms} 毫秒后"],
  send_silent: ["no reply", "无应答"],
  send_unanswered: ["sent; this frame has no reply", "已发送；此类报文无应答"],
  send_garbled: ["unexpected reply", "应答与此报文不符"],
  send_unsafe: ["not sent: another module on this line would take it as a command", "未发送：总线上另一模块会把它当作命令"],
  send_no: ["refused by the module", "模块拒绝"],
  send_anew: ["The modules concerned were read again.", "相关模块已重新读取。"],
} as const satisfies Record<string, Pair>;

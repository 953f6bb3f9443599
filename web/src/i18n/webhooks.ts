import type { Pair } from "./index.svelte";

/** Who is told of events over HTTP. */
export const webhooks = {
  webhooks: ["Webhooks", "Webhook"],
  webhooks_why: [
    "Each event is sent to these addresses as it happens, in order. What can't be delivered is tried again for a while.",
    "事件发生时按顺序发送到以下地址；未能送达时会在一段时间内重试。",
  ],
  webhooks_none: ["No webhooks.", "没有 webhook。"],
  webhook_new: ["New webhook", "新建 webhook"],
  webhook_kept: ["{name} saved", "已保存 {name}"],
  webhook_gone: ["{name} removed", "已删除 {name}"],
  webhook_gone_what: ["Nothing more is sent there, and its secret is deleted.", "不再向该地址发送，密钥一并删除。"],
  webhook_state_off: ["off", "已停用"],
  webhook_state_idle: ["nothing sent yet", "尚未发送"],
  webhook_state_ok: ["OK", "正常"],
  webhook_state_failing: ["failing", "发送失败"],
  webhook_signed: ["signed", "已签名"],
  webhook_counts: [
    "delivered: {delivered}, waiting: {queue}, not delivered: {failed}, dropped: {dropped}",
    "已送达 {delivered}，等待 {queue}，未送达 {failed}，丢弃 {dropped}",
  ],
  webhook_last: ["Last delivery", "最近送达"],
  webhook_error: ["Last error", "最近错误"],
  webhook_test: ["Send a test", "发送测试"],
  webhook_test_ok: ["{name} accepted the test: HTTP {status}, {ms} ms", "{name} 已接收测试：HTTP {status}，{ms} ms"],
  webhook_test_failed: ["Test to {name} failed ({ms} ms)", "{name} 未接收测试（{ms} ms）"],
  webhook_name: ["Name (a-z, 0-9, _)", "名称（a-z、0-9、_）"],
  webhook_url: ["Address of the receiver", "接收方地址"],
  webhook_events: ["Event types (none = all)", "事件类型；不选表示全部"],
  webhook_severity: ["At least", "最低级别"],
  webhook_about: ["Only about these modules and lines", "仅限这些模块和总线"],
  webhook_about_hint: ["Leave empty for all, or names such as pump, main", "留空表示全部，或填名称如 pump, main"],
  webhook_enabled: ["Sends events", "发送事件"],
  webhook_secret: ["Secret", "密钥"],
  webhook_secret_hint: [
    "16 characters or more, the same at the receiver. Leave empty to keep. It is never shown again.",
    "至少 16 个字符，与接收方一致。留空则不变。保存后不再显示。",
  ],
  webhook_secret_make: ["Generate", "生成"],
  webhook_secret_none: ["Remove the secret", "取消密钥"],
  webhook_how: ["What the receiver gets", "接收方收到的内容"],
  webhook_how_body: [
    "A POST with JSON: site, and event in the format of /events. X-Railbus-Event is a unique ID; use it to detect duplicates. Any answer from 200 to 299 within 10 s counts as delivered; redirects are not followed.",
    "以 POST 发送 JSON：site 以及与 /events 相同格式的 event。X-Railbus-Event 为事件编号，可用于识别重复。10 秒内返回 200 至 299 即视为已接收；不跟随重定向。",
  ],
  webhook_how_signed: [
    "With a secret, X-Railbus-Signature is sha256= and the HMAC-SHA256, in hexadecimal, of X-Railbus-Timestamp, a dot and the body as it came. Compare it in constant time, and refuse what is older than five minutes.",
    "设有密钥时，X-Railbus-Signature 为 sha256= 加上对“X-Railbus-Timestamp、一个点、原始正文”计算的 HMAC-SHA256（十六进制）。请用恒定时间比较，并拒绝超过五分钟的请求。",
  ],
} as const satisfies Record<string, Pair>;

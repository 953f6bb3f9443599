import type { Pair } from "./index.svelte";

/** The reference of the API. */
export const api = {
  api_why: [
    "What programs may ask of this daemon, made of the document that describes it.",
    "程序可调用的全部接口，由接口描述文档生成。",
  ],
  api_document: ["The document (OpenAPI 3.1)", "接口文档（OpenAPI 3.1）"],
  api_filter: ["Find in the API", "搜索接口"],
  api_try: ["Try it", "试一试"],
  api_send: ["Send", "发送"],
  api_acts: ["This is sent to the real site.", "此请求将作用于真实站点。"],
  api_body: ["Body", "请求体"],
  api_takes: ["Takes", "请求体"],
  api_answers: ["Answers", "返回"],
  api_params: ["Parameters", "参数"],
  api_took: ["{status}, after {ms} ms", "{status}，用时 {ms} 毫秒"],
} as const satisfies Record<string, Pair>;

import type { Pair } from "./index.svelte";

/** The reference of the API. */
export const api = {
  api_why: ["API reference, generated from the OpenAPI document.", "程序可调用的全部接口，由接口描述文档生成。"],
  api_document: ["OpenAPI file", "接口文档（OpenAPI）"],
  api_filter: ["Find in the API", "搜索接口"],
  api_try: ["Try it", "试一试"],
  api_send: ["Send", "发送"],
  api_acts: ["This request acts on the real site.", "此请求将作用于真实站点。"],
  api_body: ["Body", "请求体"],
  api_takes: ["Request body", "请求体"],
  api_answers: ["Responses", "返回"],
  api_params: ["Parameters", "参数"],
  api_took: ["{status}, after {ms} ms", "{status}，用时 {ms} 毫秒"],
} as const satisfies Record<string, Pair>;

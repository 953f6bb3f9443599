import type { Pair } from "./index.svelte";

/** The first setup. */
export const setup = {
  setup: ["Welcome to railbus", "欢迎使用 railbus"],
  setup_is_done: ["This is set up already. Sign in to use it.", "已完成设置，请登录使用。"],
  setup_steps: ["Steps", "步骤"],
  step_language: ["Language", "语言"],
  step_password: ["Password", "密码"],
  step_line: ["Line", "总线"],
  step_scan: ["Modules", "模块"],
  step_done: ["Ready", "完成"],
  step_title_language: ["Which language?", "选择语言"],
  step_title_password: ["Create the administrator", "创建管理员"],
  step_title_line: ["Where are the modules connected?", "模块接在哪里？"],
  step_title_scan: ["Which modules are there?", "有哪些模块？"],
  step_title_done: ["All set", "设置完成"],
  setup_demo: [
    "This is the demo: its line “{lines}” is simulated and ready. It is safe to try everything.",
    "这是演示：仿真总线“{lines}”已就绪。一切均非真实设备，可放心尝试。",
  ],
  setup_scan: [
    "The scan is read-only: no output is switched. Give each module a name you will recognise.",
    "扫描只读取，不会动作任何输出。请为每个模块起一个好找的名称。",
  ],
  setup_later: ["Later", "以后再说"],
  setup_done: [
    "The modules are on the overview. A switch there shows what the module confirms, not what was commanded.",
    "模块已显示在总览中。开关显示的是模块确认的状态，而不是所下的命令。",
  ],
} as const satisfies Record<string, Pair>;

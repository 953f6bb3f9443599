import type { Pair } from "./index.svelte";

/** Setup, signing in, passwords. */
export const start = {
  sign_in: ["Sign in", "登录"],
  user_name: ["User name", "用户名"],
  password: ["Password", "密码"],
  setup: ["Welcome to railbus", "欢迎使用 railbus"],
  setup_needed: [
    "Nobody can sign in yet. Open the link that the daemon printed when it started; it ends in “/setup#k=…”.",
    "还没有用户。请打开守护进程启动时显示的链接，以“/setup#k=…”结尾。",
  ],
  password_old: ["Password until now", "当前密码"],
  password_new: ["New password", "新密码"],
  password_changed: ["The password is changed", "密码已修改"],
  password_rule: ["At least {n} characters", "至少 {n} 个字符"],
  password_show: ["Show the password", "显示密码"],
} as const satisfies Record<string, Pair>;

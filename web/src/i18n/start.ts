import type { Pair } from "./index.svelte";

/** Signing in, passwords. */
export const start = {
  sign_in: ["Sign in", "登录"],
  user_name: ["User name", "用户名"],
  password: ["Password", "密码"],
  setup_needed: [
    "No user exists yet. Open the set-up link printed at start, or get a new one with `railbus user setup-link`.",
    "还没有用户。请打开启动时显示的设置链接，或用 `railbus user setup-link` 重新获取。",
  ],
  password_old: ["Current password", "当前密码"],
  password_new: ["New password", "新密码"],
  password_changed: ["Password changed", "密码已修改"],
  password_rule: ["At least {n} characters", "至少 {n} 个字符"],
  password_show: ["Show the password", "显示密码"],
} as const satisfies Record<string, Pair>;

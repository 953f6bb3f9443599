//! The texts of `railbus user` and `railbus token`.

railbus_words::texts! {
    pub(crate) UserText;

    About {
        en: "Manage the users of the daemon and their roles.",
        zh: "管理可登录守护进程的用户及其权限。",
    }
    Examples {
        en: "  railbus user add li --role admin
  railbus user add wang --role operator --points 'pump.*,oven.k1'
  railbus user list
  railbus user setup-link            for the first user, in a browser",
        zh: "  railbus user add li --role admin
  railbus user add wang --role operator --points 'pump.*,oven.k1'
  railbus user list
  railbus user setup-link            在浏览器中创建首个用户",
    }
    Add { en: "Add a user.", zh: "添加用户。" }
    Passwd {
        en: "Set a new password; ends all sessions of the user.",
        zh: "重设用户密码；其全部会话结束。",
    }
    Lock { en: "Lock a user; ends all sessions of the user.", zh: "锁定用户；其全部会话结束。" }
    Unlock { en: "Unlock a user.", zh: "解除用户锁定。" }
    List { en: "List users.", zh: "列出全部用户。" }
    Remove { en: "Remove a user; ends all sessions of the user.", zh: "删除用户；其全部会话结束。" }
    SetupLink {
        en: "Create a new one-time link for the first user.",
        zh: "生成新的一次性链接，用于创建首个用户。",
    }
    Name { en: "The user's name", zh: "用户名" }
    Role {
        en: "viewer reads, operator switches, engineer configures, admin manages users",
        zh: "viewer 查看，operator 操作，engineer 配置，admin 全部",
    }
    Points {
        en: "Outputs that may be switched, e.g. pump.*; default all",
        zh: "可操作的输出，如 pump.*；省略则为全部",
    }
    Fleet {
        en: "Accounts of the centre of the fleet in this folder",
        zh: "此文件夹中站群的中心账户",
    }
    PasswordFile {
        en: "Read the password from the first line of a file, - for stdin; default: ask",
        zh: "从文件首行读取密码，- 为标准输入；省略则提示输入",
    }
    Added { en: "added {name}", zh: "已添加 {name}" }
    HasPassword { en: "password of {name} changed", zh: "已重设 {name} 的密码" }
    Locked { en: "{name} is locked", zh: "已锁定 {name}" }
    Unlocked { en: "{name} may log in again", zh: "{name} 可重新登录" }
    Removed { en: "removed {name}", zh: "已删除 {name}" }
    Ask { en: "Password of {name}: ", zh: "{name} 的密码：" }
    Again { en: "Repeat the password: ", zh: "再次输入：" }
    Differ { en: "the passwords differ", zh: "两次输入不一致" }
    NoTerminal {
        en: "no terminal to ask for the password; use --password-file",
        zh: "没有可输入密码的终端；请用 --password-file",
    }
    NoFile { en: "can't read the password from {file}", zh: "无法从 {file} 读取密码" }
    UsersHead { en: "USER|ROLE|POINTS|STATE|SINCE", zh: "用户|角色|点位|状态|创建时间" }
    All { en: "all", zh: "全部" }
    Good { en: "active", zh: "有效" }
    IsLocked { en: "locked", zh: "已锁定" }
    Expired { en: "expired", zh: "已过期" }
    TokenAbout {
        en: "Manage tokens for programs that use the daemon over HTTP.",
        zh: "为程序签发令牌，用于通过 HTTP 访问守护进程。",
    }
    TokenExamples {
        en: "  railbus token create ci --role operator --points 'pump.*' --expires 90d
  railbus token list
  railbus token revoke ci",
        zh: "  railbus token create ci --role operator --points 'pump.*' --expires 90d
  railbus token list
  railbus token revoke ci",
    }
    TokenCreate { en: "Create a token; it is shown only once.", zh: "生成令牌，仅显示一次。" }
    TokenList { en: "List tokens (secrets not shown).", zh: "列出全部令牌，不含令牌本身。" }
    TokenRevoke { en: "Revoke a token.", zh: "撤销令牌。" }
    TokenName { en: "The token's name, or its id", zh: "令牌名称或编号" }
    TokenExpires {
        en: "Lifetime in days; default 90d, at most 3650d",
        zh: "有效天数，如 90d（默认），最长 3650d",
    }
    TokenMade {
        en: "{name} ({role}), valid until {until}; shown only once",
        zh: "{name}（{role}），有效期至 {until}；仅显示这一次",
    }
    TokenRevoked { en: "token {name} revoked", zh: "已撤销 {name}" }
    TokensHead {
        en: "TOKEN|ROLE|POINTS|STATE|BY|UNTIL|ID",
        zh: "令牌|角色|点位|状态|签发者|有效期至|编号",
    }
}

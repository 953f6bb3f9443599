//! What `railbus user` and `railbus token` say.

crate::texts::texts! {
    UserText;

    About {
        en: "Says who may log in to the daemon, and what each may do.",
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
    Add { en: "Adds a user.", zh: "添加用户。" }
    Passwd {
        en: "Gives a user another password; all sessions end.",
        zh: "重设用户密码；其全部会话结束。",
    }
    Lock { en: "Locks a user out; all sessions end.", zh: "锁定用户；其全部会话结束。" }
    Unlock { en: "Lets a user in again.", zh: "解除用户锁定。" }
    List { en: "Lists all users.", zh: "列出全部用户。" }
    Remove { en: "Removes a user; all sessions end.", zh: "删除用户；其全部会话结束。" }
    SetupLink {
        en: "Makes a new one-time link with which the first user is made.",
        zh: "生成新的一次性链接，用于创建首个用户。",
    }
    Name { en: "The user's name", zh: "用户名" }
    Role {
        en: "viewer looks, operator switches, engineer configures, admin does all",
        zh: "viewer 查看，operator 操作，engineer 配置，admin 全部",
    }
    Points {
        en: "Outputs that may be switched, as pump.*; all if not said",
        zh: "可操作的输出，如 pump.*；省略则为全部",
    }
    PasswordFile {
        en: "Reads the password from a file's first line, - for stdin; asks if not said",
        zh: "从文件首行读取密码，- 为标准输入；省略则提示输入",
    }
    Added { en: "{name} was added", zh: "已添加 {name}" }
    HasPassword { en: "{name} has another password", zh: "已重设 {name} 的密码" }
    Locked { en: "{name} is locked", zh: "已锁定 {name}" }
    Unlocked { en: "{name} may log in again", zh: "{name} 可重新登录" }
    Removed { en: "{name} was removed", zh: "已删除 {name}" }
    Ask { en: "Password of {name}: ", zh: "{name} 的密码：" }
    Again { en: "The same again: ", zh: "再次输入：" }
    Differ { en: "the two are not the same", zh: "两次输入不一致" }
    NoTerminal { en: "there is no terminal to ask for the password", zh: "没有可输入密码的终端" }
    NoFile { en: "can't read the password from {file}", zh: "无法从 {file} 读取密码" }
    UsersHead { en: "user|role|points|state|since", zh: "用户|角色|点|状态|创建时间" }
    All { en: "all", zh: "全部" }
    Good { en: "good", zh: "有效" }
    IsLocked { en: "locked", zh: "已锁定" }
    Expired { en: "expired", zh: "已过期" }
    TokenAbout {
        en: "Gives programs tokens, with which they use the daemon over HTTP.",
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
    TokenCreate { en: "Makes a token, and shows it this once.", zh: "生成令牌，仅显示一次。" }
    TokenList { en: "Lists all tokens, without themselves.", zh: "列出全部令牌，不含令牌本身。" }
    TokenRevoke { en: "Ends a token.", zh: "撤销令牌。" }
    TokenName { en: "The token's name, or its id", zh: "令牌名称或编号" }
    TokenExpires {
        en: "How many days it lives, as 90d, the usual; 3650d at most",
        zh: "有效天数，如 90d（默认），最长 3650d",
    }
    TokenMade {
        en: "{name} ({role}) until {until}; it is shown this once",
        zh: "{name}（{role}），有效期至 {until}；仅显示这一次",
    }
    TokenRevoked { en: "{name} is good no more", zh: "已撤销 {name}" }
    TokensHead {
        en: "token|role|points|state|by|until|id",
        zh: "令牌|角色|点|状态|签发者|有效期至|编号",
    }
}

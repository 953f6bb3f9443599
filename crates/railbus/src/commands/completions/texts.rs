//! The texts of `railbus completions`.

railbus_words::texts! {
    pub(crate) CompletionsText;

    About {
        en: "Print shell completions for commands, flags and point names.",
        zh: "输出 shell 补全脚本，可补全命令、选项和点名。",
    }
    Examples {
        en: "  railbus completions bash --install
  source <(railbus completions zsh)
  railbus completions fish | source",
        zh: "  railbus completions bash --install
  source <(railbus completions zsh)
  railbus completions fish | source",
    }
    Shell { en: "bash, zsh, fish, powershell or elvish", zh: "bash、zsh、fish、powershell 或 elvish" }
    Install {
        en: "Install it where the shell finds it, and show where",
        zh: "写到 shell 能找到的位置并显示路径",
    }
    Next { en: "one line more is needed in {line}", zh: "还需一行：{line}" }
}

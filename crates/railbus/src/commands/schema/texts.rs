//! The texts of `railbus schema`.

railbus_words::texts! {
    pub(crate) SchemaText;

    About {
        en: "Print the JSON Schema of a command's -o json.",
        zh: "显示命令 -o json 输出的 JSON Schema。",
    }
    Examples {
        en: "  railbus schema                     the commands that have one
  railbus schema get > get.json
  railbus schema error               what -o json writes to stderr",
        zh: "  railbus schema                     有 Schema 的命令
  railbus schema get > get.json
  railbus schema error               -o json 写到标准错误的内容",
    }
    Name {
        en: "A command, or error; default: list them",
        zh: "命令名或 error；省略则列出全部",
    }
}

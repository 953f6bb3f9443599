//! The texts of `railbus config check` and `config path`.

railbus_words::texts! {
    pub(crate) ConfigCheckText;

    CheckAbout {
        en: "Check the configuration for errors and unwise settings.",
        zh: "检查配置中的错误和不妥之处。",
    }
    CheckExamples {
        en: "  railbus config check
  railbus config check --config plant.toml -o json",
        zh: "  railbus config check
  railbus config check --config plant.toml -o json",
    }
    PathAbout { en: "Show which configuration is used, and why.", zh: "显示所用的配置文件及原因。" }
    ByFlag { en: "named by --config", zh: "由 --config 指定" }
    ByEnvironment { en: "named by RAILBUS_CONFIG", zh: "由 RAILBUS_CONFIG 指定" }
    ByDaemon { en: "that of the daemon", zh: "守护进程的配置" }
    ByPlace { en: "first match in the search path", zh: "依次查找的首个文件" }
    Summary {
        en: "{file}: no errors, warnings: {warnings}; modules: {modules}; load at least: {loads}",
        zh: "{file}：没有错误，警告：{warnings}；模块：{modules}；负载至少：{loads}",
    }
}

//! The texts of `railbus scene`.

railbus_words::texts! {
    pub(crate) SceneText;

    About {
        en: "List the configured scenes, or run one.",
        zh: "列出配置中的场景，或执行一个场景。",
    }
    Examples {
        en: "  railbus scene list
  railbus scene run evening
  railbus scene run evening -n               only show the frames",
        zh: "  railbus scene list
  railbus scene run evening
  railbus scene run evening -n               只显示报文",
    }
    List { en: "List all scenes and their steps.", zh: "列出所有场景及其步骤。" }
    Run {
        en: "Run a scene step by step, up to the first step that fails.",
        zh: "执行场景：逐步进行，遇到失败的步骤即停止。",
    }
    Name { en: "The scene, as railbus scene list names it", zh: "场景名称，见 railbus scene list" }
    Head { en: "SCENE|NAME|STEPS", zh: "场景|名称|步骤" }
    Wait { en: "wait {time}", zh: "等待 {time}" }
}

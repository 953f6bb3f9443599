//! The texts of `railbus outlet`.

use railbus_api::outlets::OutletState;

railbus_words::texts! {
    pub(crate) OutletText;

    About {
        en: "The integrations of the daemon: their state, a test, their addresses.",
        zh: "守护进程的集成：状态、测试、地址表。",
    }
    Examples {
        en: "  railbus outlet list
  railbus outlet map scada -o csv > points.csv
  railbus outlet test scada",
        zh: "  railbus outlet list
  railbus outlet map scada -o csv > points.csv
  railbus outlet test scada",
    }
    List { en: "List all integrations and their state.", zh: "列出所有集成及其状态。" }
    Map {
        en: "Show where each point stands at the other side, such as coils and registers.",
        zh: "显示各点位在对方系统中的地址，如线圈和寄存器。",
    }
    Test { en: "Try an integration once.", zh: "测试一个集成。" }
    Name {
        en: "The integration, as railbus outlet list names it",
        zh: "集成名称，见 railbus outlet list",
    }
    Head {
        en: "NAME|KIND|STATE|CLIENTS|DONE|FAILED|ERROR",
        zh: "名称|类型|状态|连接|完成|失败|错误",
    }
    Works { en: "{name} works: {answer}, {ms} ms", zh: "{name} 正常：{answer}，{ms} ms" }
    Off { en: "off", zh: "已停用" }
    Starting { en: "starting", zh: "启动中" }
    Running { en: "running", zh: "运行中" }
    Waiting { en: "failing", zh: "失败" }
    Stopped { en: "stopped", zh: "已停止" }
}

impl OutletText {
    /// The word for a state.
    pub(super) const fn state(state: OutletState) -> OutletText {
        match state {
            OutletState::Starting => OutletText::Starting,
            OutletState::Running => OutletText::Running,
            OutletState::Waiting => OutletText::Waiting,
            OutletState::Stopped => OutletText::Stopped,
        }
    }
}

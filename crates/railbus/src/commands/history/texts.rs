//! What `railbus history` says.

crate::texts::texts! {
    HistoryText;

    About {
        en: "Shows the values that a point had, as the daemon kept them.",
        zh: "显示守护进程保存的某点历史值。",
    }
    Examples {
        en: "  railbus history tank.ai1
  railbus history pump.do0 --since 7d
  railbus history tank.ai1 --since 12h -o csv > tank.csv",
        zh: "  railbus history tank.ai1
  railbus history pump.do0 --since 7d
  railbus history tank.ai1 --since 12h -o csv > tank.csv",
    }
    Point { en: "A point, as pump.do0", zh: "点，例如 pump.do0" }
    Since {
        en: "From how long ago on: 30m, 12h, 7d; 1h if not said",
        zh: "从多久以前开始：30m、12h、7d；默认 1h",
    }
    Head { en: "TIME|VALUE|QUALITY", zh: "时间|值|质量" }
    StretchHead {
        en: "FROM|MEAN|LEAST|GREATEST|SAMPLES|QUALITY",
        zh: "起始|平均|最小|最大|样本数|质量",
    }
}

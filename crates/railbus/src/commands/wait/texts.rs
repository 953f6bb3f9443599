//! The texts of `railbus wait`.

railbus_words::texts! {
    pub(crate) WaitText;

    About {
        en: "Wait until points have the given values.",
        zh: "等待点位达到指定的值。",
    }
    Examples {
        en: "  railbus wait pump.di0=on --timeout 5s
  railbus wait pump.do0=on gate.di0=off      both at the same time
  railbus wait tank.ai1=8.5..10              a range of an analog value
  railbus set pump.do0 on && railbus wait pump.di0=on || echo no feedback",
        zh: "  railbus wait pump.di0=on --timeout 5s
  railbus wait pump.do0=on gate.di0=off      两者同时满足
  railbus wait tank.ai1=8.5..10              模拟量的范围
  railbus set pump.do0 on && railbus wait pump.di0=on || echo 无反馈",
    }
    Wants {
        en: "on or off; a number; a range LOW..HIGH. Only values in good quality count",
        zh: "on 或 off；数值；范围 LOW..HIGH。只有有效值才算",
    }
    Timeout {
        en: "How long to wait in all: 500ms, 5s, 2m; default 10s. Then exit code 12",
        zh: "总等待时间：500ms、5s、2m；默认 10s。超时退出码为 12",
    }
    BadWord {
        en: "\"{word}\" can't be waited for; expected POINT=on, POINT=off, POINT=NUMBER or \
            POINT=LOW..HIGH, as the point is",
        zh: "无法等待 \"{word}\"；按点位类型应写 点位=on、点位=off、点位=数值 或 点位=LOW..HIGH",
    }
    InVain {
        en: "not reached within {time}",
        zh: "{time} 内未达到指定的值",
    }
    Instead {
        en: "waiting for {word}: it is {value}, read {age} ago",
        zh: "等待 {word}：现为 {value}，{age}前读取",
    }
    InsteadDoubtful {
        en: "waiting for {word}: last known {value}, {quality}, read {age} ago",
        zh: "等待 {word}：最后已知 {value}，{quality}，{age}前读取",
    }
    NeverRead {
        en: "waiting for {word}: {value}, {quality}",
        zh: "等待 {word}：{value}，{quality}",
    }
    Unread {
        en: "waiting for {word}: it could not be read in this time",
        zh: "等待 {word}：在此时间内未能读取",
    }
    After { en: "after {time}", zh: "用时 {time}" }
}

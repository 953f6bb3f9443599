//! The texts about unwise settings.

railbus_words::texts! {
    pub UnwiseText;

    Beside { en: "{address} beside {protocol}", zh: "{protocol} 旁的 {address}" }
    Load {
        en: "{percent} % at least; one round takes {round} ms at least",
        zh: "至少 {percent} %；轮询一圈至少 {round} 毫秒",
    }
    Stale {
        en: "one round takes {round} ms at least, max_age is {age} ms",
        zh: "轮询一圈至少 {round} 毫秒，max_age 为 {age} 毫秒",
    }
    Others { en: "{count} of its modules", zh: "其中 {count} 个模块" }
}

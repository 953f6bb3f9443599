//! The meanings of requests and replies, in words. Channels are numbered as in the protocol: the
//! terminals they belong to depend on the model.

use crate::render::{values, wire_words};
use railbus_wire::{Bits, Exchange, PulseWidth, Response, ascii, lc02, r55, rtu};
use railbus_words::hex;
use railbus_words::{Lang, say};

/// The meaning of a request.
pub fn request(lang: Lang, exchange: &Exchange<'_>) -> String {
    match exchange {
        Exchange::Rtu(exchange) => of_rtu(lang, &exchange.request),
        Exchange::Ascii(exchange) => of_ascii(lang, &exchange.request),
        Exchange::Lc02(exchange) => of_lc02(lang, &exchange.request),
        Exchange::R55(exchange) => {
            let text = of_r55(lang, &exchange.request());
            if exchange.expects_reply() {
                text
            } else {
                say!(lang, "{text}, no reply expected", "{text}，不应答")
            }
        }
    }
}

/// The meaning of a reply.
pub fn response(lang: Lang, exchange: &Exchange<'_>, response: &Response<'_>) -> String {
    match (exchange, response) {
        (Exchange::Rtu(asked), Response::Rtu(response)) => by_rtu(lang, &asked.request, response),
        (_, Response::Ascii(response)) => by_ascii(lang, response),
        (_, Response::Lc02(response)) => by_lc02(lang, response),
        (Exchange::R55(asked), Response::R55(response)) => {
            by_r55(lang, &asked.request(), *response)
        }
        _ => String::new(),
    }
}

fn of_rtu(lang: Lang, request: &rtu::Request<'_>) -> String {
    match request {
        rtu::Request::ReadCoils(span) => {
            let (n, from) = (span.count(), span.start());
            say!(
                lang,
                "read {n} coils from {from}",
                "读取 {n} 个线圈，自 {from}"
            )
        }
        rtu::Request::ReadDiscreteInputs(span) => {
            let (n, from) = (span.count(), span.start());
            say!(
                lang,
                "read {n} inputs from {from}",
                "读取 {n} 个开关量输入，自 {from}"
            )
        }
        rtu::Request::ReadHoldingRegisters(span) => {
            let (n, from) = (span.count(), span.start());
            say!(
                lang,
                "read {n} registers from {from}",
                "读取 {n} 个寄存器，自 {from}"
            )
        }
        rtu::Request::ReadInputRegisters(span) => {
            let (n, from) = (span.count(), span.start());
            say!(
                lang,
                "read {n} input registers from {from}",
                "读取 {n} 个输入寄存器，自 {from}"
            )
        }
        rtu::Request::WriteCoil { at, value } => match value.state() {
            Some(on) => {
                let state = values::state(lang, on);
                say!(lang, "coil {at} {state}", "线圈 {at} {state}")
            }
            None => {
                let value = value.0;
                say!(
                    lang,
                    "coil {at} to {value:04X}h",
                    "线圈 {at} 写入 {value:04X}h"
                )
            }
        },
        rtu::Request::WriteRegister { at, value } => {
            say!(lang, "register {at} to {value}", "寄存器 {at} 写入 {value}")
        }
        rtu::Request::WriteCoils(block) => {
            let (from, bits) = (block.start(), bits(block.values()));
            say!(
                lang,
                "coils from {from} to {bits}",
                "线圈自 {from} 写入 {bits}"
            )
        }
        rtu::Request::WriteRegisters(block) => {
            let (from, words) = (block.start(), words(block.values().iter()));
            say!(
                lang,
                "registers from {from} to {words}",
                "寄存器自 {from} 写入 {words}"
            )
        }
        rtu::Request::Diagnose { sub, data } => say!(
            lang,
            "diagnosis {sub:02X}h with {data:04X}h",
            "诊断 {sub:02X}h，数据 {data:04X}h"
        ),
        rtu::Request::Identify { code, object } => say!(
            lang,
            "read identification, kind {code}, from object {object}",
            "读取设备标识，方式 {code}，自对象 {object}"
        ),
    }
}

fn by_rtu(lang: Lang, asked: &rtu::Request<'_>, response: &rtu::Response<'_>) -> String {
    match response {
        rtu::Response::Bits(values) => {
            let bits = bits(values);
            say!(
                lang,
                "states {bits}, first one first",
                "状态 {bits}，首个在前"
            )
        }
        rtu::Response::Words(values) => {
            let words = words(values.iter());
            say!(lang, "registers {words}", "寄存器 {words}")
        }
        rtu::Response::Done => {
            let what = of_rtu(lang, asked);
            say!(lang, "acknowledged: {what}", "已应答：{what}")
        }
        rtu::Response::Diagnosis(data) => {
            say!(lang, "diagnosis: {data:04X}h", "诊断结果：{data:04X}h")
        }
        rtu::Response::Identification(says) => {
            let objects: Vec<String> = says
                .objects()
                .map(|(number, text)| format!("{number} \"{}\"", text.escape_ascii()))
                .collect();
            let objects = objects.join(", ");
            say!(lang, "identification: {objects}", "设备标识：{objects}")
        }
        rtu::Response::Exception(why) => {
            let why = wire_words::exception(lang, *why);
            say!(lang, "refused: exception {why}", "被拒绝：异常码 {why}")
        }
    }
}

fn bits(values: &Bits<'_>) -> String {
    values.iter().map(|on| if on { '1' } else { '0' }).collect()
}

fn words(values: impl Iterator<Item = u16>) -> String {
    let each: Vec<String> = values.map(|word| word.to_string()).collect();
    each.join(" ")
}

fn of_ascii(lang: Lang, request: &ascii::Request) -> String {
    use ascii::Request as R;
    match *request {
        R::ReadName => say!(lang, "read name", "读取模块名"),
        R::ReadFirmware => say!(lang, "read firmware version", "读取固件版本"),
        R::ReadConfig => say!(lang, "read configuration", "读取配置"),
        R::WriteConfig {
            new_address,
            baud_code,
            format,
            ..
        } => say!(
            lang,
            "configure: address {new_address}, speed code {baud_code:02X}h, format {format:02X}h",
            "配置：地址 {new_address}，波特率代码 {baud_code:02X}h，格式 {format:02X}h"
        ),
        R::ReadData => say!(lang, "read outputs and inputs", "读取输出和输入"),
        R::WriteOutputs { order, data } if order == ascii::ALL_OUTPUTS => {
            let set = set(lang, u32::from(data), "do", 0);
            say!(lang, "all outputs: {set}", "全部输出：{set}")
        }
        R::WriteOutputs { order, data } => {
            let (channel, state) = (order & 0x0F, values::state(lang, data & 1 == 1));
            say!(
                lang,
                "output do{channel} {state}",
                "输出 do{channel} {state}"
            )
        }
        R::ReadPulse => say!(lang, "read pulse setting", "读取点动设置"),
        R::WritePulse { mask, width } => pulse(lang, mask, width),
        R::ReadLatched => say!(lang, "read the latched sample", "读取锁存的采样"),
        R::SampleAll => say!(lang, "all modules: sample now", "全部模块：立即采样"),
        R::ReadReset => say!(lang, "read the reset flag", "读取重启标志"),
        R::ReadInit => say!(lang, "read INIT*", "读取 INIT* 状态"),
        R::ReadAll => say!(lang, "read outputs and inputs (@)", "读取输出和输入 (@)"),
        R::HostOk => say!(lang, "all modules: host OK", "全部模块：主机正常"),
        R::ReadWatchdogStatus => say!(lang, "read watchdog status", "读取看门狗状态"),
        R::ClearWatchdog => say!(lang, "clear the watchdog", "清除看门狗"),
        R::ReadWatchdog => say!(lang, "read the watchdog's time", "读取看门狗时间"),
        R::WriteWatchdog { .. } => say!(lang, "set the watchdog", "设置看门狗"),
        R::ReadSafe => say!(
            lang,
            "read power-on and safe outputs",
            "读取上电及安全输出值"
        ),
        R::WriteSafe { .. } => say!(
            lang,
            "set power-on and safe outputs",
            "设置上电及安全输出值"
        ),
        R::Rename(name) => {
            let name = name.as_str();
            say!(lang, "rename to {name}", "改名为 {name}")
        }
    }
}

fn by_ascii(lang: Lang, response: &ascii::Response) -> String {
    use ascii::Response as R;
    match *response {
        R::Text(text) => {
            let text = text.as_str();
            say!(lang, "name or version {text}", "名称或版本 {text}")
        }
        R::Config {
            type_code,
            baud_code,
            format,
        } => say!(
            lang,
            "type {type_code:02X}h, speed code {baud_code:02X}h, format {format:02X}h",
            "类型 {type_code:02X}h，波特率代码 {baud_code:02X}h，格式 {format:02X}h"
        ),
        R::Data { outputs, inputs } => data(lang, outputs, inputs),
        R::Pulse { mask, width } => pulse(lang, mask, width),
        R::Latched {
            outputs, inputs, ..
        } => data(lang, outputs, inputs),
        R::Flag(flag) => {
            let flag = u8::from(flag);
            say!(lang, "flag {flag}", "标志 {flag}")
        }
        R::Status(status) => say!(lang, "status {status:02X}h", "状态 {status:02X}h"),
        R::Watchdog { tenths, .. } => say!(
            lang,
            "watchdog {tenths} × 0.1 s",
            "看门狗 {tenths} × 0.1 秒"
        ),
        R::Safe { power_on, safe } => say!(
            lang,
            "power-on {power_on:02X}h, safe {safe:02X}h",
            "上电 {power_on:02X}h，安全 {safe:02X}h"
        ),
        R::All(word) => say!(
            lang,
            "outputs and inputs {word:04X}h",
            "输出和输入 {word:04X}h"
        ),
        R::Done => say!(lang, "acknowledged", "已应答"),
        R::Invalid => say!(lang, "refused", "被拒绝"),
        R::Ignored => say!(
            lang,
            "refused: the host watchdog has tripped",
            "被拒绝：主机看门狗已动作"
        ),
    }
}

fn of_lc02(lang: Lang, request: &lc02::Request) -> String {
    use lc02::Request as R;
    match *request {
        R::ReadConfig => say!(lang, "read configuration", "读取配置"),
        R::WriteConfig {
            new_address,
            baud_code,
        } => say!(
            lang,
            "configure: address {new_address}, speed code {baud_code:02X}h",
            "配置：地址 {new_address}，波特率代码 {baud_code:02X}h"
        ),
        R::ReadData => say!(lang, "read outputs and inputs", "读取输出和输入"),
        R::WriteOutputs(lc02::Outputs::All(data)) => {
            let set = set(lang, u32::from(data), "do", 0);
            say!(lang, "all outputs: {set}", "全部输出：{set}")
        }
        R::WriteOutputs(lc02::Outputs::One(channel, on)) => {
            let (channel, state) = (channel.index(), values::state(lang, on));
            say!(
                lang,
                "output do{channel} {state}",
                "输出 do{channel} {state}"
            )
        }
        R::WritePulse { mask, width } => pulse(lang, mask, width),
        R::ReadPulse => say!(lang, "read pulse setting", "读取点动设置"),
    }
}

fn by_lc02(lang: Lang, response: &lc02::Response) -> String {
    match *response {
        lc02::Response::Config {
            baud_code, model, ..
        } => say!(
            lang,
            "model {model:04X}h, speed code {baud_code:02X}h",
            "型号 {model:04X}h，波特率代码 {baud_code:02X}h"
        ),
        lc02::Response::Data { outputs, inputs } => data(lang, outputs, inputs),
        lc02::Response::Pulse { mask, width } => pulse(lang, mask, width),
        lc02::Response::Done => say!(lang, "acknowledged", "已应答"),
    }
}

fn of_r55(lang: Lang, request: &r55::Request) -> String {
    use r55::Request as R;
    let k = |mask| set(lang, mask, "k", 1);
    match *request {
        R::ReadState => say!(lang, "read state", "读取状态"),
        R::Open(channel) => format!("k{} {}", channel.index() + 1, values::state(lang, false)),
        R::Close(channel) => format!("k{} {}", channel.index() + 1, values::state(lang, true)),
        R::SetAll(word) => {
            let set = k(word);
            say!(lang, "all outputs: {set}", "全部输出：{set}")
        }
        R::GroupOff(mask) => {
            let set = set(lang, mask, "k", 1).replace(values::state(lang, true), "");
            let set = set.trim();
            say!(lang, "group off: {set}", "组断开：{set}")
        }
        R::GroupOn(mask) => {
            let set = k(mask);
            say!(lang, "group on: {set}", "组接通：{set}")
        }
        R::GroupToggle(mask) => {
            let set = k(mask).replace(values::state(lang, true), "");
            let set = set.trim();
            say!(lang, "group toggle: {set}", "组翻转：{set}")
        }
        R::Toggle(channel) => {
            let n = channel.index() + 1;
            say!(lang, "toggle k{n}", "翻转 k{n}")
        }
        R::JogClose(channel, time) => {
            let (n, time) = (channel.index() + 1, time.get());
            say!(
                lang,
                "pulse: k{n} on for {time} ms",
                "点动接通：k{n} {time} 毫秒"
            )
        }
        R::JogOpen(channel, time) => {
            let (n, time) = (channel.index() + 1, time.get());
            say!(
                lang,
                "pulse: k{n} off for {time} ms",
                "点动断开：k{n} {time} 毫秒"
            )
        }
        R::ReadAddress => say!(lang, "read address", "读取地址"),
        R::WriteAddress(new) => say!(lang, "write address {new}", "写入地址 {new}"),
        R::ReadVariable(index) => say!(lang, "read variable v{index}", "读取变量 v{index}"),
        R::WriteVariable(index, value) => {
            let value = value.get();
            say!(
                lang,
                "variable v{index} to {value}",
                "变量 v{index} 写入 {value}"
            )
        }
    }
}

fn by_r55(lang: Lang, asked: &r55::Request, response: r55::Response) -> String {
    let word = response.to_word();
    match asked {
        r55::Request::ReadState
        | r55::Request::SetAll(_)
        | r55::Request::GroupOn(_)
        | r55::Request::GroupOff(_)
        | r55::Request::GroupToggle(_) => set(lang, word, "k", 1),
        r55::Request::ReadAddress | r55::Request::WriteAddress(_) => {
            let address = word & 0xFF;
            say!(lang, "address {address}", "地址 {address}")
        }
        r55::Request::ReadVariable(_) | r55::Request::WriteVariable(..) => {
            let (index, value) = (word & 0xFF, word >> 8);
            say!(
                lang,
                "variable v{index} is {value}",
                "变量 v{index} 为 {value}"
            )
        }
        _ => {
            let data = hex::spaced(&response.data);
            say!(lang, "acknowledged, data {data}", "已应答，数据 {data}")
        }
    }
}

/// Outputs and inputs of an EDA module.
fn data(lang: Lang, outputs: u8, inputs: u8) -> String {
    let outputs = set(lang, u32::from(outputs), "do", 0);
    let inputs = set(lang, u32::from(inputs), "di", 0);
    say!(
        lang,
        "outputs {outputs}; inputs {inputs}",
        "输出 {outputs}；输入 {inputs}"
    )
}

fn pulse(lang: Lang, mask: u8, width: PulseWidth) -> String {
    let set: Vec<String> = numbers(u32::from(mask), 0)
        .map(|n| format!("do{n}"))
        .collect();
    let set = if set.is_empty() {
        "–".to_owned()
    } else {
        set.join(" ")
    };
    let (whole, tenth) = (width.tenths() / 10, width.tenths() % 10);
    say!(
        lang,
        "pulse outputs {set}, {whole}.{tenth} s",
        "点动输出 {set}，{whole}.{tenth} 秒"
    )
}

/// `k1 k3 on`; `all off`.
fn set(lang: Lang, mask: u32, letters: &str, first: u32) -> String {
    let names: Vec<String> = numbers(mask, first)
        .map(|n| format!("{letters}{n}"))
        .collect();
    if names.is_empty() {
        return say!(lang, "all off", "全部断开");
    }
    format!("{} {}", names.join(" "), values::state(lang, true))
}

fn numbers(mask: u32, first: u32) -> impl Iterator<Item = u32> {
    (0..32)
        .filter(move |bit| mask >> bit & 1 == 1)
        .map(move |bit| bit + first)
}

//! The coils and registers of all units as a table for people.

use super::map::{Content, Run, Space, UnitMap};
use super::units;
use crate::northbound::kind::{AddressMap, Pair};
use railbus_device::{Point, PointKind};
use railbus_site::Config;
use railbus_site::config::ModuleConfig;
use railbus_site::config::change::Keys;
use railbus_words::Lang;

/// Where each point stands.
pub(crate) const MAP: AddressMap = AddressMap {
    columns: &[
        ["Unit", "单元号"],
        ["Module", "模块"],
        ["Point", "点位"],
        ["Table", "数据区"],
        ["Address (from 0)", "地址（从 0 开始）"],
        ["Value", "数值"],
    ],
    rows,
};

/// What the registers about a unit say, in their order.
const STATUS: [Pair; 8] = [
    ["quality: 0 is good", "质量：0 为良好"],
    ["age of the oldest value, 100 ms", "最旧数值的时间，100 ms"],
    ["presence: 1 is online", "在线状态：1 为在线"],
    ["round trip, ms", "往返时间，ms"],
    ["number of the last command", "最近命令的序号"],
    ["its end: 1 is read back", "其结果：1 为回读确认"],
    ["its error code: 301 is E0301", "其错误代码：301 即 E0301"],
    ["its first coil or register", "其首个线圈或寄存器"],
];

fn in_lang([en, zh]: Pair, lang: Lang) -> String {
    match lang {
        Lang::En => en.to_owned(),
        Lang::Zh => zh.to_owned(),
    }
}

fn rows(settings: &Keys, config: &Config, lang: Lang) -> Vec<Vec<String>> {
    let is_uniform = units::is_uniform(settings);
    let units = units::units(settings, config).by_unit;
    let modules = units
        .iter()
        .filter_map(|(unit, name)| Some((*unit, name, config.modules.get(name)?)));
    let mut rows = Vec::new();
    for (unit, name, module) in modules {
        for run in UnitMap::of(&module.setup, is_uniform).runs() {
            for offset in (0..run.count).step_by(usize::from(run.content.registers())) {
                rows.push(vec![
                    unit.to_string(),
                    name.clone(),
                    point(module, run.content, offset),
                    in_lang(space(run.space), lang),
                    (run.start + offset).to_string(),
                    value(module, run, offset, lang),
                ]);
            }
        }
    }
    rows
}

const fn space(space: Space) -> Pair {
    match space {
        Space::Coils => ["coil", "线圈"],
        Space::DiscreteInputs => ["discrete input", "离散输入"],
        Space::HoldingRegisters => ["holding register", "保持寄存器"],
        Space::InputRegisters => ["input register", "输入寄存器"],
    }
}

/// The labels of what stands at this offset.
fn point(module: &ModuleConfig, content: Content, offset: u16) -> String {
    let label = |kind, index: u16| {
        let index = u8::try_from(index).unwrap_or(u8::MAX);
        let (letters, number) = module.setup.label(Point { kind, index });
        format!("{letters}{number}")
    };
    match content {
        Content::Bits(kind) => label(kind, offset),
        Content::OutputWords => {
            let outputs = u16::from(module.setup.outputs);
            let (first, last) = (16 * offset, outputs.min(16 * offset + 16));
            match first < last {
                true => [first, last - 1]
                    .map(|index| label(PointKind::Output, index))
                    .join("–"),
                false => String::new(),
            }
        }
        Content::Raw | Content::Scaled => label(PointKind::Analog, offset),
        Content::Floats => label(PointKind::Analog, offset / 2),
        Content::Numbers => label(PointKind::Variable, offset / 2),
        Content::Status => String::new(),
    }
}

fn value(module: &ModuleConfig, run: &Run, offset: u16, lang: Lang) -> String {
    let analog = |index: u16| {
        let index = u8::try_from(index).unwrap_or(u8::MAX);
        module.range_of(Point {
            kind: PointKind::Analog,
            index,
        })
    };
    match run.content {
        Content::Bits(_) => in_lang(["0 off, 1 on", "0 断，1 通"], lang),
        Content::OutputWords => in_lang(
            [
                "a bit each, the first is bit 0",
                "每位一个输出，首个为第 0 位",
            ],
            lang,
        ),
        Content::Raw => in_lang(["as in the datasheet", "按说明书"], lang),
        Content::Scaled => {
            let range = analog(offset);
            let factor = 10_u32.pow(range.decimals.into());
            match lang {
                Lang::En => format!("int16, {} × {factor}", range.unit),
                Lang::Zh => format!("有符号 16 位，{} × {factor}", range.unit),
            }
        }
        Content::Floats => {
            let unit = &analog(offset / 2).unit;
            match lang {
                Lang::En => format!("float32, high word first, {unit}"),
                Lang::Zh => format!("32 位浮点，高字在前，{unit}"),
            }
        }
        Content::Numbers => in_lang(["uint32, high word first", "无符号 32 位，高字在前"], lang),
        Content::Status => STATUS
            .get(usize::from(offset))
            .map_or_else(String::new, |text| in_lang(*text, lang)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    const SITE: &str = r#"
[line.main]
port = "/dev/ttyS9"
[module]
oven = { line = "main", model = "erc8", address = 3 }
tank = { line = "main", model = "emd2a2q", address = 5 }
board = { line = "main", model = "r55", address = 6, outputs = 20, variables = 1 }
"#;

    #[test]
    fn every_point_has_its_rows() {
        let config = Config::parse(SITE).unwrap();
        let told = |settings: serde_json::Value, lang| {
            let rows = rows(settings.as_object().unwrap(), &config, lang);
            let is_status = |row: &Vec<String>| row[2].is_empty() && row[3].contains("input");
            let (status, points): (Vec<_>, Vec<_>) = rows.into_iter().partition(is_status);
            assert!(status.len() % 8 == 0, "{status:?}");
            points.iter().map(|row| row.join("|")).collect::<Vec<_>>()
        };
        let own = told(
            json!({"units": ["tank=9"], "modules": ["oven", "tank"]}),
            Lang::En,
        );
        assert_eq!(own[0], "3|oven|k1|coil|60|0 off, 1 on");
        assert_eq!(own[7], "3|oven|k8|coil|67|0 off, 1 on");
        assert_eq!(own[10], "9|tank|ai1|holding register|6|as in the datasheet");
        assert_eq!(own.len(), 8 + 4);
        let uniform = told(json!({"map": "uniform", "modules": ["tank"]}), Lang::En);
        assert_eq!(
            uniform[4],
            "5|tank|k1–k2|holding register|0|a bit each, the first is bit 0"
        );
        assert!(uniform.contains(&"5|tank|ai2|input register|1|int16, V × 100".to_owned()));
        let float = "5|tank|ai2|input register|18|float32, high word first, V";
        assert!(uniform.contains(&float.to_owned()), "{uniform:?}");
        let board = told(json!({"modules": ["board"]}), Lang::En);
        assert!(
            board
                .iter()
                .any(|row| row.starts_with("6|board|k17–k20|holding register|1|"))
        );
        assert!(
            board.contains(&"6|board|v0|input register|256|uint32, high word first".to_owned())
        );
        let columns = MAP.columns.len();
        let all = rows(json!({}).as_object().unwrap(), &config, Lang::Zh);
        assert!(all.iter().all(|row| row.len() == columns));
        assert_eq!(all[0][3], "线圈");
    }
}

//! Scans that were interrupted, stored so that they can be resumed.

use super::texts::ScanText;
use crate::commands::Context;
use crate::commands::place::Place;
use railbus_app::config_file;
use railbus_app::failure::Failure;
use railbus_commission::scan::{
    FoundModule, ProbeKind, ScanOptions, ScanPosition, ScanProbe, Scanner, Scope,
};
use railbus_wire::{Address, Baud, Character, Micros, SerialSettings};
use railbus_words::Code;
use railbus_words::hex;
use serde_json::{Value, json};
use std::io::Read;
use std::path::{Path, PathBuf};

/// The largest size of such a file, in bytes.
const LEN_MAX: u64 = 1 << 22;

/// Where the interrupted scan of a line is stored.
#[derive(Debug)]
pub(super) struct Keep {
    file: PathBuf,
    /// The line and all options: a scan is only resumed with the same ones.
    options: String,
}

impl Keep {
    pub(super) async fn of(context: &Context, place: &Place, wish: &ScanOptions) -> Keep {
        let slug = |c: char| if c.is_ascii_alphanumeric() { c } else { '_' };
        let line: String = place.line.chars().map(slug).take(64).collect();
        Keep {
            file: folder(context).await.join(format!("scan-{line}.json")),
            options: options(place, wish),
        }
    }

    /// The scan to resume.
    pub(super) fn resume(&self, context: &Context, scope: Scope) -> Result<Scanner, Failure> {
        let lang = context.lang;
        let none = || {
            let failure = Failure::of(lang, Code::ScanNoneKept);
            failure.because(self.file.display())
        };
        let file = std::fs::File::open(&self.file).map_err(|_| none())?;
        let mut text = String::new();
        let read = file.take(LEN_MAX).read_to_string(&mut text);
        read.map_err(|error| none().because(error))?;
        let kept: Value = serde_json::from_str(&text).map_err(|error| none().because(error))?;
        let options = kept["options"].as_str().unwrap_or_default();
        if kept["schema"] != 1 || options != self.options {
            let told = lang.fill(ScanText::OtherScan, &[("options", &options)]);
            return Err(Failure::of(lang, Code::ScanOther).because(told));
        }
        Ok(scanner(&kept, scope))
    }

    /// Stores an interrupted scan; returns whether that succeeded.
    pub(super) fn put(&self, scanner: &Scanner) -> bool {
        let mut kept = of_scanner(scanner);
        kept["schema"] = 1.into();
        kept["options"] = self.options.as_str().into();
        let folder = self.file.parent().unwrap_or(Path::new("."));
        let draft = self.file.with_extension("new");
        std::fs::create_dir_all(folder)
            .and_then(|()| std::fs::write(&draft, kept.to_string()))
            .and_then(|()| std::fs::rename(&draft, &self.file))
            .is_ok()
    }

    /// Deletes it: the scan is complete.
    pub(super) fn drop(&self) {
        let _ = std::fs::remove_file(&self.file);
    }
}

/// Where the scans of this line are stored.
async fn folder(context: &Context) -> PathBuf {
    let files = match &context.options.ad_hoc {
        None => context.files().await.ok(),
        Some(_) => None,
    };
    files.map_or_else(|| config_file::state_folder(None), |files| files.state)
}

/// The line and the options as text, which differs if any of these differs.
fn options(place: &Place, wish: &ScanOptions) -> String {
    let names = |list: Option<Vec<String>>| list.map_or("-".to_owned(), |list| list.join(","));
    let told = |list: &Option<Vec<u8>>| {
        names(
            list.as_ref()
                .map(|list| list.iter().map(u8::to_string).collect()),
        )
    };
    let protocols = wish.protocols.as_ref();
    let bauds = wish.bauds.as_ref();
    let characters = wish.characters.as_ref();
    let checksum = wish
        .checksum
        .map_or("auto", |on| if on { "on" } else { "off" });
    [
        place.line.clone(),
        place.port.to_string(),
        place.settings.to_string(),
        wish.depth.name().to_owned(),
        format!("addr={}", told(&wish.addresses)),
        format!(
            "proto={}",
            names(protocols.map(|all| all.iter().map(ToString::to_string).collect()))
        ),
        format!(
            "baud={}",
            names(bauds.map(|all| all.iter().map(ToString::to_string).collect()))
        ),
        format!(
            "format={}",
            names(characters.map(|all| all.iter().map(ToString::to_string).collect()))
        ),
        format!("checksum={checksum}"),
    ]
    .join(" ")
}

fn of_scanner(scanner: &Scanner) -> Value {
    let (place, first) = scanner.place();
    json!({
        "run": place.run,
        "asked": place.asked,
        "slow": place.slow,
        "first": first.iter().map(of_question).collect::<Vec<_>>(),
        "found": scanner.found().iter().map(of_found).collect::<Vec<_>>(),
    })
}

fn scanner(kept: &Value, scope: Scope) -> Scanner {
    let number = |key: &str| kept[key].as_u64().and_then(|n| usize::try_from(n).ok());
    let place = ScanPosition {
        run: number("run").unwrap_or_default(),
        asked: number("asked").unwrap_or_default(),
        // Files of older versions don't have it.
        slow: kept["slow"].as_bool().unwrap_or_default(),
    };
    let list = |key: &str| kept[key].as_array().cloned().unwrap_or_default();
    let first: Vec<ScanProbe> = list("first").iter().filter_map(question).collect();
    let found: Vec<FoundModule> = list("found").iter().filter_map(found).collect();
    Scanner::resume(scope, place, &first, found)
}

fn of_question(question: &ScanProbe) -> Value {
    json!({
        "baud": question.settings.baud.rate(),
        "format": question.settings.character.to_string(),
        "ask": question.ask.name(),
        "address": question.address.0,
    })
}

fn question(kept: &Value) -> Option<ScanProbe> {
    let format = kept["format"].as_str()?;
    let baud = u32::try_from(kept["baud"].as_u64()?).ok()?;
    Some(ScanProbe {
        settings: SerialSettings {
            baud: Baud::from_rate(baud)?,
            character: Character::from_name(format)?,
        },
        ask: ProbeKind::from_name(kept["ask"].as_str()?)?,
        address: Address(u8::try_from(kept["address"].as_u64()?).ok()?),
    })
}

fn of_found(found: &FoundModule) -> Value {
    let answers = found.answers.iter();
    let answers = answers.map(|(ask, bytes)| json!([ask.name(), hex::spaced(bytes)]));
    let garbled = found.garbled.iter().map(|bytes| hex::spaced(bytes));
    json!({
        "asked": of_question(&found.asked),
        "rtt_us": found.rtt.0,
        "answers": answers.collect::<Vec<_>>(),
        "garbled": garbled.collect::<Vec<_>>(),
        "twice": found.twice,
    })
}

fn found(kept: &Value) -> Option<FoundModule> {
    let bytes = |text: &Value| Some(hex::parse(text.as_str()?).unwrap_or_default());
    let answer = |pair: &Value| Some((ProbeKind::from_name(pair[0].as_str()?)?, bytes(&pair[1])?));
    let answers = kept["answers"].as_array()?.iter().map(answer);
    let garbled = kept["garbled"].as_array()?.iter().map(bytes);
    let found = FoundModule::of(
        question(&kept["asked"])?,
        answers.collect::<Option<_>>()?,
        garbled.collect::<Option<_>>()?,
        Micros(kept["rtt_us"].as_u64()?),
    );
    Some(FoundModule {
        twice: kept["twice"].as_bool()?,
        ..found
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_found_is_kept_whole() {
        let asked = ScanProbe {
            settings: SerialSettings::FACTORY,
            ask: ProbeKind::AsciiName(true),
            address: Address(7),
        };
        let whole = FoundModule {
            twice: true,
            ..FoundModule::of(
                asked,
                vec![
                    (asked.ask, b"!079060\r".to_vec()),
                    (ProbeKind::Coils0, Vec::new()),
                ],
                vec![vec![1, 2]],
                Micros(5),
            )
        };
        assert_eq!(found(&of_found(&whole)), Some(whole));
        assert_eq!(found(&json!({"asked": 1})), None);
    }

    #[test]
    fn how_far_it_is_and_that_modules_are_slow_is_kept() {
        let asked = ScanProbe {
            settings: SerialSettings::FACTORY,
            ask: ProbeKind::Coils0,
            address: Address(7),
        };
        let answers = vec![(asked.ask, vec![7, 1, 1, 0])];
        let found = FoundModule::of(asked, answers, Vec::new(), Micros::from_millis(160));
        let first = [asked.with(ProbeKind::Lc02Config)];
        let place = ScanPosition {
            run: 2,
            asked: 5,
            slow: true,
        };
        let scope = || Scope::of(&ScanOptions::default(), Vec::new());
        let whole = Scanner::resume(scope(), place, &first, vec![found]);
        let mut kept = of_scanner(&whole);
        let again = scanner(&kept, scope());
        assert_eq!(again.place(), (place, first.to_vec()));
        assert_eq!(again.found(), whole.found());
        assert!(again.is_slow());
        // A file of an older version.
        kept.as_object_mut().unwrap().remove("slow");
        let older = scanner(&kept, scope());
        assert_eq!(
            older.place().0,
            ScanPosition {
                slow: false,
                ..place
            }
        );
        assert!(!older.is_slow());
    }
}

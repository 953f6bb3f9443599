//! The format of the log: one line per record, which begins with a hash of the line before it and
//! of itself. Any byte that is changed and any line that is removed is detected.

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::fmt::Write;

/// The hexadecimal digits of a hash.
pub(super) const HASH_LEN: usize = 64;
/// The longest line.
pub(super) const LINE_MAX: usize = 48 << 10;
/// The longest text in a record; longer ones are cut.
const TEXT_MAX: usize = 1_024;
/// The hash before the first record.
pub(super) const NOTHING: &str = "";

/// A record with its position.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Numbered {
    /// Its number, from 1.
    pub seq: u64,
    /// When it was written, in milliseconds since 1970.
    pub at_ms: u64,
    /// The same by a monotonic clock: microseconds since the log was opened.
    pub up_us: u64,
    /// Its content.
    #[serde(flatten)]
    pub record: AuditRecord,
}

/// The content of a record.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum AuditRecord {
    /// The log was opened.
    Start {
        /// The version of the program.
        version: String,
    },
    /// Something is about to be done.
    Begin {
        /// The entry's ID.
        id: String,
        /// Who requested it.
        who: String,
        /// From where.
        via: String,
        /// The module.
        module: String,
        /// What was requested.
        what: String,
        /// The last known state.
        #[serde(default, skip_serializing_if = "String::is_empty")]
        before: String,
    },
    /// The result.
    End {
        /// The entry's ID.
        id: String,
        /// `readback`, `reply`, `sent`, the name of the error, or `unknown`.
        end: String,
        /// The state known after it.
        #[serde(default, skip_serializing_if = "String::is_empty")]
        after: String,
    },
    /// The program shut down properly.
    Stop,
    /// Some records before this one could not be written.
    Lost {
        /// How many.
        records: u64,
    },
    /// When it was opened, the log ended earlier than it once had: records were removed.
    Cut {
        /// The number of the last one.
        seq: u64,
        /// Its hash.
        hash: String,
    },
}

impl AuditRecord {
    /// The same, with overlong texts cut.
    pub(super) fn cut(mut self) -> AuditRecord {
        match &mut self {
            AuditRecord::Begin {
                who,
                via,
                module,
                what,
                before,
                ..
            } => {
                for text in [who, via, module, what, before] {
                    cut(text);
                }
            }
            AuditRecord::End { end, after, .. } => {
                cut(end);
                cut(after);
            }
            AuditRecord::Start { .. }
            | AuditRecord::Stop
            | AuditRecord::Lost { .. }
            | AuditRecord::Cut { .. } => {}
        }
        self
    }
}

fn cut(text: &mut String) {
    let end = text.floor_char_boundary(TEXT_MAX);
    text.truncate(end);
}

/// Appends the line of a record; returns its hash.
pub(super) fn encode(into: &mut String, before: &str, numbered: &Numbered) -> String {
    // A record consists of texts and numbers and can always be serialised.
    let json = serde_json::to_string(numbered).unwrap_or_default();
    let hash = hash(before, &json);
    // Writing into a String does not fail.
    let _ = writeln!(into, "{hash} {json}");
    hash
}

/// The record of a line without its newline, and its hash, which is not checked.
pub(super) fn decode(line: &[u8]) -> Option<(&str, Numbered)> {
    let line = std::str::from_utf8(line).ok()?;
    let (hash, json) = line.split_once(' ')?;
    (hash.len() == HASH_LEN).then_some((hash, serde_json::from_str(json).ok()?))
}

/// The record of a line that follows a record with this hash; `None` if it does not.
pub(super) fn follows<'l>(before: &str, line: &'l [u8]) -> Option<(&'l str, Numbered)> {
    let (told, numbered) = decode(line)?;
    let json = std::str::from_utf8(line.get(HASH_LEN + 1..)?).ok()?;
    (told == hash(before, json)).then_some((told, numbered))
}

fn hash(before: &str, json: &str) -> String {
    let digest = Sha256::new()
        .chain_update(before)
        .chain_update(json)
        .finalize();
    let mut text = String::with_capacity(HASH_LEN);
    for byte in digest {
        let _ = write!(text, "{byte:02x}");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_read_as_it_was_written() {
        let numbered = Numbered {
            seq: 7,
            at_ms: 1,
            up_us: 2,
            record: AuditRecord::Lost { records: 3 },
        };
        let mut text = String::new();
        let hash = encode(&mut text, NOTHING, &numbered);
        let line = text.trim_end().as_bytes();
        assert_eq!(follows(NOTHING, line), Some((hash.as_str(), numbered)));
        assert_eq!(follows(&hash, line), None, "it follows upon another one");
        assert!(
            text.ends_with("\"kind\":\"lost\",\"records\":3}\n"),
            "{text}"
        );
    }

    #[test]
    fn no_text_is_too_long() {
        let long = "总".repeat(TEXT_MAX);
        let record = AuditRecord::End {
            id: String::new(),
            end: long.clone(),
            after: long,
        };
        let numbered = Numbered {
            seq: 1,
            at_ms: 0,
            up_us: 0,
            record: record.cut(),
        };
        let mut text = String::new();
        encode(&mut text, NOTHING, &numbered);
        assert!(text.len() < LINE_MAX, "{}", text.len());
    }
}

//! The committed counts and limits, `codec-limits.toml`.
//!
//! One line per job, `name = { last = 321, most = 400 }`, is all the TOML that is parsed here.

use std::fmt::Write;
use std::path::PathBuf;

/// How much above its last count a job may be before the check fails, in percent.
const TOLERANCE: u64 = 5;

/// The limits of one job.
#[derive(Clone)]
pub struct Limit {
    name: String,
    /// The count at the last update.
    pub last: u64,
    /// The count that must never be exceeded.
    pub most: u64,
}

impl Limit {
    /// What is wrong with this count.
    pub fn complaint(&self, name: &str, count: u64) -> Option<String> {
        if count > self.most {
            return Some(format!(
                "{name}: {count} instructions, the limit is {}",
                self.most
            ));
        }
        let tolerated = self.last + self.last * TOLERANCE / 100;
        (count > tolerated).then(|| {
            format!(
                "{name}: {count} instructions, {} before; if that is worth it, run with --update",
                self.last
            )
        })
    }
}

/// The limits of all jobs.
pub struct Limits {
    comment: String,
    limits: Vec<Limit>,
}

impl Limits {
    fn path() -> PathBuf {
        PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("codec-limits.toml")
    }

    /// Reads the file.
    pub fn read() -> Result<Limits, String> {
        let path = Limits::path();
        let text = std::fs::read_to_string(&path)
            .map_err(|why| format!("{} cannot be read: {why}", path.display()))?;
        let mut comment = String::new();
        let mut limits = Vec::new();
        for line in text.lines() {
            if line.is_empty() || line.starts_with('#') {
                let _ = writeln!(comment, "{line}");
                continue;
            }
            limits.push(parse(line).ok_or_else(|| format!("`{line}` is no limit"))?);
        }
        Ok(Limits { comment, limits })
    }

    /// The limit of a job; a job without one is an error.
    pub fn of(&self, name: &str) -> Result<Limit, String> {
        let found = self.limits.iter().find(|limit| limit.name == name);
        found
            .cloned()
            .ok_or_else(|| format!("codec-limits.toml has no line for {name}"))
    }

    /// Stores a new count as the last one.
    pub fn note(&mut self, name: &str, count: u64) {
        for limit in &mut self.limits {
            if limit.name == name {
                limit.last = count;
            }
        }
    }

    /// Writes the file.
    pub fn write(&self) -> Result<(), String> {
        let mut text = self.comment.clone();
        for Limit { name, last, most } in &self.limits {
            let _ = writeln!(text, "{name} = {{ last = {last}, most = {most} }}");
        }
        std::fs::write(Limits::path(), text).map_err(|why| why.to_string())
    }
}

fn parse(line: &str) -> Option<Limit> {
    let (name, table) = line.split_once('=')?;
    let table = table.trim().strip_prefix('{')?.strip_suffix('}')?;
    let number = |key: &str| {
        table.split(',').find_map(|pair| {
            let (found, value) = pair.split_once('=')?;
            (found.trim() == key).then(|| value.trim().parse().ok())?
        })
    };
    Some(Limit {
        name: name.trim().to_owned(),
        last: number("last")?,
        most: number("most")?,
    })
}

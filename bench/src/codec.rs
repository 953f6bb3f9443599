//! Instruction counts of the codec, and the check that they do not grow.

use crate::limits::Limits;
use crate::table::Table;
use crate::{count, jobs};

/// What to do with the counts.
#[derive(PartialEq)]
pub enum After {
    /// Only print them.
    Nothing,
    /// Fail if a count exceeds its limit.
    Check,
    /// Store them.
    Update,
}

/// Counts every job and its floor.
pub fn table(after: After) -> Result<Table, String> {
    let mut limits = Limits::read()?;
    let mut complaints = Vec::new();
    let mut table = Table::new(&["job", "floor", "railbus", "ratio", "before", "limit"]);
    for job in jobs::JOBS {
        let ours = count::per_iteration(job.name)?;
        let limit = limits.of(job.name)?;
        let (before, most) = (limit.last.to_string(), limit.most.to_string());
        let (floor, ratio) = match after {
            // The floor is printed for comparison only.
            After::Check => (String::new(), String::new()),
            After::Nothing | After::Update => {
                let floor = count::per_iteration(&format!("{}-floor", job.name))?;
                (
                    floor.to_string(),
                    format!("{:.2}", ours as f64 / floor as f64),
                )
            }
        };
        table.row(&[job.name, &floor, &ours.to_string(), &ratio, &before, &most]);
        complaints.extend(limit.complaint(job.name, ours));
        limits.note(job.name, ours);
    }
    if after == After::Update {
        limits.write()?;
    }
    if after == After::Check && !complaints.is_empty() {
        return Err(complaints.join("\n"));
    }
    Ok(table)
}

/// The child process that callgrind measures.
pub fn one(name: &str, times: &str) -> Result<(), String> {
    let times: u32 = times
        .parse()
        .map_err(|_| format!("`{times}` is no number"))?;
    let (job, is_floor) = match name.strip_suffix("-floor") {
        Some(name) => (name, true),
        None => (name, false),
    };
    let job = jobs::JOBS
        .iter()
        .find(|known| known.name == job)
        .ok_or_else(|| format!("there is no job `{job}`"))?;
    job.repeat(is_floor, times)
}

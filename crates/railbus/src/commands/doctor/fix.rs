//! Fixes: the exact commands are shown, and only run after a yes.

use super::texts::DoctorText;
use crate::commands::Context;
use railbus_app::doctor::{CheckState, Finding};
use railbus_app::failure::Failure;
use railbus_app::render::out;
use railbus_words::Code;
use std::io::{BufRead, IsTerminal, Write};
use std::process::{Command, Stdio};

pub(super) fn run(context: &Context, found: &[Finding], yes: bool) -> Result<(), Failure> {
    let lang = context.lang;
    let bad = found
        .iter()
        .filter(|finding| finding.state != CheckState::Ok);
    let commands: Vec<&String> = bad.flat_map(|finding| &finding.fix).collect();
    if commands.is_empty() {
        context.note(lang.get(DoctorText::NothingToFix));
        return Ok(());
    }
    out::note(lang.get(DoctorText::WouldRun));
    for command in &commands {
        out::note(&format!("  {command}"));
    }
    if !yes && !agreed(context)? {
        out::note(lang.get(DoctorText::NothingRun));
        return Ok(());
    }
    for command in commands {
        run_one(context, command)?;
    }
    Ok(())
}

/// Asks at the terminal; no if there is none.
fn agreed(context: &Context) -> Result<bool, Failure> {
    let lang = context.lang;
    let stdin = std::io::stdin();
    if !stdin.is_terminal() {
        let message = lang.get(DoctorText::NobodyToAsk).to_owned();
        return Err(Failure::new(Code::NeedsYes, message).with_try("railbus doctor --fix --yes"));
    }
    // If stderr is closed, the user does not see the question either.
    let _ = write!(std::io::stderr(), "{} ", lang.get(DoctorText::Ask));
    let mut answer = String::new();
    let read = stdin.lock().read_line(&mut answer);
    read.map_err(|error| Failure::of(lang, Code::System).because(error))?;
    Ok(["y", "yes", "是"].contains(&answer.trim().to_lowercase().as_str()))
}

/// The command's output goes to stderr: stdout is for the findings.
fn run_one(context: &Context, command: &str) -> Result<(), Failure> {
    let lang = context.lang;
    let failed = |why: String| {
        let failure = Failure::of(lang, Code::FixFailed)
            .because(command)
            .because(why);
        failure.with_fact("command", command)
    };
    let output = Command::new("sh")
        .args(["-c", command])
        .stdin(Stdio::inherit())
        .stderr(Stdio::inherit())
        .output()
        .map_err(|error| failed(error.to_string()))?;
    if !output.status.success() {
        return Err(failed(output.status.to_string()));
    }
    context.note(&lang.fill(DoctorText::Done, &[("command", &command)]));
    Ok(())
}

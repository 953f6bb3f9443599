//! The lines and modules of a daemon, as it reports them: no other program can open them.

use super::chosen::no_line;
use crate::backend::Backend;
use crate::commands::Context;
use railbus_api::types::{ModuleInfo, ModuleState};
use railbus_app::doctor::{Finding, Section, told};
use railbus_app::failure::Failure;

/// The findings about the daemon's lines and modules.
///
/// # Errors
/// If there is no line of that name.
pub(super) async fn examine(context: &Context, backend: &Backend) -> Result<Vec<Finding>, Failure> {
    let (lines, mut modules) = (backend.lines().await, backend.modules().await);
    // Modules that were never read are read before they are reported.
    let is_new = |module: &&ModuleInfo| module.state == ModuleState::Unheard;
    let new = modules.iter().flatten().filter(is_new);
    let new: Vec<String> = new.map(|module| module.module.clone()).collect();
    if !new.is_empty() {
        // The result shows in the state of the modules.
        let _ = backend.points(&new, true).await;
        modules = backend.modules().await;
    }
    let points = backend.points(&[], false).await;
    let (lines, modules, points) = match (lines, modules, points) {
        (Ok(lines), Ok(modules), Ok(points)) => (lines, modules, points),
        (Err(why), ..) | (_, Err(why), _) | (.., Err(why)) => {
            let why = context.failure(&why);
            let detail = format!("{} {}", why.code().name(), why.message());
            return Ok(vec![Finding::error(Section::Daemon, "D504", detail)]);
        }
    };
    if let Some(wanted) = context.line.as_ref()
        && !lines.iter().any(|line| line.line == *wanted)
    {
        let known = lines.iter().map(|line| &line.line);
        return Err(no_line(context, wanted, known));
    }
    let wanted = |line: &str| context.line.as_deref().is_none_or(|wanted| wanted == line);
    let lines = lines.into_iter().filter(|line| wanted(&line.line));
    let modules = modules.into_iter().filter(|module| wanted(&module.line));
    Ok(told(context.lang, lines.collect(), modules, &points))
}

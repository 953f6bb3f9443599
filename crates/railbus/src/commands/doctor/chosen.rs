//! Which lines are checked.

use crate::commands::Context;
use railbus_app::doctor::line::Chosen;
use railbus_app::failure::Failure;
use railbus_host::Module;
use railbus_site::Config;
use railbus_words::Code;

/// The lines of a configuration, or the one that `-l` names.
///
/// # Errors
/// If there is no line of that name.
pub(super) fn chosen(context: &Context, config: &Config) -> Result<Vec<Chosen>, Failure> {
    if let Some(wanted) = context
        .line
        .as_ref()
        .filter(|name| !config.lines.contains_key(*name))
    {
        return Err(no_line(context, wanted, config.lines.keys()));
    }
    let wanted = |name: &String| context.line.as_ref().is_none_or(|line| line == name);
    let lines = config.lines.iter().filter(|(name, _)| wanted(name));
    let chosen = lines.filter_map(|(name, line)| {
        let modules = config.modules_of(name).filter_map(|(name, about)| {
            let module = Module::new(about.setup).ok()?;
            Some((name.clone(), module, about.plan_where(false)))
        });
        Some(Chosen {
            name: name.clone(),
            port: line.port.parse().ok()?,
            settings: line.serial,
            modules: modules.collect(),
            bus: railbus_host::Config {
                echo: line.echo,
                ..Default::default()
            },
        })
    });
    Ok(chosen.collect())
}

/// The failure for a line that does not exist.
pub(super) fn no_line<'n>(
    context: &Context,
    wanted: &str,
    known: impl Iterator<Item = &'n String>,
) -> Failure {
    let failure = Failure::of(context.lang, Code::NoLine).because(wanted);
    known.fold(failure, |failure, name| {
        failure.with_try(format!("-l {name}"))
    })
}

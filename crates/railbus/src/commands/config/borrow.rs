//! Exclusive access to a line of the daemon.

use super::texts::ConfigText;
use crate::backend::{Borrowed, DaemonClient};
use crate::commands::Context;
use railbus_app::config_file::{self, ConfigOrigin};
use railbus_app::failure::Failure;
use railbus_host::LineName;

/// Borrows the line of a port from the daemon that has it. None if no daemon has it, or if none is
/// to be used.
pub(super) async fn borrow(
    context: &Context,
    port: &LineName,
) -> Result<Option<Borrowed>, Failure> {
    if context.options.direct {
        return Ok(None);
    }
    let options = &context.options;
    let daemons = match &options.socket {
        Some(socket) => vec![DaemonClient::at(socket).await],
        None => DaemonClient::usual().await,
    };
    // A port named by flags is borrowed whichever site it belongs to; a file only from the daemon
    // of its site.
    let is_port = options.ad_hoc.is_some();
    let file = config_file::chosen(options.config.as_deref()).ok();
    let file = file.filter(|(_, why)| !is_port && *why != ConfigOrigin::Place);
    let mut failed = None;
    for daemon in daemons {
        match daemon {
            Ok(daemon) if file.as_ref().is_some_and(|(file, _)| !daemon.serves(file)) => {}
            Ok(daemon) => {
                if let Some(borrowed) = borrow_of(context, &daemon, port).await? {
                    return Ok(Some(borrowed));
                }
            }
            // If that daemon has the port, opening the port will fail and say so.
            Err(_) if (is_port || file.is_some()) && options.socket.is_none() => {}
            Err(problem) => failed = failed.or(Some(problem)),
        }
    }
    match failed {
        Some(problem) => Err(context.failure(&problem)),
        None => Ok(None),
    }
}

/// Borrows the line from this daemon.
async fn borrow_of(
    context: &Context,
    daemon: &DaemonClient,
    port: &LineName,
) -> Result<Option<Borrowed>, Failure> {
    let failed = |problem| context.failure(&problem);
    let lines = daemon.lines().await.map_err(failed)?;
    let is_ours = |theirs: &str| {
        theirs
            .parse::<LineName>()
            .is_ok_and(|theirs| same(&theirs, port))
    };
    let Some(line) = lines.iter().find(|line| is_ours(&line.port)) else {
        return Ok(None);
    };
    let borrowed = daemon.borrow(&line.line).await.map_err(failed)?;
    context.has_borrowed(daemon, &line.line);
    context.note(
        &context
            .lang
            .fill(ConfigText::Borrowed, &[("line", &line.line)]),
    );
    Ok(Some(borrowed))
}

/// Whether two names are of the same port: a path may be a link.
fn same(a: &LineName, b: &LineName) -> bool {
    let path = |name: &LineName| match name {
        LineName::Serial(path) | LineName::Pty(path) => std::fs::canonicalize(path).ok(),
        LineName::Tcp { .. } | LineName::ModbusTcp { .. } => None,
    };
    a == b || path(a).is_some_and(|a| path(b) == Some(a))
}

//! The line, for commands that need no module on it.

use super::Context;
use crate::backend::{AdHoc, Backend};
use railbus_api::types::LineInfo;
use railbus_app::api::failures::right_to;
use railbus_app::failure::Failure;
use railbus_host::{EchoMode, LineName, PortError};
use railbus_wire::{Baud, Character, SerialSettings};
use railbus_words::Code;

/// A line, for opening it.
#[derive(Clone, Debug)]
pub(super) struct Place {
    pub(super) line: String,
    pub(super) port: LineName,
    pub(super) settings: SerialSettings,
    pub(super) echo: EchoMode,
}

/// Who has the line.
pub(super) enum Access {
    /// It is free: it can be opened here.
    Here(Place),
    /// The daemon.
    Daemon(Backend),
}

/// The line that the flags mean, or the only one.
pub(super) async fn find(context: &Context) -> Result<Access, Failure> {
    if let Some(ad_hoc) = &context.options.ad_hoc {
        return described(context, ad_hoc).map(Access::Here);
    }
    if context.daemon().await?.is_some() {
        return context.open().await.map(Access::Daemon);
    }
    without_opening(context).map(Access::Here)
}

/// The line that the flags alone describe.
fn described(context: &Context, ad_hoc: &AdHoc) -> Result<Place, Failure> {
    let baud = ad_hoc.baud.and_then(Baud::from_rate);
    Ok(Place {
        line: ad_hoc.port.clone(),
        port: name(context, &ad_hoc.port)?,
        settings: SerialSettings {
            baud: baud.unwrap_or(Baud::B9600),
            character: ad_hoc.format.unwrap_or_default(),
        },
        echo: EchoMode::Auto,
    })
}

/// The line that the flags or the configuration mean, without opening it: a command that only
/// listens must not raise a control line of the port, let alone send.
pub(super) fn without_opening(context: &Context) -> Result<Place, Failure> {
    if let Some(ad_hoc) = &context.options.ad_hoc {
        return described(context, ad_hoc);
    }
    let found = railbus_app::config_file::read(context.lang, context.options.config.as_deref());
    let found = found.map_err(|problem| context.failure(&problem))?;
    let lines = found.config.lines;
    let wanted = context.line.as_deref();
    let only = (lines.len() == 1 && wanted.is_none()).then(|| lines.iter().next());
    let line = only.flatten().or_else(|| lines.get_key_value(wanted?));
    let Some((line, config)) = line else {
        let failure = Failure::of(context.lang, Code::NoLine).because(wanted.unwrap_or("-l"));
        let known = lines.keys().map(|line| format!("-l {line}"));
        return Err(known.fold(failure, Failure::with_try));
    };
    Ok(Place {
        line: line.clone(),
        port: name(context, &config.port)?,
        settings: config.serial,
        echo: config.echo,
    })
}

/// The lines of the configuration and their ports; none if there is no configuration.
pub(super) fn configured(context: &Context) -> Vec<(String, String)> {
    let found = railbus_app::config_file::read(context.lang, context.options.config.as_deref());
    let lines = found.map(|found| found.config.lines).unwrap_or_default();
    lines
        .into_iter()
        .map(|(name, line)| (name, line.port))
        .collect()
}

/// The line of `-l`, or the only one, of those that the backend has.
pub(super) async fn of(context: &Context, backend: &Backend) -> Result<Place, Failure> {
    let lines = backend.lines().await;
    let line = choose(context, lines.map_err(|problem| context.failure(&problem))?)?;
    Ok(Place {
        port: name(context, &line.port)?,
        settings: settings(Some(line.baud), Some(&line.format), SerialSettings::FACTORY),
        echo: EchoMode::Auto,
        line: line.line,
    })
}

/// The line of `-l`, or the only one.
fn choose(context: &Context, lines: Vec<LineInfo>) -> Result<LineInfo, Failure> {
    let known: Vec<String> = lines
        .iter()
        .map(|line| format!("-l {}", line.line))
        .collect();
    let only = lines.len() == 1 && context.line.is_none();
    let wanted = context.line.as_deref();
    let mut fits = lines
        .into_iter()
        .filter(|line| only || wanted == Some(&line.line));
    fits.next().ok_or_else(|| {
        let failure = Failure::of(context.lang, Code::NoLine).because(wanted.unwrap_or("-l"));
        known.into_iter().fold(failure, Failure::with_try)
    })
}

fn name(context: &Context, port: &str) -> Result<LineName, Failure> {
    port.parse().map_err(|error| {
        let failure = Failure::of(context.lang, Code::NoLine);
        failure
            .because(format!("{port}: {error}"))
            .with_fact("port", port)
    })
}

/// Baud rate and format as the API reports them; those that it does not report are taken from
/// `own`.
pub(super) fn settings(
    baud: Option<u32>,
    format: Option<&str>,
    own: SerialSettings,
) -> SerialSettings {
    SerialSettings {
        baud: baud.and_then(Baud::from_rate).unwrap_or(own.baud),
        character: format
            .and_then(Character::from_name)
            .unwrap_or(own.character),
    }
}

/// Why a port can't be opened.
pub(super) fn port_failure(context: &Context, place: &Place, error: &PortError) -> Failure {
    let lang = context.lang;
    let code = match error {
        PortError::Missing => Code::PortMissing,
        PortError::Busy { .. } | PortError::Exclusive => Code::PortBusy,
        PortError::Permission(_) => Code::PortDenied,
        PortError::NotATty => Code::NotATty,
        PortError::Refused | PortError::Unreachable => Code::PortUnreachable,
        PortError::Gone | PortError::Stuck | PortError::Garbled | PortError::Io(_) => {
            Code::LineClosed
        }
    };
    let port = place.port.to_string();
    let title = code.page().title(lang);
    let message = lang.fill(
        railbus_app::texts::AppText::Named,
        &[("title", &title), ("name", &port)],
    );
    let failure = Failure::new(code, message)
        .diagnosed()
        .with_fact("line", place.line.as_str())
        .with_fact("port", port)
        .with_fact("reason", error.name());
    match error {
        PortError::Busy {
            holder: Some(holder),
        } => {
            let holder = format!("{} ({})", holder.name, holder.pid);
            let told = lang.fill(railbus_app::texts::AppText::HeldBy, &[("holder", &holder)]);
            failure.because(told).with_fact("holder", holder)
        }
        PortError::Permission(access) => {
            let hint = right_to(&place.port.to_string(), access);
            let failure = failure.with_try(hint);
            match &access.group_name {
                Some(group) => {
                    let told = lang.fill(railbus_app::texts::AppText::OfGroup, &[("group", group)]);
                    failure.because(told).with_fact("group", group.as_str())
                }
                None => failure,
            }
        }
        PortError::Io(number) => failure.because(std::io::Error::from_raw_os_error(*number)),
        _ => failure,
    }
}

//! `railbus sniff`: shows the traffic of a line, listening only.

mod auto;
mod filter;
mod record;
pub(super) mod show;
mod source;
mod texts;

use super::place::{self, Place};
use super::{Context, stop, wireshark};
use crate::args;
use crate::backend::DaemonClient;
use clap::{Arg, ArgAction, ArgMatches, Command, value_parser};
use filter::Filter;
use railbus_api::problem::Problem;
use railbus_app::failure::Failure;
pub(super) use railbus_app::frames::meaning::request;
pub(super) use railbus_app::frames::words::{millis, of as told};
use railbus_app::frames::{Facts, Named};
use railbus_app::render::{Format, out};
use railbus_host::{LineName, PIECE_PAUSE};
use railbus_sniff::{Input, Listener, Output, SniffEvent};
use railbus_wire::{Instant, Micros, SerialSettings};
use railbus_words::Code;
use railbus_words::Lang;
use record::Recorder;
use show::Sums;
pub(super) use source::{Capture, Clock, Received, Wire, received};
use source::{Listening, Source};
use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
pub(super) use texts::SniffText;

/// How long a serial server may hold back bytes inside a frame.
const NETWORK_SILENCE: Micros = Micros::from_millis(100);

/// The name of the command.
pub(crate) const NAME: &str = "sniff";

/// Its parser and help.
pub(crate) fn define(lang: Lang) -> Command {
    let usage = "railbus sniff [--auto-baud] [--filter WORDS] [--write FILE] [--read FILE]";
    let file = |name, help| {
        args::flag(lang, name, help)
            .value_name("FILE")
            .value_parser(value_parser!(PathBuf))
    };
    args::verb(lang, NAME, SniffText::SniffAbout, usage)
        .alias("monitor")
        .before_help(args::examples(lang, SniffText::SniffExamples))
        .arg(args::flag(lang, "auto-baud", SniffText::AutoBaud).action(ArgAction::SetTrue))
        .arg(filter_flag(lang))
        .arg(file("write", SniffText::Write).short('w'))
        .arg(file("read", SniffText::Read).conflicts_with("auto-baud"))
        .arg(
            args::flag(lang, "count", SniffText::Count)
                .value_name("N")
                .value_parser(value_parser!(u64).range(1..)),
        )
        .arg(
            args::flag(lang, "time", SniffText::Time)
                .value_name("TIME")
                .value_parser(super::context::duration),
        )
        .arg(args::flag(lang, "install-wireshark", SniffText::Install).action(ArgAction::SetTrue))
        .arg(
            args::flag(lang, "dir", SniffText::Folder)
                .value_name("DIR")
                .value_parser(value_parser!(PathBuf))
                .requires("install-wireshark"),
        )
        .arg(
            args::flag(lang, "dry-run", SniffText::DryRun)
                .short('n')
                .action(ArgAction::SetTrue)
                .requires("install-wireshark"),
        )
}

/// The flag that takes a filter.
pub(super) fn filter_flag(lang: Lang) -> Arg {
    args::flag(lang, "filter", SniffText::FilterFlag).value_name("WORDS")
}

/// The filter of the flag.
pub(super) fn filter_of(lang: Lang, matches: &ArgMatches) -> Result<Option<Filter>, Failure> {
    let text = matches.get_one::<String>("filter");
    text.map(|text| Filter::parse(text))
        .transpose()
        .map_err(|wrong| Failure::new(Code::BadFilter, wrong.told(lang)).diagnosed())
}

/// Listens until it is stopped, or has heard as much as was asked for.
pub(crate) fn run(lang: Lang, matches: &ArgMatches) -> Result<(), Failure> {
    let context = Context::of(lang, matches)?;
    if matches.get_flag("install-wireshark") {
        let folder = matches.get_one::<PathBuf>("dir").map(PathBuf::as_path);
        return wireshark::install(&context, folder, matches.get_flag("dry-run"));
    }
    let filter = filter_of(lang, matches)?;
    let recorder = matches.get_one::<PathBuf>("write");
    let recorder = recorder
        .map(|path| Recorder::create(&context, path))
        .transpose()?;
    let mut hearing = Hearing {
        filter,
        left: matches.get_one::<u64>("count").copied(),
        ..Hearing::new(&context, recorder)
    };
    let end = match matches.get_one::<PathBuf>("read") {
        Some(path) => hearing.read(path),
        None => {
            let auto = matches.get_flag("auto-baud");
            let time = matches.get_one::<Micros>("time").copied();
            context.block(hearing.listen(auto, time))
        }
    };
    if context.format == Format::Table && !hearing.sums.is_empty() {
        context.note(&hearing.sums.told(lang));
    }
    end
}

/// Decodes a capture file: what `--read` shows, without the totals.
pub(super) fn of_file(
    context: &Context,
    path: &Path,
    filter: Option<Filter>,
) -> Result<(), Failure> {
    let mut hearing = Hearing {
        filter,
        ..Hearing::new(context, None)
    };
    hearing.read(path)
}

/// Listens and writes into a pipe, until its reader closes it.
pub(super) fn to_pipe(context: &Context, pipe: &Path) -> Result<(), Failure> {
    let recorder = Recorder::pipe(context, pipe)?;
    let mut hearing = Hearing {
        shows: false,
        ..Hearing::new(context, Some(recorder))
    };
    match context.block(hearing.listen(false, None)) {
        Err(failure) if matches!(failure.code(), Code::Interrupted | Code::CaptureWrite) => Ok(()),
        end => end,
    }
}

/// What is done with the traffic.
struct Hearing<'a> {
    context: &'a Context,
    filter: Option<Filter>,
    recorder: Option<Recorder>,
    modules: Vec<Named>,
    sums: Sums,
    /// How many more frames are shown.
    left: Option<u64>,
    /// The numbers that lines have in the file that is written.
    kept: BTreeMap<String, u32>,
    /// Traffic is shown, not only recorded.
    shows: bool,
}

impl<'a> Hearing<'a> {
    fn new(context: &'a Context, recorder: Option<Recorder>) -> Hearing<'a> {
        Hearing {
            context,
            filter: None,
            recorder,
            modules: Vec::new(),
            sums: Sums::default(),
            left: None,
            kept: BTreeMap::new(),
            shows: true,
        }
    }

    /// From a file, which may hold several lines.
    fn read(&mut self, path: &Path) -> Result<(), Failure> {
        let mut capture = Capture::open(self.context, path)?;
        self.modules = modules(self.context, None);
        self.head()?;
        let mut lines: BTreeMap<usize, ListenedLine> = BTreeMap::new();
        while let Some((line, received)) = capture.next(self.context)? {
            let listened = lines.entry(line).or_insert_with(|| {
                let wire = capture.wire(line);
                ListenedLine::new(wire.name, wire.settings, self.context.timeout)
            });
            if self.take(listened, received)?.is_break() {
                return Ok(());
            }
        }
        for listened in lines.values_mut() {
            loop {
                match self.drain(listened)? {
                    ControlFlow::Break(()) => return Ok(()),
                    ControlFlow::Continue(None) => break,
                    ControlFlow::Continue(Some(due)) => {
                        listened.listener.handle(due, Input::Timeout)
                    }
                }
            }
        }
        if capture.skipped > 0 {
            let values: &[(&str, &dyn std::fmt::Display)] = &[("count", &capture.skipped)];
            self.context
                .note(&self.context.lang.fill(SniffText::Skipped, values));
        }
        Ok(())
    }

    /// Listens to a line.
    async fn listen(&mut self, auto: bool, time: Option<Micros>) -> Result<(), Failure> {
        let context = self.context;
        let mut stop = stop::Stop::new(context)?;
        let (mut source, mut listened) = match context.daemon().await? {
            Some(daemon) => self.at_daemon(&daemon).await?,
            None => self.at_port(auto, &mut stop).await?,
        };
        self.head()?;
        let clock = Clock::new();
        let end = time.map(|time| clock.now() + time);
        loop {
            let due = match self.drain(&mut listened)? {
                ControlFlow::Break(()) => return Ok(()),
                ControlFlow::Continue(due) => due,
            };
            let due = due
                .unwrap_or(Instant(u64::MAX))
                .min(end.unwrap_or(Instant(u64::MAX)));
            // What has arrived goes first: it decides what a deadline means.
            let received = tokio::select! {
                biased;
                () = stop.requested() => {
                    self.finish(&mut listened, clock.now())?;
                    return Err(stop::interrupted(context));
                }
                received = source.next(context, clock) => match received? {
                    Some(received) => Some(received),
                    None => return self.finish(&mut listened, clock.now()),
                },
                () = tokio::time::sleep(clock.until(due)) => None,
            };
            match received {
                Some(received) => {
                    if self.take(&mut listened, received)?.is_break() {
                        return Ok(());
                    }
                }
                None => listened.listener.handle(clock.now(), Input::Timeout),
            }
            if end.is_some_and(|end| clock.now() >= end) {
                return self.finish(&mut listened, clock.now());
            }
        }
    }

    /// The daemon has the line: what it sees of it is shown.
    async fn at_daemon(
        &mut self,
        daemon: &DaemonClient,
    ) -> Result<(Source, ListenedLine), Failure> {
        let context = self.context;
        let failed = |problem: Problem| context.failure(&problem);
        let frames = daemon.frames(context.line.as_deref()).await;
        let mut frames = frames.map_err(failed)?;
        let wire = source::line_of(context, &mut frames).await?;
        let modules = daemon.modules().await.map_err(failed)?;
        let named = modules
            .into_iter()
            .filter(|module| module.line == wire.name);
        self.modules = named.filter_map(Named::of).collect();
        let values: &[(&str, &dyn std::fmt::Display)] = &[("line", &wire.name)];
        context.note(&context.lang.fill(SniffText::ListeningDaemon, values));
        let listened = ListenedLine::own(wire.name, wire.settings, context.timeout);
        Ok((Source::Daemon(frames), listened))
    }

    /// The line is free: the port is opened for listening.
    async fn at_port(
        &mut self,
        auto: bool,
        stop: &mut stop::Stop,
    ) -> Result<(Source, ListenedLine), Failure> {
        let context = self.context;
        let mut place = place::without_opening(context)?;
        if auto {
            place.settings = auto::find(context, &place, stop).await?;
        }
        self.modules = modules(context, Some(&place));
        let port = Listening::open(context, &place).await?;
        let values: &[(&str, &dyn std::fmt::Display)] =
            &[("port", &place.port), ("settings", &place.settings)];
        context.note(&context.lang.fill(SniffText::Listening, values));
        let mut listened = ListenedLine::new(place.line, place.settings, context.timeout);
        if let LineName::Tcp { .. } = place.port {
            listened.listener = listened.listener.with_silence(NETWORK_SILENCE);
        }
        Ok((Source::Port(Box::new(port)), listened))
    }

    /// Reports what is left at the end.
    fn finish(&mut self, listened: &mut ListenedLine, now: Instant) -> Result<(), Failure> {
        listened.listener.handle(now, Input::Silence);
        self.drain(listened).map(|_| ())
    }

    fn head(&self) -> Result<(), Failure> {
        if !self.shows {
            return Ok(());
        }
        out::result(
            self.context.lang,
            &show::head(self.context.lang, self.context.format),
        )
    }

    /// Passes what arrived to a line's listener, after every timeout that was due before it.
    fn take(
        &mut self,
        listened: &mut ListenedLine,
        received: Received,
    ) -> Result<ControlFlow<()>, Failure> {
        let (at, bytes) = match &received {
            Received::Bytes(at, bytes) | Received::Sent(at, bytes) | Received::Whole(at, bytes) => {
                (at, bytes)
            }
            Received::Lost(count) => {
                let values: &[(&str, &dyn std::fmt::Display)] = &[("count", count)];
                self.context
                    .note(&self.context.lang.fill(SniffText::Dropped, values));
                return Ok(ControlFlow::Continue(()));
            }
        };
        let begins = Instant(at.0.saturating_sub(listened.settings.frame_time(bytes.len()).0));
        loop {
            match self.drain(listened)? {
                ControlFlow::Break(()) => return Ok(ControlFlow::Break(())),
                ControlFlow::Continue(Some(due)) if due <= begins => {
                    listened.listener.handle(due, Input::Timeout);
                }
                ControlFlow::Continue(_) => break,
            }
        }
        match &received {
            Received::Sent(..) => listened.listener.handle(*at, Input::Sent(bytes)),
            Received::Bytes(..) => listened.listener.handle(*at, Input::Bytes(bytes)),
            Received::Whole(..) | Received::Lost(_) => {
                listened.listener.handle(*at, Input::Bytes(bytes));
                listened.listener.handle(*at, Input::Silence);
            }
        }
        Ok(match self.drain(listened)? {
            ControlFlow::Break(()) => ControlFlow::Break(()),
            ControlFlow::Continue(_) => ControlFlow::Continue(()),
        })
    }

    /// Shows what a line's listener reports. Continues with the next deadline.
    fn drain(
        &mut self,
        listened: &mut ListenedLine,
    ) -> Result<ControlFlow<(), Option<Instant>>, Failure> {
        loop {
            match listened.listener.poll() {
                Output::Wait(due) => return Ok(ControlFlow::Continue(due)),
                Output::Heard(heard) => {
                    if self.show(listened, &heard)?.is_break() {
                        return Ok(ControlFlow::Break(()));
                    }
                }
            }
        }
    }

    fn show(
        &mut self,
        listened: &ListenedLine,
        heard: &SniffEvent,
    ) -> Result<ControlFlow<()>, Failure> {
        let (lang, format) = (self.context.lang, self.context.format);
        self.sums.add(heard, listened.settings);
        if let Some(recorder) = &mut self.recorder {
            let line = match self.kept.get(&listened.line) {
                Some(line) => *line,
                None => recorder.line(self.context, &listened.line, listened.settings)?,
            };
            self.kept.insert(listened.line.clone(), line);
            recorder.keep(self.context, line, heard)?;
        }
        if !self.shows {
            return Ok(ControlFlow::Continue(()));
        }
        let facts = Facts::of(heard, &self.modules);
        if self
            .filter
            .as_ref()
            .is_some_and(|filter| !filter.wants(&facts))
        {
            return Ok(ControlFlow::Continue(()));
        }
        let text = show::line(lang, format, &listened.line, heard, &facts);
        if let ControlFlow::Break(()) = out::put(lang, &text)? {
            return Ok(ControlFlow::Break(()));
        }
        if let Some(left) = &mut self.left {
            *left -= 1;
            if *left == 0 {
                return Ok(ControlFlow::Break(()));
            }
        }
        Ok(ControlFlow::Continue(()))
    }
}

/// A line that is listened to.
pub(super) struct ListenedLine {
    line: String,
    settings: SerialSettings,
    pub(super) listener: Listener,
}

impl ListenedLine {
    pub(super) fn new(
        line: String,
        settings: SerialSettings,
        patience: Option<Micros>,
    ) -> ListenedLine {
        let listener = Listener::new(settings);
        ListenedLine {
            line,
            settings,
            listener: match patience {
                Some(patience) => listener.with_patience(patience),
                None => listener,
            },
        }
    }

    /// The same for a line of our own: a reply that its master receives in pieces is whole here,
    /// too.
    pub(super) fn own(
        line: String,
        settings: SerialSettings,
        patience: Option<Micros>,
    ) -> ListenedLine {
        let mut listener = ListenedLine::new(line, settings, patience);
        listener.listener = listener.listener.with_silence(PIECE_PAUSE);
        listener
    }
}

/// The modules of the configuration, if there is one: on this line, or on all.
fn modules(context: &Context, place: Option<&Place>) -> Vec<Named> {
    let named = context.options.config.as_deref();
    let Ok(found) = railbus_app::config_file::read(context.lang, named) else {
        return Vec::new();
    };
    let of_line = |line: &str| {
        let port = found.config.lines.get(line).map(|line| line.port.as_str());
        place.is_none_or(|place| place.line == line || port == Some(&place.port.to_string()))
    };
    let modules = found.config.modules.iter();
    let named = modules
        .filter(|(_, module)| of_line(&module.line))
        .map(|(name, module)| Named {
            name: name.clone(),
            protocol: module.setup.protocol,
            address: module.setup.address.0,
        });
    named.collect()
}

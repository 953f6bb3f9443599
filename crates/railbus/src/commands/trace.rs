//! `-v`: shows the traffic of the line while a command runs. With `-v` a line per exchange; with
//! `-vv` a line per frame, with its bytes and times.

use super::Context;
use super::sniff::{self, ListenedLine, Received, Wire};
use crate::backend::{Backend, Traffic};
use railbus_app::failure::Failure;
use railbus_app::frames::Facts;
use railbus_app::render::{Format, out};
use railbus_sniff::{FrameRole, FrameVerdict, Input, Output, SniffEvent};
use railbus_wire::Instant;
use railbus_words::Code;
use railbus_words::Lang;
use railbus_words::time;
use std::fs::{File, OpenOptions};
use std::io::Write;
use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};
use std::time::Duration;
use tokio::sync::watch;
use tokio::task::JoinHandle;

railbus_words::texts! {
    pub(crate) TraceText;

    LogFile { en: "What -v shows goes to this file", zh: "-v 的内容写入此文件" }
}

/// How long to wait for traffic that is still to be printed before the command ends.
const REST: Duration = Duration::from_millis(5);

/// The tasks that print the traffic of the lines.
#[derive(Debug)]
pub(super) struct Tracers {
    file: Option<PathBuf>,
    tasks: Mutex<Vec<JoinHandle<()>>>,
    stop: watch::Sender<bool>,
}

impl Tracers {
    pub(super) fn new(file: Option<PathBuf>) -> Tracers {
        Tracers {
            file,
            tasks: Mutex::new(Vec::new()),
            stop: watch::Sender::new(false),
        }
    }

    /// Traces every line from now on.
    pub(super) async fn follow(&self, context: &Context, backend: &Backend) -> Result<(), Failure> {
        for (line, traffic) in backend.traffic().await {
            let log = match &self.file {
                None => None,
                Some(path) => Some(open(path).map_err(|error| {
                    let path = path.display();
                    Failure::of(context.lang, Code::Output).because(format!("{path}: {error}"))
                })?),
            };
            let wire = Wire::of(line);
            let tracer = Tracer {
                lang: context.lang,
                bytes: context.verbose > 1,
                line: wire.name.clone(),
                listened: ListenedLine::own(wire.name, wire.settings, context.timeout),
                log,
            };
            let task = tokio::spawn(tracer.run(traffic, self.stop.subscribe()));
            lock(&self.tasks).push(task);
        }
        Ok(())
    }

    /// Lets them print what has arrived already.
    pub(super) async fn finish(&self) {
        self.stop.send_replace(true);
        let tasks = std::mem::take(&mut *lock(&self.tasks));
        for task in tasks {
            // Fails only if the task panicked.
            let _ = task.await;
        }
    }
}

fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

fn open(path: &PathBuf) -> std::io::Result<File> {
    OpenOptions::new().create(true).append(true).open(path)
}

async fn ended(stop: &mut watch::Receiver<bool>) {
    // Fails if the command is gone, which is an end, too.
    drop(stop.wait_for(|stop| *stop).await);
}

/// Prints the traffic of one line.
struct Tracer {
    lang: Lang,
    bytes: bool,
    line: String,
    listened: ListenedLine,
    log: Option<File>,
}

impl Tracer {
    async fn run(mut self, mut traffic: Traffic, mut stop: watch::Receiver<bool>) {
        loop {
            let event = tokio::select! {
                biased;
                event = traffic.next() => event,
                () = ended(&mut stop) => {
                    tokio::time::timeout(REST, traffic.next()).await.ok().flatten()
                }
            };
            let Some(event) = event else { break };
            if let Some(received) = sniff::received(event) {
                self.take(received);
            }
        }
        self.listened.listener.handle(Instant(0), Input::Silence);
        self.drain();
    }

    fn take(&mut self, received: Received) {
        match received {
            Received::Bytes(at, bytes) => self.listened.listener.handle(at, Input::Bytes(&bytes)),
            Received::Sent(at, bytes) | Received::Whole(at, bytes) => {
                self.listened.listener.handle(at, Input::Sent(&bytes));
            }
            Received::Lost(_) => {}
        }
        self.drain();
    }

    fn drain(&mut self) {
        while let Output::Heard(heard) = self.listened.listener.poll() {
            let facts = Facts::of(&heard, &[]);
            let text = match self.bytes {
                true => {
                    let format = Format::Table;
                    Some(sniff::show::line(
                        self.lang, format, &self.line, &heard, &facts,
                    ))
                }
                false => exchange(self.lang, &self.line, &heard, &facts),
            };
            if let Some(text) = text {
                self.say(text.trim_end());
            }
        }
    }

    fn say(&mut self, text: &str) {
        match &mut self.log {
            // A full disk must not stop a command in the middle of its work.
            Some(file) => drop(writeln!(file, "{text}")),
            None => out::note(text),
        }
    }
}

/// One line for a whole exchange: printed with its response, or when the timeout has passed.
fn exchange(lang: Lang, line: &str, heard: &SniffEvent, facts: &Facts<'_>) -> Option<String> {
    let (at, asked) = match heard {
        SniffEvent::Missing(missing) => (missing.at, Some(&missing.asked)),
        SniffEvent::Frame(frame) => {
            let reading = frame.readings.first();
            let request = reading.filter(|reading| reading.role == Some(FrameRole::Request));
            let asked = request.and_then(|reading| reading.request(&frame.bytes));
            if asked.is_some_and(|asked| asked.expects_reply())
                && frame.verdict == FrameVerdict::Good
            {
                return None;
            }
            (frame.at, frame.asked.as_ref())
        }
    };
    let asked = asked.and_then(|asked| asked.exchange());
    let asked = asked.map(|asked| sniff::request(lang, &asked) + " → ");
    let clock = time::clock_of(Some(&railbus_app::frames::rfc3339(at)));
    let protocol = facts
        .protocols
        .first()
        .map_or("–", |protocol| protocol.name());
    let address = facts
        .address
        .map_or("–".to_owned(), |address| address.to_string());
    let told = sniff::told(lang, heard);
    let after = facts
        .after
        .filter(|_| matches!(heard, SniffEvent::Frame(_)));
    let after =
        after.map(|after| format!("  {} {}", sniff::millis(after), lang.of(["ms", "毫秒"])));
    Some(format!(
        "{clock}  {line}  {protocol} {address}  {}{told}{}",
        asked.unwrap_or_default(),
        after.unwrap_or_default()
    ))
}

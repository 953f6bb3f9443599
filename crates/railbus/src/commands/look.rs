//! `-v`: what passes on the line while a command does its work. Once said, a line for each
//! exchange; twice, a line for each frame with its bytes and times.

use super::Context;
use super::sniff::{self, Came, Ear, Wire};
use crate::backend::{Backend, Tape};
use railbus_app::failure::Failure;
use railbus_app::frames::Facts;
use railbus_app::render::{Format, out};
use railbus_sniff::{Heard, Input, Output, Role, Verdict};
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
    pub(crate) LookText;

    LogFile { en: "What -v shows goes to this file", zh: "-v 的内容写入此文件" }
}

/// What has come already is told before the command ends, but nothing is waited for longer.
const REST: Duration = Duration::from_millis(5);

/// Those who tell what passes on the lines.
#[derive(Debug)]
pub(super) struct Lookers {
    file: Option<PathBuf>,
    tasks: Mutex<Vec<JoinHandle<()>>>,
    stop: watch::Sender<bool>,
}

impl Lookers {
    pub(super) fn new(file: Option<PathBuf>) -> Lookers {
        Lookers {
            file,
            tasks: Mutex::new(Vec::new()),
            stop: watch::Sender::new(false),
        }
    }

    /// Follows every line from now on.
    pub(super) async fn follow(&self, context: &Context, backend: &Backend) -> Result<(), Failure> {
        for (line, tape) in backend.tapes().await {
            let log = match &self.file {
                None => None,
                Some(path) => Some(open(path).map_err(|error| {
                    let path = path.display();
                    Failure::of(context.lang, Code::Output).because(format!("{path}: {error}"))
                })?),
            };
            let wire = Wire::of(line);
            let looker = Looker {
                lang: context.lang,
                bytes: context.verbose > 1,
                line: wire.name.clone(),
                ear: Ear::own(wire.name, wire.settings, context.timeout),
                log,
            };
            let task = tokio::spawn(looker.run(tape, self.stop.subscribe()));
            lock(&self.tasks).push(task);
        }
        Ok(())
    }

    /// Lets them tell what they still have.
    pub(super) async fn finish(&self) {
        self.stop.send_replace(true);
        let tasks = std::mem::take(&mut *lock(&self.tasks));
        for task in tasks {
            // Fails only where it broke down.
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
    // Fails where the command is gone, which is an end, too.
    drop(stop.wait_for(|stop| *stop).await);
}

/// Who tells what passes on one line.
struct Looker {
    lang: Lang,
    bytes: bool,
    line: String,
    ear: Ear,
    log: Option<File>,
}

impl Looker {
    async fn run(mut self, mut tape: Tape, mut stop: watch::Receiver<bool>) {
        loop {
            let event = tokio::select! {
                biased;
                event = tape.next() => event,
                () = ended(&mut stop) => {
                    tokio::time::timeout(REST, tape.next()).await.ok().flatten()
                }
            };
            let Some(event) = event else { break };
            if let Some(came) = sniff::came(event) {
                self.take(came);
            }
        }
        self.ear.listener.handle(Instant(0), Input::Silence);
        self.drain();
    }

    fn take(&mut self, came: Came) {
        match came {
            Came::Bytes(at, bytes) => self.ear.listener.handle(at, Input::Bytes(&bytes)),
            Came::Sent(at, bytes) | Came::Whole(at, bytes) => {
                self.ear.listener.handle(at, Input::Sent(&bytes));
            }
            Came::Lost(_) => {}
        }
        self.drain();
    }

    fn drain(&mut self) {
        while let Output::Heard(heard) = self.ear.listener.poll() {
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
            // A full disk must not end a command that is at work.
            Some(file) => drop(writeln!(file, "{text}")),
            None => out::note(text),
        }
    }
}

/// One line for a whole exchange: told with its reply, or with the end of the waiting for one.
fn exchange(lang: Lang, line: &str, heard: &Heard, facts: &Facts<'_>) -> Option<String> {
    let (at, asked) = match heard {
        Heard::Missing(missing) => (missing.at, Some(&missing.asked)),
        Heard::Frame(frame) => {
            let reading = frame.readings.first();
            let request = reading.filter(|reading| reading.role == Some(Role::Request));
            let asked = request.and_then(|reading| reading.request(&frame.bytes));
            if asked.is_some_and(|asked| asked.expects_reply()) && frame.verdict == Verdict::Good {
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
    let after = facts.after.filter(|_| matches!(heard, Heard::Frame(_)));
    let after =
        after.map(|after| format!("  {} {}", sniff::millis(after), lang.of(["ms", "毫秒"])));
    Some(format!(
        "{clock}  {line}  {protocol} {address}  {}{told}{}",
        asked.unwrap_or_default(),
        after.unwrap_or_default()
    ))
}

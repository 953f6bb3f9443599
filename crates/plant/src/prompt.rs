//! The sources of commands: stdin, and the control socket. Each line is a command, and each is
//! answered with one line.

use super::orders::{Directory, LineOrder, Order};
use super::serve::Job;
use super::texts::SimText;
use railbus_app::failure::Failure;
use railbus_words::Code;
use railbus_words::Lang;
use std::io::{BufRead, IsTerminal, Read, Write};
use std::sync::Arc;
use std::time::Duration;
use tokio::io::{AsyncBufReadExt, AsyncReadExt, AsyncWriteExt, BufReader};
use tokio::net::{UnixListener, UnixStream};
use tokio::sync::{Notify, Semaphore, mpsc, oneshot};

/// Maximum length of a command in bytes.
const LEN_MAX: u64 = 1_024;
/// Maximum number of clients; others wait until one has gone.
const CLIENTS_MAX: usize = 16;
/// Pause after a client could not be accepted.
const PAUSE: Duration = Duration::from_millis(100);
const PROMPT: &str = "sim> ";

/// All lines of a plant, ready for commands.
#[derive(Debug)]
pub(super) struct Prompt {
    pub(super) lang: Lang,
    pub(super) directory: Arc<Directory>,
    pub(super) lines: Vec<mpsc::Sender<Job>>,
    pub(super) quit: Notify,
}

impl Prompt {
    /// Executes a line of text; returns the lines to answer.
    pub(super) async fn answer(&self, text: &str) -> Vec<String> {
        match self.carry_out(text).await {
            Ok(lines) => lines,
            Err(failure) => {
                let told = failure.render(self.lang);
                vec![told.lines().next().unwrap_or_default().to_owned()]
            }
        }
    }

    async fn carry_out(&self, text: &str) -> Result<Vec<String>, Failure> {
        let told = |text: SimText| Ok(vec![self.lang.get(text).to_owned()]);
        match self.directory.read(self.lang, text)? {
            Order::Line(line, order) => self.send(line, order).await,
            Order::All(order) => {
                let mut all = Vec::new();
                for line in 0..self.lines.len() {
                    all.extend(self.send(line, order.clone()).await?);
                }
                if all.is_empty() {
                    return told(SimText::AllClear);
                }
                Ok(all)
            }
            Order::Help => told(SimText::HelpAnswer),
            Order::Quit => {
                self.quit.notify_one();
                told(SimText::Bye)
            }
        }
    }

    async fn send(&self, line: usize, order: LineOrder) -> Result<Vec<String>, Failure> {
        let gone = || Failure::new(Code::SimOrder, self.lang.get(SimText::Gone).to_owned());
        let (sender, receiver) = oneshot::channel();
        let line = self.lines.get(line).ok_or_else(gone)?;
        line.send(Job::Tell(order, sender))
            .await
            .map_err(|_| gone())?;
        receiver.await.map_err(|_| gone())
    }
}

/// Lines that are typed, or arrive through a pipe.
pub(super) struct Typed {
    lines: Option<mpsc::Receiver<String>>,
    terminal: bool,
}

impl Typed {
    /// Reads stdin, unless that is a terminal on which we are in the background: reading there
    /// stops the process.
    pub(super) fn listen() -> Typed {
        let terminal = std::io::stdin().is_terminal();
        let is_ours = !terminal || {
            let group = rustix::termios::tcgetpgrp(std::io::stdin());
            group.is_ok_and(|group| group == rustix::process::getpgrp())
        };
        let (sender, lines) = mpsc::channel(1);
        if is_ours {
            // It ends with the program: nothing can wake it from a read.
            let _ = std::thread::Builder::new()
                .name("stdin".to_owned())
                .spawn(move || read_lines(&sender));
        }
        let typed = Typed {
            lines: is_ours.then_some(lines),
            terminal: terminal && is_ours,
        };
        typed.show_prompt();
        typed
    }

    /// The next line; `None` when a terminal was closed. A pipe at its end is merely silent.
    pub(super) async fn next(&mut self) -> Option<String> {
        if let Some(lines) = &mut self.lines {
            if let Some(line) = lines.recv().await {
                return Some(line);
            }
            self.lines = None;
            if self.terminal {
                return None;
            }
        }
        std::future::pending().await
    }

    /// Shows an answer: on a terminal, one line for each module.
    pub(super) fn show(&self, answer: &[String]) {
        let parted = if self.terminal { "\n" } else { " | " };
        // The reader may have gone; the lines are served nevertheless.
        let _ = writeln!(std::io::stdout(), "{}", answer.join(parted));
        self.show_prompt();
    }

    fn show_prompt(&self) {
        if self.terminal {
            let mut stdout = std::io::stdout();
            let _ = write!(stdout, "{PROMPT}").and_then(|()| stdout.flush());
        }
    }
}

fn read_lines(sender: &mpsc::Sender<String>) {
    let mut stdin = std::io::stdin().lock();
    loop {
        let mut line = Vec::new();
        match stdin.by_ref().take(LEN_MAX).read_until(b'\n', &mut line) {
            Ok(0) | Err(_) => return,
            Ok(_) => {
                let line = String::from_utf8_lossy(&line).trim().to_owned();
                if !line.is_empty() && sender.blocking_send(line).is_err() {
                    return;
                }
            }
        }
    }
}

/// Accepts clients of the control socket until it is dropped.
pub(super) async fn accept(listener: &UnixListener, prompt: &Arc<Prompt>) {
    let seats = Arc::new(Semaphore::new(CLIENTS_MAX));
    loop {
        let seat = seats.clone().acquire_owned().await;
        let Ok((stream, _)) = listener.accept().await else {
            tokio::time::sleep(PAUSE).await;
            continue;
        };
        let prompt = prompt.clone();
        tokio::spawn(async move {
            // Errors of a client only affect that client.
            let _ = serve_client(stream, &prompt).await;
            drop(seat);
        });
    }
}

async fn serve_client(mut stream: UnixStream, prompt: &Prompt) -> std::io::Result<()> {
    let (reader, mut writer) = stream.split();
    let mut reader = BufReader::new(reader);
    loop {
        let mut line = Vec::new();
        let mut limited = (&mut reader).take(LEN_MAX);
        if limited.read_until(b'\n', &mut line).await? == 0 {
            return Ok(());
        }
        let too_long = line.len() as u64 == LEN_MAX && !line.ends_with(b"\n");
        let answer = if too_long {
            let message = prompt.lang.get(SimText::TooLong).to_owned();
            let failure = Failure::new(Code::SimOrder, message);
            failure.render(prompt.lang).lines().take(1).collect()
        } else {
            let order = String::from_utf8_lossy(&line);
            prompt.answer(&order).await.join(" | ")
        };
        writer.write_all(format!("{answer}\n").as_bytes()).await?;
        if too_long {
            return Ok(());
        }
    }
}

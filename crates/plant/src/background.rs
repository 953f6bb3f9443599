//! The demo line alongside another command of the same process, on its own thread: its bytes are
//! paced regardless of what the command does.

use super::demo;
use super::pty::Pty;
use super::remote::Remote;
use super::serve::{self, Clock, Jobs};
use super::stage::Stage;
use super::{demo_line, system};
use railbus_app::failure::Failure;
use railbus_words::Lang;
use std::path::{Path, PathBuf};
use std::sync::mpsc;
use std::thread::JoinHandle;
use tokio::sync::oneshot;

/// The running demo line. It ends when this is dropped.
#[derive(Debug)]
pub struct Background {
    path: PathBuf,
    remote: Remote,
    stop: Option<oneshot::Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl Background {
    /// Starts the demo line with its PTY at this path.
    pub fn start(lang: Lang, path: PathBuf) -> Result<Background, Failure> {
        let (stop, stopped) = oneshot::channel();
        let (ready, begun) = mpsc::channel();
        let link = path.clone();
        let (stage, directory) = demo::stage(lang, 0, false)?;
        let (remote, jobs) = Remote::new(lang, demo::LINE, directory);
        let thread = std::thread::Builder::new()
            .name("demo-line".to_owned())
            .spawn(move || run(lang, &link, (stage, jobs), stopped, &ready))
            .map_err(|error| system(lang, error))?;
        match begun.recv() {
            Ok(Ok(())) => Ok(Background {
                path,
                remote,
                stop: Some(stop),
                thread: Some(thread),
            }),
            Ok(Err(failure)) => Err(failure),
            Err(_) => Err(system(lang, std::io::Error::other("the thread ended"))),
        }
    }

    /// The path of its PTY.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The handle for commands to it.
    pub const fn remote(&self) -> &Remote {
        &self.remote
    }
}

impl Drop for Background {
    /// Waits for the thread, which removes the link to the PTY.
    fn drop(&mut self) {
        drop(self.stop.take());
        if let Some(thread) = self.thread.take() {
            // A panic has already been reported.
            let _ = thread.join();
        }
    }
}

fn run(
    lang: Lang,
    path: &Path,
    (stage, jobs): (Stage, Jobs),
    stopped: oneshot::Receiver<()>,
    ready: &mpsc::Sender<Result<(), Failure>>,
) {
    let begin = async {
        let pty = Pty::open(path)
            .map_err(|error| error.into_failure(lang, path, "railbus serve --demo"))?;
        let line = demo_line(stage, pty, None, None, Some(jobs));
        // Fails if the caller is gone; then the line ends at once.
        let _ = ready.send(Ok(()));
        let stop = async {
            let _ = stopped.await;
        };
        serve::serve(Clock::new(1.0), line, stop)
            .await
            .map_err(|error| system(lang, error))
    };
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .map_err(|error| system(lang, error));
    if let Err(failure) = runtime.and_then(|runtime| runtime.block_on(begin)) {
        let _ = ready.send(Err(failure));
    }
}

//! A daemon is killed during commands with an `Idempotency-Key`: nothing that may have been done is
//! done again, and the same answer is given again.

use crate::adapter::{answer, terminal};
use crate::daemon::{Answer, Daemon, Folder};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use std::io::Write;
use std::os::unix::net::UnixStream;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU8, AtomicUsize, Ordering};
use std::thread::JoinHandle;

/// A relay board that counts its commands, and can be made to answer nothing.
pub(crate) struct Board {
    device: PathBuf,
    relays: Arc<AtomicU8>,
    writes: Arc<AtomicUsize>,
    deaf: Arc<AtomicBool>,
    over: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Board {
    pub(crate) fn new() -> Board {
        let (line, device) = terminal();
        let now = Arc::<AtomicU8>::default();
        let shown = Arc::clone(&now);
        let (writes, deaf) = (Arc::<AtomicUsize>::default(), Arc::<AtomicBool>::default());
        let over = Arc::<AtomicBool>::default();
        let (counted, is_deaf, is_over) = (writes.clone(), deaf.clone(), over.clone());
        let thread = std::thread::spawn(move || {
            let mut relays = 0;
            while !is_over.load(Ordering::SeqCst) {
                let wait = Timespec {
                    tv_sec: 0,
                    tv_nsec: 20_000_000,
                };
                let _ = poll(&mut [PollFd::new(&line, PollFlags::IN)], Some(&wait));
                let mut request = [0; 64];
                let Ok(len @ 8..) = rustix::io::read(&line, &mut request) else {
                    std::thread::yield_now();
                    continue;
                };
                let writes = matches!(request[1], 5 | 15);
                counted.fetch_add(usize::from(writes), Ordering::SeqCst);
                // It acts, and its reply is lost.
                let reply = answer(&request[..len], &mut relays);
                shown.store(relays, Ordering::SeqCst);
                if !(is_deaf.load(Ordering::SeqCst) && writes) {
                    let _ = rustix::io::write(&line, &reply);
                }
            }
        });
        Board {
            device,
            relays: now,
            writes,
            deaf,
            over,
            thread: Some(thread),
        }
    }

    pub(crate) fn relays(&self) -> u8 {
        self.relays.load(Ordering::SeqCst)
    }

    fn writes(&self) -> usize {
        self.writes.load(Ordering::SeqCst)
    }
}

impl Drop for Board {
    fn drop(&mut self) {
        self.over.store(true, Ordering::SeqCst);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

pub(crate) fn started(board: &Board, name: &str) -> (Daemon, PathBuf) {
    let folder = Folder::new(name);
    let text = format!(
        "[line.main]\nport = \"pty:{}\"\n[module.oven]\nline = \"main\"\n\
         model = \"erc8\"\naddress = 3\n",
        board.device.display()
    );
    let file = folder.file("railbus.toml", &text);
    let daemon = Daemon::start_in(folder, &["--config", file.to_str().expect("text")]);
    daemon.until("it is read", |daemon| daemon.quality("oven.k1") == "good");
    (daemon, file)
}

fn toggle(daemon: &Daemon, key: &str) -> Answer {
    let head = format!("Idempotency-Key: {key}\r\n");
    daemon.ask("POST", "/points/oven/k1/toggle", &head, "")
}

fn killed(daemon: &mut Daemon, file: &std::path::Path) {
    daemon.child.kill().expect("it runs");
    daemon.start_again(&["--config", file.to_str().expect("text")]);
    daemon.until("it is read", |daemon| daemon.quality("oven.k1") == "good");
}

#[test]
fn what_was_answered_is_answered_again_after_a_kill() {
    let board = Board::new();
    let (mut daemon, file) = started(&board, "keys-after");
    let first = toggle(&daemon, "one");
    assert_eq!(first.status, 200, "{}", first.body);
    let refused = daemon.ask(
        "PUT",
        "/points/oven/k9",
        "Idempotency-Key: no\r\n",
        "{\"value\":true}",
    );
    let writes = board.writes();
    for _ in 0..2 {
        killed(&mut daemon, &file);
        let again = toggle(&daemon, "one");
        assert_eq!((again.status, &again.body), (200, &first.body));
        let still = daemon.ask(
            "PUT",
            "/points/oven/k9",
            "Idempotency-Key: no\r\n",
            "{\"value\":true}",
        );
        assert_eq!((still.status, &still.body), (refused.status, &refused.body));
    }
    assert_eq!(board.writes(), writes, "it was toggled once");
    // The key is still bound to that command only.
    let other = daemon.ask(
        "POST",
        "/points/oven/k2/toggle",
        "Idempotency-Key: one\r\n",
        "",
    );
    assert_eq!(other.end(), (422, "E0806".to_owned()));
    assert_eq!(toggle(&daemon, "two").status, 200);
    assert!(board.writes() > writes);
}

#[test]
fn what_was_cut_off_by_a_kill_is_not_done_again() {
    let board = Board::new();
    let (mut daemon, file) = started(&board, "keys-between");
    board.deaf.store(true, Ordering::SeqCst);
    let before = board.writes();
    // Sent without waiting for the answer: the daemon is killed once the frame has come.
    let socket = daemon.folder.0.join("socket");
    let mut asked = UnixStream::connect(socket).expect("it listens");
    write!(
        asked,
        "POST /api/v1/points/oven/k1/toggle HTTP/1.1\r\nHost: any\r\nIdempotency-Key: one\r\n\
         Content-Length: 0\r\n\r\n"
    )
    .expect("it is read");
    daemon.until("the frame has come", |_| board.writes() > before);
    daemon.child.kill().expect("it runs");
    daemon.child.wait().expect("it ends");
    board.deaf.store(false, Ordering::SeqCst);
    daemon.start_again(&["--config", file.to_str().expect("text")]);
    daemon.until("it is read", |daemon| daemon.quality("oven.k1") == "good");
    let writes = board.writes();
    let again: Vec<_> = std::thread::scope(|scope| {
        let asked: Vec<_> = (0..4)
            .map(|_| scope.spawn(|| toggle(&daemon, "one")))
            .collect();
        asked
            .into_iter()
            .map(|one| one.join().expect("an answer"))
            .collect()
    });
    for answer in again {
        assert_eq!(answer.end(), (504, "E0303".to_owned()), "{}", answer.body);
        assert_eq!(answer.json()["may_have_acted"], true);
    }
    assert_eq!(board.writes(), writes, "nothing was sent again");
}

#[test]
fn who_asks_at_once_under_one_key_toggles_once() {
    let board = Board::new();
    let (daemon, _) = started(&board, "keys-at-once");
    let answers: Vec<_> = std::thread::scope(|scope| {
        let asked: Vec<_> = (0..6)
            .map(|_| scope.spawn(|| toggle(&daemon, "one")))
            .collect();
        asked
            .into_iter()
            .map(|one| one.join().expect("an answer").body)
            .collect()
    });
    assert!(
        answers.windows(2).all(|pair| pair[0] == pair[1]),
        "{answers:?}"
    );
    assert_eq!(board.writes(), 1);
}

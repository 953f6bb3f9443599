//! A daemon, and requests to it.

use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, Stdio};
use std::time::{Duration, Instant};

/// A daemon that is stopped at the end of the test, however it ends.
pub(crate) struct Daemon {
    pub(crate) child: Child,
    pub(crate) address: String,
    pub(crate) folder: PathBuf,
    /// What it printed until it served.
    pub(crate) told: String,
    /// An administrator's token; none if the daemon has no accounts.
    token: Option<String>,
    pub(crate) stdout: BufReader<ChildStdout>,
}

/// What came back.
pub(crate) struct Answer {
    pub(crate) status: u16,
    pub(crate) head: String,
    pub(crate) body: Vec<u8>,
}

impl Answer {
    pub(crate) fn text(&self) -> &str {
        std::str::from_utf8(&self.body).expect("text")
    }

    pub(crate) fn json(&self) -> Value {
        serde_json::from_slice(&self.body).expect("JSON")
    }

    /// Its status and its code, where it is a problem.
    pub(crate) fn end(&self) -> (u16, String) {
        let problem: Value = serde_json::from_slice(&self.body).unwrap_or_default();
        let code = problem["code"].as_str().unwrap_or_default().to_owned();
        (self.status, code)
    }
}

/// The program in English, unaware of this machine's sites.
pub(crate) fn railbus() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_railbus"));
    // Without `--socket`, no daemon of this machine is found.
    let nowhere = format!("railbus-api-{}-nowhere", std::process::id());
    command
        .env("RAILBUS_RUN", std::env::temp_dir().join(nowhere))
        .env("RAILBUS_LANG", "en")
        .env_remove("RAILBUS_STATE")
        .env_remove("RAILBUS_CONFIG");
    command
}

/// A folder of this test alone.
pub(crate) fn folder(name: &str) -> PathBuf {
    let unique = format!("railbus-api-{}-{name}", std::process::id());
    let folder = std::env::temp_dir().join(unique);
    std::fs::create_dir_all(&folder).expect("a folder");
    folder
}

impl Daemon {
    /// The demo, once every point of it is good.
    pub(crate) fn demo(name: &str) -> Daemon {
        let daemon = Daemon::start(name, &["--demo"]);
        daemon.until("every point is good", |daemon| {
            let points = daemon.get("/api/v1/points").json();
            let points = points["points"].as_array().expect("a list").clone();
            !points.is_empty() && points.iter().all(|point| point["quality"] == "good")
        });
        daemon
    }

    pub(crate) fn start(name: &str, arguments: &[&str]) -> Daemon {
        Daemon::start_in(folder(name), arguments)
    }

    pub(crate) fn start_in(folder: PathBuf, arguments: &[&str]) -> Daemon {
        let (child, stdout, told) = spawn(&folder, arguments);
        let mut daemon = Daemon {
            child,
            address: address(&told),
            folder,
            told,
            token: None,
            stdout,
        };
        daemon.token = daemon.own_token();
        daemon
    }

    /// Starts another in its place, once it has ended.
    pub(crate) fn start_again(&mut self, arguments: &[&str]) {
        self.child.wait().expect("it ends");
        (self.child, self.stdout, self.told) = spawn(&self.folder, arguments);
        self.address = address(&self.told);
    }

    /// A token of the daemon's own user, who may request one over its socket; none if the daemon
    /// has no tokens.
    fn own_token(&self) -> Option<String> {
        let body = r#"{"name":"test","role":"admin","points":[],"expires_days":1}"#;
        let answer = self.as_owner("POST", "/api/v1/tokens", body);
        if answer.status == 404 {
            return None;
        }
        let token = answer.json()["token"].as_str().map(str::to_owned);
        Some(token.expect("a token"))
    }

    /// The head lines with token and host.
    pub(crate) fn head(&self) -> String {
        let host = format!("Host: {}\r\n", self.address);
        match &self.token {
            Some(token) => format!("{host}Authorization: Bearer {token}\r\n"),
            None => host,
        }
    }

    /// How many files and connections it has open.
    pub(crate) fn open_files(&self) -> usize {
        let folder = format!("/proc/{}/fd", self.child.id());
        std::fs::read_dir(folder).expect("it runs").count()
    }

    pub(crate) fn connect(&self) -> TcpStream {
        TcpStream::connect(&self.address).expect("it listens")
    }

    pub(crate) fn connect_to_socket(&self) -> UnixStream {
        UnixStream::connect(self.folder.join("socket")).expect("it listens")
    }

    /// Over the socket, where no login is needed.
    pub(crate) fn as_owner(&self, method: &str, path: &str, body: &str) -> Answer {
        let head = "Host: railbus\r\nContent-Type: application/json\r\n";
        exchange(self.connect_to_socket(), method, path, head, body)
    }

    pub(crate) fn send(&self, method: &str, path: &str, body: &str) -> Answer {
        let head = format!("{}Content-Type: application/json\r\n", self.head());
        exchange(self.connect(), method, path, &head, body)
    }

    /// As above, if the daemon may close before everything was sent.
    pub(crate) fn try_send(&self, method: &str, path: &str, body: &str) -> Option<Answer> {
        let mut stream = self.connect();
        let (head, length) = (self.head(), body.len());
        write!(
            stream,
            "{method} {path} HTTP/1.1\r\nConnection: close\r\n{head}Content-Length: {length}\r\n\
             \r\n"
        )
        .ok()?;
        // Whether the rest was accepted does not matter; the answer does.
        let _ = stream.write_all(body.as_bytes());
        let mut bytes = Vec::new();
        let _ = stream.read_to_end(&mut bytes);
        bytes
            .windows(4)
            .any(|four| four == b"\r\n\r\n")
            .then(|| answer_of(&bytes))
    }

    pub(crate) fn get(&self, path: &str) -> Answer {
        self.send("GET", path, "")
    }

    pub(crate) fn put(&self, path: &str, body: &str) -> Answer {
        self.send("PUT", path, body)
    }

    pub(crate) fn signal(&self, signal: Signal) {
        kill_process(Pid::from_child(&self.child), signal).expect("it runs");
    }

    pub(crate) fn stderr(&self) -> String {
        std::fs::read_to_string(self.folder.join("stderr")).expect("a file")
    }

    pub(crate) fn until(&self, what: &str, done: impl Fn(&Daemon) -> bool) {
        let start = Instant::now();
        while !done(self) {
            let passed = start.elapsed();
            assert!(passed < Duration::from_secs(60), "{what}: it never came");
            std::thread::sleep(Duration::from_millis(50));
        }
    }
}

impl Drop for Daemon {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}

/// A daemon that serves, and what it said by then.
fn spawn(folder: &Path, arguments: &[&str]) -> (Child, BufReader<ChildStdout>, String) {
    let mut child = railbus()
        .env("RAILBUS_STATE", folder.join("state"))
        .env("TMPDIR", folder)
        .args(["serve", "--listen", "127.0.0.1:0", "--socket"])
        .arg(folder.join("socket"))
        .args(arguments)
        .stdout(Stdio::piped())
        .stderr(std::fs::File::create(folder.join("stderr")).expect("a file"))
        .spawn()
        .expect("railbus starts");
    let mut stdout = BufReader::new(child.stdout.take().expect("it is piped"));
    let mut told = String::new();
    while !told.contains("Ctrl-C") {
        assert_ne!(stdout.read_line(&mut told).expect("text"), 0, "{told}");
    }
    (child, stdout, told)
}

/// The address it printed; none over TLS.
fn address(told: &str) -> String {
    let web = told
        .lines()
        .find_map(|line| line.trim().strip_prefix("web     http://"));
    web.and_then(|web| web.split('/').next())
        .unwrap_or_default()
        .to_owned()
}

/// One request, and all that comes back until the connection is closed.
pub(crate) fn exchange(
    mut stream: impl Read + Write,
    method: &str,
    path: &str,
    head: &str,
    body: &str,
) -> Answer {
    let length = body.len();
    write!(
        stream,
        "{method} {path} HTTP/1.1\r\nConnection: close\r\n{head}Content-Length: {length}\r\n\r\n\
         {body}"
    )
    .expect("it takes bytes");
    let mut bytes = Vec::new();
    stream.read_to_end(&mut bytes).expect("bytes");
    answer_of(&bytes)
}

pub(crate) fn answer_of(bytes: &[u8]) -> Answer {
    let end = bytes.windows(4).position(|four| four == b"\r\n\r\n");
    let end = end.expect("a head");
    let head = String::from_utf8(bytes[..end].to_vec()).expect("text");
    let head = head.to_ascii_lowercase();
    let status = head
        .split(' ')
        .nth(1)
        .and_then(|status| status.parse().ok());
    let body = bytes[end + 4..].to_vec();
    let chunked = head.contains("transfer-encoding: chunked");
    Answer {
        status: status.expect("a status"),
        body: if chunked { joined(&body) } else { body },
        head,
    }
}

/// The chunks of a body put together.
fn joined(mut chunks: &[u8]) -> Vec<u8> {
    let mut whole = Vec::new();
    loop {
        let end = chunks.windows(2).position(|two| two == b"\r\n");
        let end = end.expect("the length of a chunk");
        let length = std::str::from_utf8(&chunks[..end]).expect("digits");
        let length = usize::from_str_radix(length, 16).expect("digits");
        if length == 0 {
            return whole;
        }
        whole.extend_from_slice(&chunks[end + 2..end + 2 + length]);
        chunks = &chunks[end + 2 + length + 2..];
    }
}

//! A daemon, and requests to it.

use serde_json::Value;
use std::io::{BufRead, BufReader, Read, Write};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, Stdio};
use std::time::{Duration, Instant};

/// A folder that is removed at the end of the test.
pub(crate) struct Folder(pub(crate) PathBuf);

impl Folder {
    pub(crate) fn new(name: &str) -> Folder {
        let unique = format!("railbus-keeping-{}-{name}", std::process::id());
        let folder = std::env::temp_dir().join(unique);
        std::fs::create_dir_all(&folder).expect("a folder");
        Folder(folder)
    }

    pub(crate) fn file(&self, name: &str, text: &str) -> PathBuf {
        let path = self.0.join(name);
        std::fs::write(&path, text).expect("a file");
        path
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// A daemon that is stopped at the end of the test, however it ends.
pub(crate) struct Daemon {
    pub(crate) child: Child,
    pub(crate) folder: Folder,
    pub(crate) told: String,
    _stdout: BufReader<ChildStdout>,
}

/// What came back.
pub(crate) struct Answer {
    pub(crate) status: u16,
    pub(crate) head: String,
    pub(crate) body: String,
}

impl Answer {
    pub(crate) fn json(&self) -> Value {
        serde_json::from_str(&self.body).expect("JSON")
    }

    /// Its status and its code, where it is a problem.
    pub(crate) fn end(&self) -> (u16, String) {
        let code = self.json()["code"].as_str().unwrap_or_default().to_owned();
        (self.status, code)
    }
}

pub(crate) fn railbus() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_railbus"));
    command
        .env("RAILBUS_LANG", "en")
        .env_remove("RAILBUS_STATE")
        .env_remove("RAILBUS_CONFIG");
    command
}

impl Daemon {
    pub(crate) fn start(name: &str, arguments: &[&str]) -> Daemon {
        Daemon::start_in(Folder::new(name), arguments)
    }

    pub(crate) fn start_in(folder: Folder, arguments: &[&str]) -> Daemon {
        let (child, told, stdout) = spawn(&folder.0, arguments);
        Daemon {
            child,
            folder,
            told,
            _stdout: stdout,
        }
    }

    /// Starts another in its place, once it has ended.
    pub(crate) fn start_again(&mut self, arguments: &[&str]) {
        self.child.wait().expect("it ends");
        (self.child, self.told, self._stdout) = spawn(&self.folder.0, arguments);
    }

    pub(crate) fn ask(&self, method: &str, path: &str, head: &str, body: &str) -> Answer {
        let socket = self.folder.0.join("socket");
        let mut stream = UnixStream::connect(socket).expect("it listens");
        let length = body.len();
        // A body that is too long is not read to its end.
        let _ = write!(
            stream,
            "{method} /api/v1{path} HTTP/1.1\r\nHost: any\r\nConnection: close\r\n\
             Content-Length: {length}\r\n{head}\r\n{body}"
        );
        let mut bytes = Vec::new();
        let _ = stream.read_to_end(&mut bytes);
        let text = String::from_utf8(bytes).expect("text");
        let (head, body) = text.split_once("\r\n\r\n").expect("a head");
        let status = head.split(' ').nth(1).and_then(|word| word.parse().ok());
        Answer {
            status: status.expect("a status"),
            head: head.to_ascii_lowercase(),
            body: body.to_owned(),
        }
    }

    pub(crate) fn send(&self, method: &str, path: &str, body: &Value) -> Answer {
        self.ask(method, path, "", &body.to_string())
    }

    pub(crate) fn get(&self, path: &str) -> Value {
        let answer = self.ask("GET", path, "", "");
        assert_eq!(answer.status, 200, "{path}: {}", answer.body);
        answer.json()
    }

    /// Waits until a condition holds.
    pub(crate) fn until(&self, what: &str, done: impl Fn(&Daemon) -> bool) {
        let start = Instant::now();
        while !done(self) {
            let passed = start.elapsed();
            assert!(passed < Duration::from_secs(60), "{what}: it never came");
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// The quality of a point.
    pub(crate) fn quality(&self, path: &str) -> String {
        let (module, label) = path.split_once('.').expect("a point");
        let answer = self.ask("GET", &format!("/points/{module}/{label}"), "", "");
        answer.json()["quality"]
            .as_str()
            .unwrap_or_default()
            .to_owned()
    }
}

/// A daemon that serves, and what it printed by then.
fn spawn(folder: &Path, arguments: &[&str]) -> (Child, String, BufReader<ChildStdout>) {
    let mut child = railbus()
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
        let read = stdout.read_line(&mut told).expect("text");
        assert_ne!(read, 0, "it ended: {}", stderr(folder));
    }
    (child, told, stdout)
}

fn stderr(folder: &Path) -> String {
    std::fs::read_to_string(folder.join("stderr")).unwrap_or_default()
}

impl Drop for Daemon {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

//! A simulated line, a configuration for it, and the real program.
#![allow(
    dead_code,
    unreachable_pub,
    reason = "each test file uses a part of it"
)]

use rustix::process::{Pid, Signal, kill_process};
use std::io::{BufRead, BufReader, Write};
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};

/// How a run ended.
#[derive(Debug)]
pub struct Ran {
    pub code: i32,
    pub out: String,
    pub err: String,
}

impl Ran {
    /// What it printed, as JSON.
    pub fn json(&self) -> serde_json::Value {
        serde_json::from_str(&self.out).unwrap_or_else(|error| panic!("{error}: {self:?}"))
    }

    /// Its error, as JSON.
    pub fn error(&self) -> serde_json::Value {
        let last = self.err.lines().last().unwrap_or_default();
        let told: serde_json::Value =
            serde_json::from_str(last).unwrap_or_else(|error| panic!("{error}: {self:?}"));
        told["error"].clone()
    }
}

/// Processes and files that are removed at the end of a test, however it ends.
pub struct Site {
    pub folder: PathBuf,
    children: Vec<Child>,
}

impl Drop for Site {
    fn drop(&mut self) {
        for child in &mut self.children {
            let _ = child.kill();
            let _ = child.wait();
        }
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}

impl Site {
    /// Nothing but a folder.
    pub fn empty(name: &str) -> Site {
        let unique = format!("railbus-cli-{}-{name}", std::process::id());
        let folder = std::env::temp_dir().join(unique);
        std::fs::create_dir_all(&folder).expect("a folder");
        Site {
            folder,
            children: Vec::new(),
        }
    }

    /// The demo line on a PTY, and its configuration.
    pub fn demo(name: &str) -> Site {
        let mut site = Site::empty(name);
        let pty = site.folder.join("line");
        let pty = pty.to_str().expect("text").to_owned();
        site.start(
            &["sim", "--demo", "--tcp", "127.0.0.1:0", "--pty", &pty],
            "TCP",
        );
        site.configure(&format!(
            "[line.main]\nport = \"pty:{pty}\"\n{}",
            include_str!("modules.toml")
        ));
        site
    }

    /// The demo behind a daemon.
    pub fn served(name: &str) -> Site {
        let mut site = Site::empty(name);
        let socket = site.socket();
        site.start(
            &[
                "serve",
                "--demo",
                "--listen",
                "127.0.0.1:0",
                "--socket",
                &socket,
            ],
            "socket",
        );
        site
    }

    /// A daemon for the configuration in the folder.
    pub fn serve(&mut self) {
        let socket = self.socket();
        let listen = ["serve", "--listen", "127.0.0.1:0", "--socket", &socket];
        self.start(&listen, "socket");
    }

    /// Kills the oldest process that is still running.
    pub fn stop_first(&mut self) {
        let mut child = self.children.remove(0);
        child.kill().expect("it runs");
        child.wait().expect("it ends");
    }

    /// Sends it SIGTERM, and waits for its end.
    pub fn end_first(&mut self) {
        let mut child = self.children.remove(0);
        signal(&child, Signal::TERM);
        child.wait().expect("it ends");
    }

    pub fn socket(&self) -> String {
        self.folder.join("socket").display().to_string()
    }

    pub fn configure(&self, text: &str) {
        std::fs::write(self.folder.join("railbus.toml"), text).expect("a file");
    }

    /// Starts it and waits until it has printed a word.
    pub fn start(&mut self, arguments: &[&str], word: &str) {
        let mut command = self.command();
        let mut child = command
            .args(arguments)
            .stdout(Stdio::piped())
            .spawn()
            .expect("railbus starts");
        let mut said = BufReader::new(child.stdout.take().expect("it is piped"));
        self.children.push(child);
        let mut line = String::new();
        while !line.contains(word) {
            line.clear();
            assert_ne!(said.read_line(&mut line).expect("text"), 0, "it ended");
        }
        // A process that prints more must not be stopped by a full or a broken pipe.
        std::thread::spawn(move || std::io::copy(&mut said, &mut std::io::sink()));
    }

    pub fn command(&self) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_railbus"));
        command
            .current_dir(&self.folder)
            .env("RAILBUS_LANG", "en")
            .env("TZ", "UTC")
            .env("HOME", &self.folder)
            .env("TMPDIR", &self.folder)
            // Whatever runs on this machine is none of the test's daemons.
            .env("RAILBUS_RUN", self.folder.join("run"))
            .env_remove("RAILBUS_SOCKET")
            .env_remove("RAILBUS_STATE")
            .env("XDG_RUNTIME_DIR", self.folder.join("run"))
            .env_remove("RAILBUS_CONFIG");
        command
    }

    /// Runs it to its end; the words are separated by blanks.
    pub fn run(&self, line: &str) -> Ran {
        self.run_with(&line.split(' ').collect::<Vec<_>>(), "")
    }

    pub fn run_with(&self, arguments: &[&str], input: &str) -> Ran {
        let mut child = self
            .command()
            .args(arguments)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("railbus starts");
        let mut stdin = child.stdin.take().expect("it is piped");
        let _ = stdin.write_all(input.as_bytes());
        drop(stdin);
        let output = child.wait_with_output().expect("it ends");
        Ran {
            code: output.status.code().unwrap_or(-1),
            out: String::from_utf8(output.stdout).expect("text"),
            err: String::from_utf8(output.stderr).expect("text"),
        }
    }
}

/// Sends a signal to a process that was started here.
pub fn signal(child: &Child, signal: Signal) {
    kill_process(Pid::from_child(child), signal).expect("it runs");
}

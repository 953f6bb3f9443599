//! The reader's shell: its own folder, the program in the path.
//!
//! Where a page has `/tmp/`, a reader's files are; here that is the folder, and [`ADDRESS`],
//! [`MODBUS_PORT`], [`MQTT_PORT`], [`OPCUA_PORT`] and [`FLEET_PORT`] are replaced by free ports:
//! pages tested at the same time do not collide.

use crate::websocket::Client;
use rustix::process::{Pid, Signal};
use std::io::{BufRead, BufReader};
use std::net::{Ipv4Addr, TcpListener};
use std::os::unix::net::UnixStream;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Where the daemon of a page listens.
const ADDRESS: &str = "127.0.0.1:7485";
/// Before it has printed where it does.
const ANY_PORT: &str = "127.0.0.1:0";
/// Where the Modbus TCP server of a page listens.
const MODBUS_PORT: &str = "1502";
/// Where the MQTT broker of a page listens.
const MQTT_PORT: &str = "1883";
const OPCUA_PORT: &str = "4840";
/// How long the processes in the background have to end.
const END_MAX: Duration = Duration::from_secs(20);

/// Where the servers of a fleet listen.
const FLEET_PORT: &str = "4222";

pub(crate) struct Shell {
    folder: PathBuf,
    lang: String,
    address: String,
    modbus_port: String,
    mqtt_port: String,
    opcua_port: String,
    fleet_port: String,
    background: Vec<Child>,
}

impl Drop for Shell {
    fn drop(&mut self) {
        // As at a terminal: some have processes of their own to end.
        for child in &self.background {
            let _ = rustix::process::kill_process(Pid::from_child(child), Signal::TERM);
        }
        let deadline = Instant::now() + END_MAX;
        for child in &mut self.background {
            while matches!(child.try_wait(), Ok(None)) && Instant::now() < deadline {
                std::thread::sleep(Duration::from_millis(10));
            }
            let _ = child.kill();
            let _ = child.wait();
        }
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}

impl Shell {
    pub(crate) fn new(lang: &str) -> Shell {
        static COUNT: std::sync::atomic::AtomicU32 = std::sync::atomic::AtomicU32::new(0);
        let count = COUNT.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        // A short name, for the sake of the tables that show paths in it.
        let folder = std::env::temp_dir().join(format!("{lang}{}{count}", std::process::id()));
        std::fs::create_dir_all(&folder).expect("a folder");
        Shell {
            folder,
            lang: lang.to_owned(),
            address: ANY_PORT.to_owned(),
            modbus_port: free_port(count).to_string(),
            mqtt_port: free_port(count + 6_000).to_string(),
            opcua_port: free_port(count + 9_000).to_string(),
            fleet_port: free_port(count + 3_000).to_string(),
            background: Vec::new(),
        }
    }

    pub(crate) fn file(&self, name: &str, body: &str) {
        std::fs::write(self.folder.join(name), self.here(body)).expect("a file");
    }

    /// Runs a command to its end: what a terminal would show.
    pub(crate) fn run(&self, command: &str) -> String {
        let command = format!("{{ {command}\n}} 2>&1");
        let output = self.shell(&command).output().expect("a shell");
        let said = String::from_utf8(output.stdout).expect("text");
        let said = self.there(&said);
        match said.is_empty() || said.ends_with('\n') {
            true => said,
            false => said + "\n",
        }
    }

    /// Starts a command and waits for its first lines: as many as the page shows, at least one.
    pub(crate) fn start(&mut self, command: &str, lines: usize) -> String {
        let mut child = self
            .shell(&format!("exec {command}"))
            .stdout(Stdio::piped())
            .spawn()
            .expect("a shell");
        let mut said = BufReader::new(child.stdout.take().expect("it is piped"));
        self.background.push(child);
        let mut text = String::new();
        for _ in 0..lines.max(1) {
            assert_ne!(
                said.read_line(&mut text).expect("text"),
                0,
                "{command}: {text}"
            );
        }
        // A process that prints more must not be stopped by a full or a broken pipe.
        std::thread::spawn(move || std::io::copy(&mut said, &mut std::io::sink()));
        if let Some((_, after)) = text.split_once("http://") {
            after
                .split('/')
                .next()
                .unwrap_or(ANY_PORT)
                .clone_into(&mut self.address);
        }
        self.there(&text)
    }

    /// A WebSocket to the daemon that runs in the background, through its socket.
    pub(crate) fn websocket(&self, path: &str) -> Client {
        let stream = UnixStream::connect(self.folder.join("railbus.sock")).expect("it listens");
        let patience = Some(Duration::from_secs(60));
        stream.set_read_timeout(patience).expect("a socket");
        let client = Client::over(Box::new(stream), "Host: railbus\r\n", path);
        client.expect("it is let in")
    }

    /// Replaces what a page shows by what is used here.
    fn here(&self, text: &str) -> String {
        // The folder may have these digits in its name.
        text.replace(MODBUS_PORT, &self.modbus_port)
            .replace(MQTT_PORT, &self.mqtt_port)
            .replace(OPCUA_PORT, &self.opcua_port)
            .replace(FLEET_PORT, &self.fleet_port)
            .replace("/tmp/", &format!("{}/", self.folder.display()))
            .replace(ADDRESS, &self.address)
    }

    /// Replaces what is used here by what a page shows.
    fn there(&self, text: &str) -> String {
        let folder = self.folder.display().to_string();
        let text = text
            .replace(&format!("{folder}/"), "/tmp/")
            .replace(&folder, "/tmp")
            .replace(
                &format!("127.0.0.1:{}", self.modbus_port),
                &format!("127.0.0.1:{MODBUS_PORT}"),
            )
            .replace(
                &format!("127.0.0.1:{}", self.opcua_port),
                &format!("127.0.0.1:{OPCUA_PORT}"),
            )
            .replace(
                &format!("127.0.0.1:{}", self.fleet_port),
                &format!("127.0.0.1:{FLEET_PORT}"),
            );
        match self.address == ANY_PORT {
            true => text,
            false => text.replace(&self.address, ADDRESS),
        }
    }

    fn shell(&self, command: &str) -> Command {
        let program = Path::new(env!("CARGO_BIN_EXE_railbus"));
        let folder = program.parent().expect("it lies in one").display();
        let path = std::env::var("PATH").unwrap_or_default();
        // Where the third-party programs in Python are.
        let peers = concat!(env!("CARGO_MANIFEST_DIR"), "/../../target/interop-venv/bin");
        let mut shell = Command::new("sh");
        shell
            .args(["-c", &self.here(command)])
            .current_dir(&self.folder)
            .stdin(Stdio::null())
            .process_group(0)
            .env("PATH", format!("{folder}:{path}:{peers}"))
            .env("RAILBUS_LANG", &self.lang)
            .env("TZ", "UTC")
            .env("HOME", &self.folder)
            .env("XDG_RUNTIME_DIR", &self.folder)
            .env("RAILBUS_RUN", &self.folder)
            .env_remove("XDG_STATE_HOME")
            .env_remove("XDG_CONFIG_HOME")
            .env_remove("RAILBUS_CONFIG");
        shell
    }
}

/// A free port for the shell with this number. The system gives none below 32768 to those who ask
/// for any.
fn free_port(count: u32) -> u16 {
    let first = std::process::id().wrapping_mul(64).wrapping_add(count) % 12_000;
    let mut ports = (first..first + 64).map(|port| 20_000 + port as u16);
    let is_free = |port: &u16| TcpListener::bind((Ipv4Addr::LOCALHOST, *port)).is_ok();
    ports.find(is_free).expect("a free port")
}

//! `railbus sim` as a third-party master sees it: a link to a PTY, and raw bytes over TCP. Nothing
//! here uses a crate of railbus.

use rustix::process::{Pid, Signal, kill_process};
use rustix::termios::{OptionalActions, SpecialCodeIndex, tcgetattr, tcsetattr};
use std::fs::{File, OpenOptions};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

/// Relay 1 of `oven` on, answered by its echo.
const OVEN_ON: [u8; 8] = [0x03, 0x05, 0x00, 0x3C, 0xFF, 0x00, 0x4D, 0xD4];

/// The silence that the ERC-8 needs before a request, the longest of the five.
const GAP: Duration = Duration::from_millis(20);

/// A simulator that is stopped at the end of the test, however it ends.
struct Sim {
    child: Child,
    link: PathBuf,
    tcp: String,
    stdout: BufReader<std::process::ChildStdout>,
}

impl Sim {
    fn start(name: &str) -> Sim {
        Sim::start_with(&link(name), &[])
    }

    fn start_with(link: &Path, more: &[&str]) -> Sim {
        let mut child = railbus()
            .args(["sim", "--demo", "--tcp", "127.0.0.1:0", "--pty"])
            .arg(link)
            .args(more)
            .stdout(Stdio::piped())
            .spawn()
            .expect("railbus starts");
        let mut stdout = BufReader::new(child.stdout.take().expect("it is piped"));
        // The addresses are printed once they can be reached.
        let mut tcp = String::new();
        while tcp.is_empty() {
            let mut line = String::new();
            assert_ne!(stdout.read_line(&mut line).expect("text"), 0, "it ended");
            if let Some(rest) = line.trim_start().strip_prefix("TCP  ") {
                tcp = rest.split(' ').next().unwrap_or_default().to_owned();
            }
        }
        Sim {
            child,
            link: link.to_owned(),
            tcp,
            stdout,
        }
    }

    /// Opens the PTY as a master does: raw, each read waits a second at most. What most C libraries
    /// set as the speed is the output speed; they leave the input speed as it was.
    fn open_pty(&self, speed: u32) -> File {
        let port = OpenOptions::new()
            .read(true)
            .write(true)
            .open(&self.link)
            .expect("the link leads to a PTY");
        let mut settings = tcgetattr(&port).expect("a terminal");
        settings.make_raw();
        settings.set_output_speed(speed).expect("a speed");
        settings.special_codes[SpecialCodeIndex::VMIN] = 0;
        settings.special_codes[SpecialCodeIndex::VTIME] = 10;
        tcsetattr(&port, OptionalActions::Now, &settings).expect("settings");
        port
    }

    fn connect(&self) -> TcpStream {
        let client = TcpStream::connect(&self.tcp).expect("it listens");
        let second = Some(Duration::from_secs(1));
        client.set_read_timeout(second).expect("a timeout");
        client
    }

    fn signal(&mut self, signal: Signal) -> ExitStatus {
        let pid = Pid::from_child(&self.child);
        kill_process(pid, signal).expect("it runs");
        self.child.wait().expect("it ends")
    }
}

impl Drop for Sim {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
        let _ = std::fs::remove_file(&self.link);
    }
}

fn railbus() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_railbus"));
    command.env("RAILBUS_LANG", "en");
    command
}

/// A path of this test only.
fn link(name: &str) -> PathBuf {
    let unique = format!("railbus-test-{}-{name}", std::process::id());
    std::env::temp_dir().join(unique)
}

/// Sends after the gap, and reads as many bytes as the answer should have; what came within a
/// second.
fn ask(port: &mut (impl Read + Write), request: &[u8], expected: usize) -> Vec<u8> {
    std::thread::sleep(GAP);
    port.write_all(request).expect("it takes bytes");
    hear(port, expected)
}

fn hear(port: &mut impl Read, expected: usize) -> Vec<u8> {
    let mut heard = Vec::new();
    let mut buffer = [0; 64];
    while heard.len() < expected {
        match port.read(&mut buffer) {
            Ok(0) | Err(_) => break,
            Ok(count) => heard.extend_from_slice(&buffer[..count]),
        }
    }
    heard
}

#[test]
fn all_protocols_answer_on_the_pty() {
    let sim = Sim::start("protocols");
    let mut port = sim.open_pty(9_600);
    assert_eq!(ask(&mut port, b"$01M\r", 8), b"!019060\r");
    let gate = ask(&mut port, b"LW\x02\x03\x05\r", 7);
    assert_eq!(
        (&gate[..3], gate.len(), gate[6]),
        (&b"lc\x02"[..], 7, b'\r')
    );
    assert_eq!(ask(&mut port, &OVEN_ON, 8), OVEN_ON);
    let yard = [0x55, 0x04, 0x12, 0x00, 0x00, 0x00, 0x01, 0x6C];
    let closed = [0x22, 0x04, 0x12, 0x00, 0x00, 0x00, 0x01, 0x39];
    assert_eq!(ask(&mut port, &yard, 8), closed);
    let tank = [0x05, 0x03, 0x00, 0x06, 0x00, 0x02, 0x25, 0x8E];
    assert_eq!(ask(&mut port, &tank, 9)[..3], [0x05, 0x03, 0x04]);
}

#[test]
fn a_reply_takes_its_time_on_the_wire() {
    let sim = Sim::start("pace");
    let mut port = sim.open_pty(9_600);
    let began = Instant::now();
    assert_eq!(ask(&mut port, &OVEN_ON, 8), OVEN_ON);
    // Two frames of 8.334 ms, 3.646 ms of silence, 5 ms of turnaround.
    assert!(began.elapsed() >= Duration::from_micros(25_314));
}

#[test]
fn a_master_of_another_speed_gets_no_answer() {
    let sim = Sim::start("speed");
    let mut port = sim.open_pty(19_200);
    assert_eq!(ask(&mut port, &OVEN_ON, 8), []);
    drop(port);
    let mut port = sim.open_pty(9_600);
    assert_eq!(ask(&mut port, &OVEN_ON, 8), OVEN_ON);
}

#[test]
fn masters_may_come_and_go_and_find_nothing_old() {
    let sim = Sim::start("reopen");
    for _ in 0..3 {
        let mut port = sim.open_pty(9_600);
        assert_eq!(ask(&mut port, &OVEN_ON, 8), OVEN_ON);
        // Left unread.
        port.write_all(&OVEN_ON).expect("it takes bytes");
        let mut client = sim.connect();
        hear(&mut client, 8);
    }
    let mut client = sim.connect();
    assert_eq!(ask(&mut client, &OVEN_ON, 8), OVEN_ON);
    let mut port = sim.open_pty(9_600);
    assert_eq!(ask(&mut port, b"$01M\r", 8), b"!019060\r");
}

#[test]
fn two_clients_share_the_line() {
    let sim = Sim::start("clients");
    let (mut first, mut second) = (sim.connect(), sim.connect());
    assert_eq!(ask(&mut first, b"$01M\r", 8), b"!019060\r");
    assert_eq!(hear(&mut second, 8), b"!019060\r", "both hear the line");
    assert_eq!(ask(&mut second, &OVEN_ON, 8), OVEN_ON);
    assert_eq!(hear(&mut first, 8), OVEN_ON);
}

#[test]
fn a_client_that_stops_sending_still_hears_the_reply() {
    let sim = Sim::start("half");
    let mut client = sim.connect();
    client.write_all(b"$01M\r").expect("it takes bytes");
    let write = std::net::Shutdown::Write;
    client.shutdown(write).expect("it is open");
    assert_eq!(hear(&mut client, 8), b"!019060\r");
}

#[test]
fn sigterm_takes_the_link_away() {
    for signal in [Signal::TERM, Signal::INT] {
        let mut sim = Sim::start("term");
        let port = sim.open_pty(9_600);
        assert!(sim.signal(signal).success());
        assert!(std::fs::symlink_metadata(&sim.link).is_err());
        drop(port);
    }
}

#[test]
fn a_stale_link_is_replaced() {
    let link = link("stale");
    std::os::unix::fs::symlink("/dev/pts/99999", &link).expect("a link");
    let sim = Sim::start_with(&link, &[]);
    assert_eq!(ask(&mut sim.open_pty(9_600), &OVEN_ON, 8), OVEN_ON);
}

#[test]
fn a_foreign_file_is_left_alone() {
    let path = link("foreign");
    std::fs::write(&path, "mine").expect("a file");
    let output = railbus()
        .args(["sim", "--demo", "--tcp", "127.0.0.1:0", "--pty"])
        .arg(&path)
        .output()
        .expect("railbus starts");
    let left = std::fs::read_to_string(&path).expect("still a file");
    std::fs::remove_file(&path).expect("it is ours");
    assert_eq!(left, "mine");
    assert_eq!(output.status.code(), Some(7));
    let told = String::from_utf8(output.stderr).expect("text");
    assert!(told.starts_with("error[E0703]: "), "{told}");
}

#[test]
fn a_busy_port_is_an_error_of_its_own() {
    let first = Sim::start("busy");
    let output = railbus()
        .args([
            "sim", "--demo", "--lang", "zh", "--tcp", &first.tcp, "--pty",
        ])
        .arg(&first.link)
        .output()
        .expect("railbus starts");
    assert_eq!(output.status.code(), Some(7));
    let told = String::from_utf8(output.stderr).expect("text");
    assert!(told.starts_with("错误[E0701]：无法监听 TCP "), "{told}");
    assert!(first.link.exists(), "the first one keeps its link");
}

#[test]
fn frames_are_shown_on_request() {
    let mut sim = Sim::start_with(&link("verbose"), &["-v"]);
    assert_eq!(ask(&mut sim.connect(), &OVEN_ON, 8), OVEN_ON);
    sim.signal(Signal::TERM);
    let mut rest = String::new();
    sim.stdout.read_to_string(&mut rest).expect("text");
    let frames: Vec<&str> = rest.lines().filter(|line| line.contains("sends")).collect();
    assert_eq!(frames.len(), 2, "{rest}");
    assert!(
        frames[0].ends_with("host      sends        03 05 00 3C FF 00 4D D4"),
        "{rest}"
    );
    // Request, silence and turnaround lie between the two beginnings.
    assert!(frames[1].contains("   17.0  oven      sends   "), "{rest}");
}

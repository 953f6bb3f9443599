//! The daemon is stopped under full load: frames are sent whole, and outputs end as their policies
//! say.

use crate::daemon::{Daemon, Folder, railbus};
use rustix::process::{Pid, Signal, kill_process};
use serde_json::json;
use std::io::{BufRead, BufReader, Read, Write};
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::process::{Child, Stdio};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

/// A line with two boards.
const PLANT: &str = "[line.main]\nport = \"PORT\"\n\
    [module.oven]\nline = \"main\"\nmodel = \"erc8\"\naddress = 3\n\
    [module.yard]\nline = \"main\"\nmodel = \"r55\"\naddress = 4\noutputs = 8\n";
/// The expected states of some outputs at the end.
const POLICY: &str = "[module.oven.point]\nk1.on_exit = \"off\"\nk2.on_exit = \"on\"\n\
    [module.yard.point]\nk1.on_exit = \"off\"\nk2.on_exit = \"on\"\n";
/// Only a program that hangs takes this long; by its own clock it has 5 s.
const PATIENCE: Duration = Duration::from_secs(30);

/// The simulator of a plant, which logs every frame.
struct Plant {
    child: Child,
    port: String,
}

impl Plant {
    fn start(folder: &Folder) -> Plant {
        let port = folder.0.join("line").display().to_string();
        let text = PLANT.replace("PORT", &format!("pty:{port}"));
        let file = folder.file("plant.toml", &text);
        let mut child = railbus()
            .args(["sim", "-v"])
            .arg(file)
            .stdin(Stdio::piped())
            .stdout(std::fs::File::create(folder.0.join("frames")).expect("a file"))
            .spawn()
            .expect("railbus starts");
        while !Path::new(&port).exists() {
            assert!(child.try_wait().expect("ours").is_none(), "it ended");
            std::thread::sleep(Duration::from_millis(20));
        }
        Plant { child, port }
    }

    /// Stops it, and returns what the host has sent.
    fn frames(mut self, folder: &Folder) -> Vec<Vec<u8>> {
        kill_process(Pid::from_child(&self.child), Signal::TERM).expect("it runs");
        self.child.wait().expect("it ends");
        let file = std::fs::File::open(folder.0.join("frames")).expect("a file");
        let lines = BufReader::new(file).lines().map(|line| line.expect("text"));
        let sent = lines.filter_map(|line| {
            let mut words = line.split_whitespace().skip(2);
            let sends = (words.next(), words.next()) == (Some("host"), Some("sends"));
            let byte = |word| u8::from_str_radix(word, 16).expect("a byte");
            sends.then(|| words.map(byte).collect())
        });
        sent.collect()
    }
}

impl Drop for Plant {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The checksum of Modbus RTU [Modbus over serial line, 6.2.2].
fn crc(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0xFFFF, |crc, byte| {
        (0..8).fold(crc ^ u16::from(*byte), |crc: u16, _| match crc & 1 {
            1 => crc >> 1 ^ 0xA001,
            _ => crc >> 1,
        })
    })
}

/// Whether a frame has its checksum: that of Modbus RTU, or that of the boards that begin with
/// 55h.
fn is_whole(frame: &[u8]) -> bool {
    match frame {
        [0x55, body @ .., sum] if frame.len() == 8 => {
            body.iter()
                .fold(0x55_u8, |all, byte| all.wrapping_add(*byte))
                == *sum
        }
        [body @ .., low, high] => crc(body) == u16::from_le_bytes([*low, *high]),
        _ => false,
    }
}

/// Switches an output back and forth until there is no answer any more.
fn load(socket: &Path, output: &str, done: &AtomicUsize, over: &AtomicBool) {
    let mut value = false;
    while !over.load(Ordering::Relaxed) {
        value = !value;
        let body = json!({ "value": value }).to_string();
        let Ok(mut stream) = UnixStream::connect(socket) else {
            return;
        };
        let length = body.len();
        let _ = write!(
            stream,
            "PUT /api/v1/points/{output} HTTP/1.1\r\nHost: any\r\nConnection: close\r\n\
             Content-Length: {length}\r\n\r\n{body}"
        );
        let mut answer = String::new();
        let _ = stream.read_to_string(&mut answer);
        done.fetch_add(usize::from(answer.contains("readback")), Ordering::Relaxed);
    }
}

/// Stops it under load.
fn end_under_load(daemon: &mut Daemon) {
    let socket = daemon.folder.0.join("socket");
    let (done, over) = (AtomicUsize::new(0), AtomicBool::new(false));
    std::thread::scope(|scope| {
        for output in [
            "oven/k5", "oven/k6", "oven/k1", "yard/k5", "yard/k6", "yard/k1",
        ] {
            let (socket, done, over) = (&socket, &done, &over);
            scope.spawn(move || load(socket, output, done, over));
        }
        daemon.until("commands", |_| done.load(Ordering::Relaxed) > 12);
        end(daemon);
        over.store(true, Ordering::Relaxed);
    });
}

/// The outputs of a plant, as its modules say now.
fn outputs(plant: &Plant, folder: &Folder, of: &str) -> String {
    let text = PLANT.replace("PORT", &plant.port);
    let file = folder.file("plain.toml", &text);
    let output = railbus()
        .arg("--config")
        .arg(file)
        .args(["--direct", "get", of, "-o", "value"])
        .output()
        .expect("it runs");
    String::from_utf8(output.stdout)
        .expect("text")
        .trim()
        .to_owned()
}

/// Sends SIGTERM, and waits for its end. If it takes longer than allowed, it reports that, and its
/// exit code is not that of success.
fn end(daemon: &mut Daemon) {
    let pid = Pid::from_child(&daemon.child);
    kill_process(pid, Signal::TERM).expect("it runs");
    let begun = Instant::now();
    let status = loop {
        if let Some(status) = daemon.child.try_wait().expect("ours") {
            break status;
        }
        assert!(begun.elapsed() < PATIENCE, "it runs on");
        std::thread::sleep(Duration::from_millis(5));
    };
    let told = std::fs::read_to_string(daemon.folder.0.join("stderr")).unwrap_or_default();
    assert!(status.success(), "{status}: {told}");
}

/// A client that is connected and sends nothing more.
fn hanging(daemon: &Daemon, said: &str) -> UnixStream {
    let mut stream = UnixStream::connect(daemon.folder.0.join("socket")).expect("it listens");
    stream.write_all(said.as_bytes()).expect("it takes bytes");
    stream
}

/// Modules and receivers that never answer, and clients that never disconnect.
#[test]
fn nothing_that_hangs_holds_up_the_end() {
    let folder = Folder::new("hangs");
    let plant = Plant::start(&folder);
    let deaf = std::net::TcpListener::bind("127.0.0.1:0").expect("a place");
    let url = format!("http://{}/", deaf.local_addr().expect("a place"));
    // `dead` is on the line of the daemon, and not on that of the plant.
    let site = format!(
        "{}{POLICY}[module.dead]\nline = \"main\"\nmodel = \"erc8\"\naddress = 9\n\
         [module.dead.point]\nk1.on_exit = \"off\"\nk2.on_exit = \"on\"\n\
         [webhook.deaf]\nurl = \"{url}\"\nevents = [\"write\"]\n",
        PLANT.replace("PORT", &plant.port)
    );
    let file = folder.file("railbus.toml", &site);
    let other = Folder::new("hangs-daemon");
    let mut daemon = Daemon::start_in(other, &["--config", file.to_str().expect("text")]);
    daemon.until("good", |daemon| daemon.quality("oven.k1") == "good");
    // One pulse that runs, and one whose end can't be read back.
    let pulse = r#"{"ms":600000,"by":"host"}"#;
    let pulses = ["oven", "dead"].map(|module| {
        let path = format!("/api/v1/points/{module}/k4/pulse");
        let length = pulse.len();
        let head = format!("POST {path} HTTP/1.1\r\nHost: any\r\nContent-Length: {length}\r\n");
        hanging(&daemon, &format!("{head}\r\n{pulse}"))
    });
    daemon.until("a pulse", |daemon| {
        daemon.get("/points/oven/k4")["value"] == true
    });
    let key = "Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n";
    let upgrade = format!(
        "GET /api/v1/ws HTTP/1.1\r\nHost: any\r\nConnection: Upgrade\r\n\
         Upgrade: websocket\r\n{key}\r\n"
    );
    let body = r#"{"value":true}"#;
    let write = format!(
        "PUT /api/v1/points/dead/k3 HTTP/1.1\r\nHost: any\r\nContent-Length: {}\r\n\r\n{body}",
        body.len()
    );
    let _open: Vec<UnixStream> = [
        upgrade.as_str(),
        upgrade.as_str(),
        "GET /api/v1/watch HTTP/1.1\r\nHost: any\r\n\r\n",
        "GET /api/v1/points HTTP/1.1\r\nHost:",
        "PUT /api/v1/points/oven/k5 HTTP/1.1\r\nHost: any\r\nContent-Length: 60\r\n\r\n{",
        &write,
    ]
    .map(|said| hanging(&daemon, said))
    .into();
    let (caught, _) = deaf.accept().expect("it tells what happened");
    end(&mut daemon);
    drop((caught, pulses));
    let of = ["k1", "k2", "k4"].map(|k| outputs(&plant, &folder, &format!("oven.{k}")));
    assert_eq!(of, ["off", "on", "off"], "off, on, and released");
}

#[test]
fn told_to_end_under_load_it_ends_in_time_with_frames_whole_and_outputs_as_said() {
    let folder = Folder::new("ends");
    let plant = Plant::start(&folder);
    let site = format!("{}{POLICY}", PLANT.replace("PORT", &plant.port));
    let file = folder.file("railbus.toml", &site);
    let other = Folder::new("ends-daemon");
    let mut daemon = Daemon::start_in(other, &["--config", file.to_str().expect("text")]);
    daemon.until("good", |daemon| daemon.quality("oven.k1") == "good");
    daemon.until("good", |daemon| daemon.quality("yard.k1") == "good");
    let held = json!({"value": true});
    for path in ["/points/oven/k3", "/points/yard/k3"] {
        assert_eq!(daemon.send("PUT", path, &held).status, 200);
    }
    end_under_load(&mut daemon);

    for module in ["oven", "yard"] {
        let of = ["k1", "k2", "k3"].map(|k| outputs(&plant, &folder, &format!("{module}.{k}")));
        assert_eq!(of, ["off", "on", "on"], "{module}: off, on, and held");
    }
    let frames = plant.frames(&folder);
    assert!(frames.len() > 20, "{} frames", frames.len());
    for frame in &frames {
        assert!(is_whole(frame), "{frame:02X?}");
    }
}

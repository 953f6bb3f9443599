//! Listening to lines, and files of what was received.

use crate::published::{keeps_to, schema};
use crate::site::{Ran, Site};
use railbus_sniff::capture;
use railbus_wire::{Instant, SerialSettings, crc16};
use rustix::fd::OwnedFd;
use rustix::fs::{Mode, OFlags};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::tcgetattr;
use std::io::{BufRead, BufReader, Read};
use std::path::PathBuf;
use std::process::{Child, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

fn rtu(head: &[u8]) -> Vec<u8> {
    let mut frame = head.to_vec();
    frame.extend(crc16(head).to_le_bytes());
    frame
}

/// A line with four protocols and many faults: gaps in microseconds, and frames.
pub(crate) fn faulty() -> Vec<(u64, Vec<u8>)> {
    let read = rtu(&[0x03, 0x01, 0x00, 0x3C, 0x00, 0x08]);
    let write = rtu(&[0x03, 0x05, 0x00, 0x3C, 0xFF, 0x00]);
    vec![
        (0, b"$016\r".to_vec()),
        (11_800, b"!030200\r".to_vec()),
        (14_000, read.clone()),
        (12_400, rtu(&[0x03, 0x01, 0x01, 0x05])),
        (15_100, vec![0x55, 0x04, 0x10, 0, 0, 0, 0, 0x69]),
        (17_500, vec![0x22, 0x04, 0x10, 0, 0, 0, 5, 0x3B]),
        (10_900, vec![0x4C, 0x57, 0x02, 0x03, 0x05, 0x0D]),
        (400_000, vec![0xFE, 0x00, 0xF8, 0x80, 0x11, 0x00]),
        (20_000, write.clone()),
        (9_000, write),
        (20_000, read.clone()),
        (12_000, vec![0x03, 0x01, 0x01, 0x05, 0x90, 0x34]),
        (20_000, read),
        (12_000, rtu(&[0x03, 0x81, 0x02])),
        (30_000, vec![0x55, 0x01, 0x00, 0x03, 0x00, 0x04, 0xC0, 0x1D]),
        (30_000, b"#01\r".to_vec()),
        (30_000, vec![0x4C, 0x57, 0x02, 0x03, 0x06, 0x0D]),
        (20_000, rtu(&[0x01, 0x42, 0x0E, 0x01, 0x00])),
        (30_000, b"$016BB\r".to_vec()),
        (12_000, b"!030200\r".to_vec()),
        (30_000, vec![0x22, 0x04, 0x10, 0x00]),
    ]
}

/// The faulty line in a file, as another program might have written it: without comments.
pub(crate) fn captured(site: &Site) -> PathBuf {
    let mut file = capture::header("somebody");
    file.extend(capture::interface("main", "9600 8N1"));
    let mut at = Instant(1_795_269_787_000_000);
    for (gap, frame) in faulty() {
        at = Instant(at.0 + gap);
        file.extend(capture::packet(0, at, &frame, None, ""));
        at = at + SerialSettings::FACTORY.frame_time(frame.len());
    }
    let path = site.folder.join("line.pcapng");
    std::fs::write(&path, file).expect("a file");
    path
}

const SHOWN: &str = include_str!("faulty.txt");

fn read(site: &Site, more: &[&str]) -> Ran {
    let path = captured(site).display().to_string();
    let arguments: Vec<&str> = ["sniff", "--read", &path]
        .into_iter()
        .chain(more.iter().copied())
        .collect();
    site.run_with(&arguments, "")
}

#[test]
fn a_faulty_line_is_told_frame_by_frame_in_both_languages() {
    let site = Site::empty("sniff-read");
    let en = read(&site, &[]);
    assert_eq!((en.code, en.out.as_str()), (0, SHOWN), "{en:?}");
    let summary = "21 frames, 7 exchanges, 2 unanswered, 5 bad; line busy 16.4 %; \
                   slowest reply: address 4, 17.5 ms\n";
    assert_eq!(en.err, summary);
    let zh = read(&site, &["--lang", "zh"]);
    let lines: Vec<&str> = zh.out.lines().collect();
    assert_eq!(lines.len(), SHOWN.lines().count());
    assert!(
        lines[0].starts_with("时间          间隔 ms  方向  协议"),
        "{}",
        lines[0]
    );
    assert!(lines[8].ends_with("300.0 毫秒内无应答"), "{}", lines[8]);
    assert!(
        lines[13].contains("校验和 90 34 错误，应为 90 33"),
        "{}",
        lines[13]
    );
    assert!(
        lines[16].contains("；或 r55：未知功能码 00h"),
        "{}",
        lines[16]
    );
    let summary = "21 条报文，7 次交换，2 次无应答，5 条损坏；总线占用 16.4 %；\
                   最慢应答：地址 4，17.5 毫秒\n";
    assert_eq!(zh.err, summary);
}

#[test]
fn filters_choose_and_programs_read_it() {
    let site = Site::empty("sniff-filter");
    let bad = read(
        &site,
        &["--filter", "proto=rtu and (bad or refused)", "-o", "ndjson"],
    );
    let rows: Vec<serde_json::Value> = bad
        .out
        .lines()
        .map(|line| serde_json::from_str(line).expect("JSON"))
        .collect();
    assert_eq!(rows.len(), 2, "{bad:?}");
    assert_eq!(rows[0]["schema"], 1);
    assert_eq!(rows[0]["verdict"], "bad checksum");
    assert_eq!(rows[0]["asked"], "03 01 00 3C 00 08 FC 22");
    assert_eq!(rows[0]["readings"][0]["role"], "reply");
    assert_eq!(rows[0]["time"], "2026-11-21T14:03:07.624Z");
    assert_eq!(rows[1]["verdict"], "refused");
    assert_eq!(bad.err, "");
    let csv = read(&site, &["--filter", "ambiguous", "-o", "csv"]).out;
    let told = "time,line,gap_ms,role,protocol,address,verdict,meaning,bytes\n\
        2026-11-21T14:03:07.706Z,main,30.0,request,rtu,85,ok,\
        read 4 coils from 3; or r55: unknown function 00h,55 01 00 03 00 04 C0 1D\n";
    assert_eq!(csv, told);
    let value = read(&site, &["--filter", "write", "--count", "1", "-o", "value"]).out;
    assert_eq!(value, "03 05 00 3C FF 00 4D D4\n");
    let slow = read(&site, &["--filter", "slow>17ms", "-o", "value"]).out;
    assert_eq!(slow, "22 04 10 00 00 00 05 3B\n");
    let wrong = read(&site, &["--filter", "addr=3 bad", "-o", "json"]);
    assert_eq!(wrong.code, 2);
    assert_eq!(wrong.error()["code"], "E0280");
    let message = wrong.error()["message"].as_str().map(str::to_owned);
    let said = "the filter, character 8 \"bad\": expected \"and\" or \"or\"";
    assert_eq!(message.as_deref(), Some(said));
    let zh = read(&site, &["--filter", "addr=", "--lang", "zh"]);
    assert!(zh.err.contains("过滤条件第 6 个字符"), "{zh:?}");
}

#[test]
fn decode_reads_files_as_well() {
    let site = Site::empty("sniff-decode");
    let path = captured(&site).display().to_string();
    let all = site.run(&format!("decode -f {path}"));
    assert_eq!(
        (all.code, all.out.as_str(), all.err.as_str()),
        (0, SHOWN, "")
    );
    let late = ["decode", "-f", &path, "--filter", "missing", "-o", "ndjson"];
    let rows = site.run_with(&late, "").out;
    assert_eq!(rows.lines().count(), 2, "{rows}");
    assert_eq!(site.run(&format!("decode 00 -f {path}")).code, 2);
}

#[test]
fn modules_of_the_configuration_have_their_names() {
    let site = Site::demo("sniff-names");
    let pump = read(
        &site,
        &[
            "--filter",
            "module=pump and reply",
            "-o",
            "ndjson",
            "--count",
            "1",
        ],
    );
    let row: serde_json::Value = serde_json::from_str(pump.out.trim()).expect("JSON");
    assert_eq!(
        (row["module"].as_str(), row["bytes"].as_str()),
        (Some("pump"), Some("21 30 33 30 32 30 30 0D"))
    );
}

#[test]
fn what_was_written_is_read_as_the_same() {
    let site = Site::empty("sniff-write");
    let again = site.folder.join("again.pcapng").display().to_string();
    let first = read(&site, &["--write", &again]);
    assert_eq!(first.code, 0, "{first:?}");
    let second = site.run(&format!("sniff --read {again}"));
    assert_eq!(second.out, SHOWN);
    let twice = read(&site, &["--write", &again]);
    assert_eq!(twice.code, 1);
    assert!(twice.err.starts_with("error[E0181]"), "{twice:?}");
}

#[test]
fn what_is_no_capture_is_told_so() {
    let site = Site::empty("sniff-broken");
    let whole = std::fs::read(captured(&site)).expect("it is there");
    let cut = site.folder.join("cut.pcapng");
    std::fs::write(&cut, &whole[..whole.len() - 3]).expect("a file");
    let ran = site.run("sniff --read cut.pcapng");
    assert_eq!(ran.code, 1);
    assert!(
        ran.err.contains("it ends in the middle of a block"),
        "{ran:?}"
    );
    assert!(
        ran.out.lines().count() > 20,
        "what stands before it is shown: {ran:?}"
    );
    std::fs::write(&cut, b"no capture at all").expect("a file");
    let ran = site.run("sniff --read cut.pcapng --lang zh");
    assert!(ran.err.contains("字节 0 处：不是 pcapng 文件"), "{ran:?}");
    assert_eq!(
        site.run("sniff --read none.pcapng -o json").error()["code"],
        "E0180"
    );
}

/// The far end of a line that is listened to.
pub(crate) struct Wire {
    pub(crate) master: OwnedFd,
    /// Held open so that the master does not get a hang-up.
    _slave: OwnedFd,
    pub(crate) name: String,
}

impl Wire {
    pub(crate) fn new() -> Wire {
        let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).expect("a PTY");
        grantpt(&master).expect("it may be opened");
        unlockpt(&master).expect("it may be opened");
        let path = ptsname(&master, Vec::new()).expect("it has a name");
        let slave = rustix::fs::open(&path, OFlags::RDWR | OFlags::NOCTTY, Mode::empty());
        Wire {
            master,
            _slave: slave.expect("it opens"),
            name: format!("pty:{}", path.to_str().expect("text")),
        }
    }

    pub(crate) fn say(&self, bytes: &[u8]) {
        rustix::io::write(&self.master, bytes).expect("it takes it");
    }
}

/// The program at work, once it has said the word on standard error.
pub(crate) fn listening(
    site: &Site,
    arguments: &[&str],
    word: &str,
) -> (Child, std::thread::JoinHandle<String>) {
    let mut child = site
        .command()
        .args(arguments)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("railbus starts");
    let mut said = BufReader::new(child.stderr.take().expect("it is piped"));
    let mut line = String::new();
    while !line.contains(word) {
        line.clear();
        assert_ne!(said.read_line(&mut line).expect("text"), 0, "it ended");
    }
    let rest = std::thread::spawn(move || {
        let mut rest = String::new();
        let _ = said.read_to_string(&mut rest);
        rest
    });
    (child, rest)
}

#[test]
fn a_live_line_is_listened_to_and_never_spoken_on() {
    let site = Site::empty("sniff-live");
    let wire = Wire::new();
    let arguments = ["sniff", "-l", &wire.name, "--count", "4", "-o", "value"];
    let (child, _) = listening(&site, &arguments, "listening only, never sending");
    for (_, frame) in &faulty()[..4] {
        wire.say(frame);
        std::thread::sleep(Duration::from_millis(30));
    }
    let ended = child.wait_with_output().expect("it ends");
    let out = String::from_utf8(ended.stdout).expect("text");
    let expected = "24 30 31 36 0D\n21 30 33 30 32 30 30 0D\n\
                    03 01 00 3C 00 08 FC 22\n03 01 01 05 90 33\n";
    assert_eq!((ended.status.code(), out.as_str()), (Some(0), expected));
    rustix::io::ioctl_fionbio(&wire.master, true).expect("it can");
    let mut sent = [0; 16];
    let read = rustix::io::read(&wire.master, &mut sent);
    assert_eq!(
        read.err(),
        Some(rustix::io::Errno::AGAIN),
        "nothing was sent"
    );
}

#[test]
fn the_speed_of_a_line_is_found_by_listening() {
    let site = Site::empty("sniff-auto");
    let wire = Arc::new(Wire::new());
    let stop = Arc::new(AtomicBool::new(false));
    let (talker, ended) = (Arc::clone(&wire), Arc::clone(&stop));
    let talk = std::thread::spawn(move || {
        let frames = faulty();
        while !ended.load(Ordering::Relaxed) {
            let speed = tcgetattr(&talker.master)
                .expect("a terminal")
                .output_speed();
            for (_, frame) in &frames[..6] {
                // At another speed a receiver sees other bits.
                let heard: Vec<u8> = match speed {
                    19_200 => frame.clone(),
                    _ => frame
                        .iter()
                        .map(|byte| byte.rotate_left(3) ^ 0xA6)
                        .collect(),
                };
                talker.say(&heard);
                std::thread::sleep(Duration::from_millis(25));
            }
        }
    });
    let ran = site.run(&format!(
        "sniff -l {} --auto-baud --count 3 -o value",
        wire.name
    ));
    let json = site.run(&format!(
        "sniff -l {} --auto-baud --count 1 -o ndjson",
        wire.name
    ));
    stop.store(true, Ordering::Relaxed);
    talk.join().expect("it ends");
    assert_eq!(ran.code, 0, "{ran:?}");
    assert!(ran.err.starts_with("19200 8N1 found after "), "{ran:?}");
    assert!(ran.err.contains("sure"), "{ran:?}");
    let told: serde_json::Value =
        serde_json::from_str(json.err.lines().next().unwrap_or_default()).expect("JSON");
    assert_eq!(
        (told["baud"].as_u64(), told["sure"].as_bool()),
        (Some(19_200), Some(true))
    );
    // Its findings are reported with the frames, and published with them.
    assert!(schema(&site, "sniff").is_valid(&told), "{told}");
}

#[test]
fn a_line_of_the_daemon_is_looked_at_without_touching_it() {
    let site = Site::served("sniff-tap");
    let socket = site.socket();
    let tap = ["--socket", &socket, "--count", "40", "-o", "ndjson"];
    let arguments: Vec<&str> = ["sniff"].into_iter().chain(tap).collect();
    let ran = site.run_with(&arguments, "");
    assert_eq!(ran.code, 0, "{ran:?}");
    let said = "listening to line main through the daemon; the line is not affected";
    assert_eq!(ran.err.trim(), said);
    let rows = keeps_to(&site, "sniff", &ran);
    let replies: Vec<_> = rows.iter().filter(|row| row["role"] == "reply").collect();
    assert!(replies.len() > 5, "{ran:?}");
    // A busy machine may delay a simulated module in the middle of a frame: that is reported.
    let whole: Vec<_> = replies
        .iter()
        .filter(|reply| reply["verdict"] == "ok")
        .collect();
    assert!(2 * whole.len() > replies.len(), "{ran:?}");
    for reply in &whole {
        assert!(
            reply["module"].is_string() && reply["asked"].is_string(),
            "{reply}"
        );
    }
    // Its own messages are reported as well; a line that it does not have is not.
    let zh = site.run(&format!("sniff --socket {socket} --count 1 --lang zh"));
    assert!(zh.err.contains("不影响总线"), "{zh:?}");
    let none = site.run(&format!("sniff --socket {socket} -l attic"));
    assert_eq!(none.code, 8, "{none:?}");
}

#[test]
fn a_command_shows_its_exchanges_and_its_frames() {
    let site = Site::demo("sniff-verbose");
    let words = |text: &str| {
        let lines = text.lines().map(|line| {
            let cells: Vec<&str> = line.split_whitespace().skip(1).collect();
            cells.join(" ")
        });
        lines.collect::<Vec<_>>()
    };
    let once = site.run("set oven.k1 on -v -q");
    let told = words(&once.err);
    assert_eq!(once.code, 0, "{once:?}");
    let write = told
        .iter()
        .find_map(|line| line.strip_prefix("main rtu 3 coil 60 on → "));
    let write = write.expect("the command");
    // The simulator of a busy machine may be late.
    let late = write.starts_with("no reply in ");
    assert!(
        late || write.starts_with("acknowledged: coil 60 on"),
        "{once:?}"
    );
    let last = told.last().expect("the read-back");
    let read = last.strip_prefix("main rtu 3 read 8 coils from 60 → ");
    assert!(late || read.is_some(), "{once:?}");
    assert!(last.contains("states 1"), "{once:?}");
    let twice = site.run("get oven.k1 -vv --log-file log --lang zh");
    assert_eq!(twice.err, "", "{twice:?}");
    let log = std::fs::read_to_string(site.folder.join("log")).expect("it was written");
    let told = words(&log);
    assert_eq!(told.len(), 2, "{log}");
    assert_eq!(
        told[0],
        "→ rtu 3 读取 8 个线圈，自 60 03 01 00 3C 00 08 FC 22"
    );
    assert!(told[1].contains("← rtu 3 状态 1"), "{log}");
    let through = Site::served("sniff-verbose-daemon");
    let socket = through.socket();
    let get = through.run(&format!(
        "get tank.ai1 --fresh -v --socket {socket} -o value"
    ));
    assert!(get.err.contains("main  rtu "), "{get:?}");
    let full = site.run("get oven.k1 -v --log-file none/log");
    assert_eq!(full.code, 1, "{full:?}");
    assert!(full.err.starts_with("error[E0102]"), "{full:?}");
}

#[test]
fn a_frame_of_ones_own_that_hides_a_command_is_asked_about() {
    let site = Site::empty("raw-stowaway");
    // Four registers whose values are the frame that switches a board's first relay on.
    let hidden = "raw 01 10 00 00 00 04 08 55 04 12 00 00 00 01 6C --crc -l pty:/tmp/none -o json";
    let ran = site.run(hidden);
    assert_eq!(ran.error()["code"], "E0202", "{ran:?}");
    let why = ran.error()["why"].to_string();
    assert!(why.contains("a complete command of r55"), "{why}");
}

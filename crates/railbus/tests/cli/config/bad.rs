//! Modules that do not follow their settings, and a program that is killed.

use super::{fails, journal, toml};
use crate::site::Site;

/// An EMD-2A2Q with faults on its own pseudo-terminal: `reply` gets each request and the eight
/// registers.
fn emd(reply: impl Fn(&[u8; 8], &[u8]) -> Vec<u8> + Send + 'static) -> String {
    let registers = [0, 12, 0, 1, 0, 2, 0, 0, 1, 0xF4, 0, 0, 0, 100, 0, 200];
    crate::liar::liar(move |request| reply(request, &registers))
}

fn framed(mut bytes: Vec<u8>) -> Vec<u8> {
    bytes.extend(railbus_wire::crc16(&bytes).to_le_bytes());
    bytes
}

/// The replies of such a module to reads: its registers and coils, and an exception beyond them.
fn read(request: &[u8; 8], registers: &[u8]) -> Vec<u8> {
    let first = u16::from_be_bytes([request[2], request[3]]);
    let end = first + u16::from_be_bytes([request[4], request[5]]);
    framed(match (request[1], first, end) {
        (3, 0, 8) => [&[1, 3, 16], registers].concat(),
        (1, 8.., ..=10) => vec![1, 1, 1, 0],
        (function, ..) => vec![1, function | 0x80, 2],
    })
}

#[test]
fn modules_that_refuse_ignore_or_vanish() {
    let site = Site::empty("config-liars");
    let set = |port: &str| {
        let flags = format!("-l pty:{port} -m emd2a2q -a 1");
        site.run(&format!(
            "{flags} config set calibration_voltage=4V --yes --state state"
        ))
    };
    let journal = || {
        let text = std::fs::read_to_string(site.folder.join("state/journal.jsonl"));
        text.unwrap_or_default()
    };
    let last = || {
        let last = journal()
            .lines()
            .last()
            .map(str::to_owned)
            .unwrap_or_default();
        let record: serde_json::Value = serde_json::from_str(&last).expect("a record");
        record["state"].as_str().unwrap_or_default().to_owned()
    };
    // Noise, or two replies at once.
    let ran = set(&emd(|_, _| vec![0xFF; 6]));
    fails(&ran, "E0540", 5);
    assert_eq!(journal(), "");
    let port = emd(|_, _| vec![0xFF; 6]);
    let recover = "config recover emd2a2q --state state";
    let ran = site.run(&format!("-l pty:{port} -m emd2a2q -a 1 {recover}"));
    fails(&ran, "E0540", 5);
    let told = "to separate two modules: unplug one; railbus config set emd2a2q address=FREE";
    assert!(ran.err.contains(told), "{ran:?}");
    // It refuses.
    let ran = set(&emd(move |request, registers| match request[1] {
        6 => framed(vec![1, 0x86, 3]),
        _ => read(request, registers),
    }));
    fails(&ran, "E0441", 4);
    assert!(ran.err.contains("illegal data value"), "{ran:?}");
    assert_eq!(last(), "unchanged");
    // It acknowledges and does nothing.
    let ran = set(&emd(move |request, registers| match request[1] {
        6 => request.to_vec(),
        _ => read(request, registers),
    }));
    fails(&ran, "E0640", 6);
    assert_eq!(last(), "unchanged");
    // It is gone after the write.
    let gone = std::sync::atomic::AtomicBool::new(false);
    let ran = set(&emd(move |request, registers| {
        let order = std::sync::atomic::Ordering::Relaxed;
        gone.fetch_or(request[1] == 6, order);
        match request[1] {
            _ if gone.load(order) => Vec::new(),
            _ => read(request, registers),
        }
    }));
    fails(&ran, "E0340", 3);
    assert_eq!(last(), "lost");
    // The journal's folder can't be created: nothing is written.
    std::fs::write(site.folder.join("blocked"), "").expect("a file");
    let port = emd(move |request, registers| match request[1] {
        6 => panic!("written without a journal"),
        _ => read(request, registers),
    });
    let flags = format!("-l pty:{port} -m emd2a2q -a 1");
    let set = "config set calibration_voltage=4V --yes --state blocked";
    let ran = site.run(&format!("{flags} {set}"));
    fails(&ran, "E0140", 1);
}

/// Ctrl-C while a board is waited for: it is unchanged, and the journal says so.
#[test]
fn a_board_that_is_waited_for_may_be_left_alone() {
    use std::io::BufRead;
    let site = Site::demo("config-board");
    // The board was just powered: for ten seconds it accepts an address.
    let ran = site.run("-q config set yard address=9 --yes");
    assert_eq!(ran.code, 0, "{ran:?}");
    assert!(toml(&site).contains("address = 9"));
    assert_eq!(site.run("get yard.k1 -o value").out, "off\n");
    std::thread::sleep(std::time::Duration::from_secs(11));
    let mut child = site
        .command()
        .args(["config", "set", "yard", "address=6", "--yes"])
        .stderr(std::process::Stdio::piped())
        .spawn()
        .expect("railbus starts");
    let mut lines = std::io::BufReader::new(child.stderr.take().expect("piped")).lines();
    assert!(lines.any(|line| line.is_ok_and(|line| line.contains("power-cycle the board"))));
    crate::site::signal(&child, rustix::process::Signal::INT);
    let rest: Vec<String> = lines.map_while(Result::ok).collect();
    assert_eq!(child.wait().expect("it ends").code(), Some(130), "{rest:?}");
    assert!(
        journal(&site)
            .lines()
            .last()
            .is_some_and(|last| last.contains("\"unchanged\""))
    );
    assert!(toml(&site).contains("address = 9"));
}

/// The program is killed at different moments. A recovery finds the module each time, and the
/// configuration has its address.
#[test]
fn killed_at_any_moment_it_is_recovered() {
    let site = Site::demo("config-killed");
    let mut moved = 0;
    for (round, millis) in (0..).zip([200, 1_200, 1_900, 2_200, 2_500, 2_800, 3_100, 15_000]) {
        let address = format!("address={}", 7 + round % 2);
        let mut child = site
            .command()
            .args(["-q", "config", "set", "oven", &address, "--yes"])
            .stdout(std::process::Stdio::null())
            .stderr(std::process::Stdio::null())
            .spawn()
            .expect("railbus starts");
        std::thread::sleep(std::time::Duration::from_millis(millis));
        child.kill().expect("it is ours");
        child.wait().expect("it ends");
        let ran = site.run("-q config recover");
        assert_eq!(ran.code, 0, "after {millis} ms: {ran:?}");
        let shown = site.run("-q config get oven address -o value");
        assert_eq!(shown.code, 0, "after {millis} ms: {shown:?}");
        let said = format!("address = {}\n", shown.out.trim());
        assert!(
            toml(&site).contains(&said),
            "after {millis} ms: {}",
            toml(&site)
        );
        moved += usize::from(shown.out.trim() == address.trim_start_matches("address="));
        let log = site.run("config log -o json").json();
        for change in log["changes"].as_array().expect("a list") {
            let state = change["state"].as_str().unwrap_or_default();
            let known = ["done", "filed", "unchanged"].contains(&state);
            assert!(known, "after {millis} ms: {change}");
        }
    }
    assert!(
        moved > 0,
        "it was always killed before anything was written"
    );
}

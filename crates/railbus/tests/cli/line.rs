//! Commands on the demo line, opened here and through the daemon.

use crate::dead::plant;
use crate::site::{Ran, Site, signal};
use rustix::process::Signal;
use std::io::{BufRead, BufReader, Read};
use std::process::Stdio;

/// A number followed by its unit varies from run to run.
fn masked(text: &str) -> String {
    text.split_inclusive('\n').map(masked_line).collect()
}

fn masked_line(line: &str) -> String {
    let words: Vec<&str> = line.split(' ').collect();
    let is_unit = |word: &&str| matches!(word.trim_end(), "ms" | "s" | "毫秒" | "秒");
    let each = words.iter().enumerate().map(|(at, word)| {
        let measured = word.parse::<f64>().is_ok() && words.get(at + 1).is_some_and(is_unit);
        if measured { "#" } else { *word }
    });
    each.collect::<Vec<_>>().join(" ")
}

#[track_caller]
fn prints(ran: &Ran, text: &str) {
    assert_eq!((ran.code, masked(&ran.out).as_str()), (0, text), "{ran:?}");
}

fn daily(run: &dyn Fn(&str) -> Ran) {
    let ls = run("ls");
    assert_eq!(ls.code, 0, "{ls:?}");
    let pump = ls
        .out
        .lines()
        .find(|line| line.starts_with("pump"))
        .expect("pump");
    let cells: Vec<&str> = pump.split_whitespace().collect();
    assert_eq!(
        cells[1..7],
        ["main", "1", "(01h)", "ascii", "EDA9060A", "online"]
    );
    prints(
        &run("set pump.do0 on"),
        "pump.do0  off → on  read back  # ms\n",
    );
    prints(&run("get pump.do0 -o value"), "on\n");
    let zh = run("get pump.do0 --lang zh --fresh").out;
    assert!(zh.starts_with("pump.do0  接通"), "{zh}");
    prints(
        &run("set pump.do0 off --lang zh"),
        "pump.do0  接通 → 断开  已回读  # 毫秒\n",
    );
    let misspelt = run("get pmup");
    assert!(misspelt.err.contains("did you mean pump?"), "{misspelt:?}");
    let far = run("get nosuch");
    assert!(
        far.code == 8 && !far.err.contains("did you mean"),
        "{far:?}"
    );
    assert_eq!(run("set yard 5-6=ON k5-6=off").code, 0);
    prints(
        &run("set yard 1,3=on"),
        "yard.k1  off → on  read back  # ms\nyard.k3  off → on  read back  # ms\n",
    );
    let set = run("set oven k1=on k2=off k5=toggle -o json").json();
    assert_eq!(set["schema"], 1);
    assert_eq!(set["set"][2]["path"], "oven.k5");
    assert_eq!(set["set"][2]["value"], true);
    assert_eq!(set["set"][0]["confirmed"], "readback");
    assert_eq!(run("set oven all=off -q").out, "");
    let pulse = run("pulse yard.k2 300ms -o json").json();
    assert_eq!(pulse["by"], "device", "{pulse}");
    let raw = run("raw --ascii $01M -o json").json();
    assert_eq!(raw["bytes"], "21 30 31 39 30 36 30 0D");
    for quiet in ["", " -q", " -v"] {
        let points = run(&format!("get *.di* tank -o json{quiet}")).json();
        assert_eq!(
            points["points"].as_array().expect("points").len(),
            15,
            "{points}"
        );
    }
}

#[test]
fn daily_work_on_a_line_of_ones_own() {
    let site = Site::demo("daily");
    daily(&|line| site.run(line));
    let dry = site.run("set oven all=off -n");
    prints(&dry, "would send  oven  03 0F 00 3C 00 08 01 00 2F 49\n");
    prints(
        &site.run("pulse oven.k1 300ms"),
        "oven.k1  → on  # ms  timed by the host  read back  # ms\n",
    );
    prints(&site.run("get oven.k1"), "oven.k1  off\n");
    let port = format!("-l pty:{}", site.folder.join("line").display());
    prints(
        &site.run(&format!("{port} -m erc8 -a 3 get erc8.k2")),
        "erc8.k2  off\n",
    );
    prints(
        &site.run(&format!("{port} raw --crc 03 01 00 3C 00 08 -o value")),
        "03 01 01 00 50 30\n",
    );
}

#[test]
fn daily_work_through_the_daemon() {
    let site = Site::served("daemon");
    let socket = site.socket();
    // It reads one module after the other.
    let is_heard = |_: &i32| {
        !site
            .run(&format!("--socket {socket} ls"))
            .out
            .contains("not heard")
    };
    assert!((0..200).find(is_heard).is_some(), "all are heard");
    daily(&|line| site.run(&format!("--socket {socket} {line}")));
    // It sends other requests besides its own polls.
    let ran = site.run(&format!(
        "--socket {socket} -o json scan --addr 1-6 --timeout 200ms"
    ));
    let found = ran.json()["found"].as_array().map(Vec::len);
    assert_eq!((ran.code, found), (0, Some(5)), "{ran:?}");
}

#[test]
fn watch_tells_changes_until_nobody_reads_or_it_is_stopped() {
    let site = Site::demo("watch");
    let start = |more: &[&str]| {
        let mut command = site.command();
        command
            .arg("watch")
            .args(more)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped());
        command.spawn().expect("railbus starts")
    };
    let mut child = start(&["tank.ai1", "-o", "ndjson"]);
    let mut lines = BufReader::new(child.stdout.take().expect("it is piped")).lines();
    let first: serde_json::Value =
        serde_json::from_str(&lines.next().expect("a line").expect("text")).expect("JSON");
    assert_eq!(first["schema"], 1);
    lines.next().expect("a change").expect("text");
    drop(lines);
    assert!(
        child.wait().expect("it ends").success(),
        "a broken pipe is no fault"
    );
    let mut complaint = String::new();
    child
        .stderr
        .take()
        .expect("piped")
        .read_to_string(&mut complaint)
        .expect("text");
    assert_eq!(complaint, "");

    let mut child = start(&["--plain"]);
    let mut lines = BufReader::new(child.stdout.take().expect("it is piped")).lines();
    let line = lines.next().expect("a line").expect("text");
    assert_eq!(line.as_bytes()[2], b':', "{line}");
    signal(&child, Signal::INT);
    assert_eq!(child.wait().expect("it ends").code(), Some(130));
    let mut complaint = String::new();
    let mut stderr = child.stderr.take().expect("piped");
    stderr.read_to_string(&mut complaint).expect("text");
    assert_eq!(complaint, "", "it is how one ends it");
}

/// A daemon that is gone is an error, and not the same as no news.
#[test]
fn watch_says_when_the_daemon_is_gone() {
    for end in [Site::stop_first, Site::end_first] {
        watched_until(end);
    }
}

fn watched_until(end: fn(&mut Site)) {
    let mut site = Site::served("watch-gone");
    let socket = site.socket();
    let mut watch = site.command();
    watch.args(["--socket", &socket, "watch", "pump", "-o", "json"]);
    let watch = watch.stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = watch.spawn().expect("railbus starts");
    let mut lines = BufReader::new(child.stdout.take().expect("it is piped")).lines();
    lines.next().expect("a line").expect("text");
    end(&mut site);
    for line in lines {
        line.expect("text");
    }
    let mut told = String::new();
    let mut stderr = child.stderr.take().expect("piped");
    stderr.read_to_string(&mut told).expect("text");
    assert_eq!(child.wait().expect("it ends").code(), Some(1), "{told}");
    assert!(told.contains("E0109"), "{told}");
}

#[test]
fn a_pattern_that_fits_nothing_is_told() {
    let site = Site::demo("nothing");
    for line in ["get x*", "get *.x1 -o json"] {
        let ran = site.run(line);
        assert_eq!((ran.code, ran.out.as_str()), (8, ""), "{line}: {ran:?}");
        assert!(ran.err.contains("E0801"), "{line}: {ran:?}");
    }
}

/// A site can start without a configuration: the message says where its file will be.
#[test]
fn a_daemon_starts_without_a_configuration() {
    let mut site = Site::empty("begin");
    let refused = site.run("-l /dev/none-such serve --listen 127.0.0.1:0");
    assert_eq!(refused.code, 2, "{refused:?}");
    assert!(refused.err.contains("scan --add"), "{refused:?}");
    let socket = site.socket();
    let file = site.folder.join("railbus.toml");
    let named = file.display().to_string();
    site.start(
        &["serve", "--listen", "127.0.0.1:0", "--socket", &socket],
        &named,
    );
    let run = |line: &str| site.run(&format!("--socket {socket} {line}"));
    let mut listed = run("ls lines -o value");
    for _ in 0..200 {
        if listed.code == 0 {
            break;
        }
        std::thread::sleep(std::time::Duration::from_millis(20));
        listed = run("ls lines -o value");
    }
    assert_eq!((listed.code, listed.out.as_str()), (0, ""), "{listed:?}");
    assert!(
        !file.exists(),
        "nothing is written before there is something"
    );
}

/// A state is on or off in every form for people and in tables, of inputs and of outputs.
#[test]
fn a_state_is_said_in_the_same_words_everywhere() {
    // The inputs of the demo change with time; these stay as they are set.
    let mut site = plant("vocabulary", "");
    for order in ["gate.di0 = 1", "pump.di0 = 0"] {
        assert_eq!(site.run_with(&["sim", "ctl", "ctl", order], "").code, 0);
    }
    assert_eq!(site.run("get gate.di0 -o value").out, "on\n");
    let told = site.run("get gate.di0 pump.do0 pump.di0").out;
    let words: Vec<&str> = told
        .lines()
        .filter_map(|line| line.split_whitespace().nth(1))
        .collect();
    assert_eq!(words, ["on", "off", "off"], "{told}");
    let zh = site.run("get gate.di0 --lang zh").out;
    assert!(zh.starts_with("gate.di0  接通"), "{zh}");
    assert_eq!(
        site.run("get gate.di0 -o json").json()["points"][0]["value"],
        true
    );
    assert!(site.run("get gate.di0 -o csv").out.contains(",on,"));
    site.serve();
    let socket = site.socket();
    let mut command = site.command();
    command.args([
        "--socket", &socket, "watch", "gate.di0", "tank.ai1", "-o", "csv",
    ]);
    let mut child = command.stdout(Stdio::piped()).spawn().expect("it starts");
    let lines = BufReader::new(child.stdout.take().expect("it is piped")).lines();
    let mut lines = lines.map(|line| line.expect("text"));
    assert_eq!(
        lines.next().as_deref(),
        Some("time,path,value,quality,unit")
    );
    let input = lines.find(|line| line.contains(",gate.di0,") && line.ends_with(",good,"));
    assert!(input.expect("it is read").contains(",on,"));
    let level = lines.find(|line| line.contains(",tank.ai1,") && line.ends_with(",good,V"));
    let level = level.expect("it is read");
    let value = level.split(',').nth(2).expect("a value");
    assert!(value.parse::<f64>().is_ok(), "{level}");
    child.kill().expect("it runs");
    child.wait().expect("it ends");
}

/// As in the README: a demo in one shell, commands in another, without a flag for where it is.
#[test]
fn a_second_shell_finds_the_daemon() {
    let site = Site::empty("shell");
    let folder = site.folder.join("run");
    let shell = |words: &[&str]| {
        let mut command = site.command();
        command.env("XDG_RUNTIME_DIR", &folder).args(words);
        command.env_remove("RAILBUS_RUN");
        command
    };
    let mut demo = shell(&["serve", "--demo", "--listen", "127.0.0.1:0"])
        .stdout(Stdio::null())
        .spawn()
        .expect("railbus starts");
    let found = (0..100).any(|_| {
        let ran = shell(&["ls", "lines"]).output().expect("railbus runs");
        let found = ran.status.success() && folder.join("railbus.sock").exists();
        if !found {
            std::thread::sleep(std::time::Duration::from_millis(50));
        }
        found
    });
    demo.kill().expect("it runs");
    demo.wait().expect("it ends");
    assert!(found, "the daemon is found without a flag");
}

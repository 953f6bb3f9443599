//! `railbus scan` on the demo line: what it prints, writes, stores, and resumes.

use crate::liar::{liar, slave};
use crate::site::{Ran, Site, signal};
use rustix::process::Signal;
use std::io::{BufRead, BufReader, Read};
use std::process::Stdio;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

/// Columns are as wide as what stands in them, and times differ from run to run.
fn words(line: &str) -> String {
    let words: Vec<&str> = line.split_whitespace().collect();
    let is_unit = |word: &&str| {
        let unit = word.trim_end_matches([';', ',']);
        matches!(unit, "ms" | "s" | "毫秒" | "秒")
    };
    let each = words.iter().enumerate().map(|(at, word)| {
        let measured = word.parse::<f64>().is_ok() && words.get(at + 1).is_some_and(is_unit);
        if measured { "#" } else { *word }
    });
    each.collect::<Vec<_>>().join(" ")
}

#[track_caller]
fn says(text: &str, lines: &[&str]) {
    let said: Vec<String> = text.lines().map(words).collect();
    assert_eq!(said, lines, "{text}");
}

/// The demo line without a configuration.
fn bare(name: &str) -> (Site, String) {
    let site = Site::demo(name);
    std::fs::remove_file(site.folder.join("railbus.toml")).expect("it was there");
    let port = format!("pty:{}", site.folder.join("line").display());
    (site, port)
}

fn models(ran: &Ran) -> Vec<String> {
    let found = ran.json()["found"].clone();
    let told = |m: &serde_json::Value| {
        let told = format!(
            "{} {} {} {}",
            m["addr"], m["proto"], m["model"], m["verdict"]
        );
        told.replace('"', "")
    };
    found.as_array().expect("a list").iter().map(told).collect()
}

const ALL: [&str; 5] = [
    "1 ascii EDA9060A ok",
    "2 lc02 EDA9050 ok",
    "3 rtu ERC-8 ok",
    "4 r55 0x55 board ok",
    "5 rtu EMD-2A2Q ok",
];

#[test]
fn it_is_told_in_both_languages() {
    let (site, port) = bare("scan-words");
    let scan = format!("scan -l {port} --addr 1-6 --timeout 200ms");
    let ran = site.run(&scan);
    assert_eq!(ran.code, 0, "{ran:?}");
    says(
        &ran.out,
        &[
            "ADDR PROTOCOL MODEL DETAIL RTT VERDICT",
            "1 (01h) ascii EDA9060A 4 outputs, 4 inputs, checksum off # ms ok",
            "2 (02h) lc02 EDA9050 8 outputs, 7 inputs # ms ok",
            "3 (03h) rtu ERC-8 8 coils at 60, no identity register # ms ok (by behaviour)",
            "4 (04h) r55 0x55 board no channel is on # ms ok (by behaviour)",
            "5 (05h) rtu EMD-2A2Q version 12 # ms ok (by behaviour)",
        ],
    );
    let notes: Vec<&str> = ran.err.lines().collect();
    let begin = format!("line {port} 9600 8N1 read-only scan, quick, about # s");
    assert_eq!(words(notes[0]), begin);
    assert!(notes[1].starts_with("5 found, 0 in conflict, "), "{ran:?}");
    assert!(notes[1].contains(" silent, complete; "), "{ran:?}");
    assert!(
        notes[2].starts_with("next:  railbus scan --add "),
        "{ran:?}"
    );
    let zh = site.run(&format!("{scan} --lang zh"));
    says(
        &zh.out,
        &[
            "地址 协议 型号 说明 响应时间 结果",
            "1 (01h) ascii EDA9060A 4 路输出，4 路输入，无校验和 # 毫秒 正常",
            "2 (02h) lc02 EDA9050 8 路输出，7 路输入 # 毫秒 正常",
            "3 (03h) rtu ERC-8 60 起 8 个线圈，无型号寄存器 # 毫秒 正常（按行为判断）",
            "4 (04h) r55 0x55 board 所有通道均为断开 # 毫秒 正常（按行为判断）",
            "5 (05h) rtu EMD-2A2Q 版本 12 # 毫秒 正常（按行为判断）",
        ],
    );
    assert!(zh.err.contains("发现 5 个，冲突 0 个，无应答 "), "{zh:?}");
    let quiet = site.run(&format!("{scan} -q -o value"));
    assert_eq!(
        (quiet.out.as_str(), quiet.err.as_str()),
        ("1\n2\n3\n4\n5\n", "")
    );
    let none = site.run(&format!("scan -l {port} --addr 9 --proto rtu"));
    assert_eq!(none.code, 3, "{none:?}");
}

#[test]
fn programs_get_each_module_as_it_is_found() {
    let (site, port) = bare("scan-json");
    let ran = site.run(&format!(
        "scan -l {port} --addr 1-6 --timeout 200ms --follow -o json"
    ));
    let rows: Vec<serde_json::Value> = ran
        .out
        .lines()
        .map(|line| serde_json::from_str(line).expect("JSON"))
        .collect();
    assert_eq!(rows.len(), 6, "{ran:?}");
    let (end, found) = rows.split_last().expect("some");
    for row in found {
        assert_eq!((&row["schema"], &row["ev"]), (&1.into(), &"found".into()));
        assert_eq!((&row["baud"], &row["parity"]), (&9600.into(), &"n".into()));
    }
    let pump = found.iter().find(|row| row["addr"] == 1).expect("pump");
    assert_eq!(pump["evidence"][0], "$01M → !019060");
    assert_eq!(pump["checksum"], false);
    assert_eq!((&end["ev"], &end["found"]), (&"end".into(), &5.into()));
    assert_eq!(end["complete"], true, "{end}");
    let table = site.run(&format!(
        "scan -l {port} --addr 1-6 --timeout 200ms --follow"
    ));
    assert_eq!(table.out.lines().count(), 6, "{table:?}");
}

#[test]
fn nothing_is_changed_and_known_modules_are_named() {
    let site = Site::demo("scan-known");
    site.run("set yard 1,3=on");
    let outputs = || site.run("get yard oven pump.do0 pump.do1 -o value").out;
    let before = outputs();
    let ran = site.run("scan --addr 1-6 --timeout 200ms -o json");
    assert_eq!(
        (ran.code, models(&ran)),
        (0, ALL.map(str::to_owned).to_vec())
    );
    assert_eq!(ran.json()["found"][2]["module"], "oven");
    assert_eq!(ran.json()["missing"], serde_json::json!([]));
    assert_eq!(outputs(), before);
    let yard = site.run("scan --addr 4 --proto r55 --timeout 200ms");
    assert!(
        yard.out.contains("at least 3 channels, module yard"),
        "{yard:?}"
    );
    // One that is not as configured, and one that is missing.
    let text = std::fs::read_to_string(site.folder.join("railbus.toml")).expect("text");
    let port = text.lines().nth(1).expect("a port");
    site.configure(&format!(
        "[line.main]\n{port}\n[module.kiln]\nline = \"main\"\nmodel = \"erc8\"\naddress = 5\n\
         [module.gone]\nline = \"main\"\nmodel = \"erc8\"\naddress = 9\n"
    ));
    let ran = site.run("scan --addr 5,9 --proto rtu --timeout 200ms");
    let differs = "kiln is another model in the configuration";
    assert!(ran.out.contains(differs), "{ran:?}");
    assert!(
        ran.err.contains("in the configuration, but silent: gone"),
        "{ran:?}"
    );
}

#[test]
fn what_is_found_is_written_where_one_wants_it() {
    let (site, port) = bare("scan-add");
    let scan = format!("scan -l {port} --addr 1-6 --timeout 200ms --add");
    let file = site.folder.join("railbus.toml");
    let asked = site.run(&scan);
    assert_eq!(asked.code, 2, "{asked:?}");
    assert!(asked.err.contains("[module.erc8_3]") && asked.err.contains("error[E0240]"));
    assert!(!file.exists());
    let ran = site.run(&format!("{scan} --yes"));
    assert_eq!(ran.code, 0, "{ran:?}");
    assert!(ran.err.contains("added to railbus.toml: "), "{ran:?}");
    let text = std::fs::read_to_string(&file).expect("text");
    assert!(
        text.starts_with(&format!("[line.main]\nport = \"{port}\"\n")),
        "{text}"
    );
    let gate = "[module.eda9050_2]\nline = \"main\"\nmodel = \"eda9050\"\naddress = 2\n\
        protocol = \"lc02\"\n";
    assert!(text.contains(gate), "{text}");
    assert_eq!(site.run("get erc8_3.k1 -o value").out, "off\n");
    // What is there stays as written, and a known module is not written again.
    let kept = text.replace("[module.emd2a2q_5]", "# the tank\n[module.tank]");
    let (kept, _) = kept
        .split_once("[module.eda9050_2]")
        .map_or((text.as_str(), ""), |parts| parts);
    let kept = format!("# ours\n{kept}");
    site.configure(&kept);
    let again = site.run("scan --addr 1-6 --timeout 200ms --add --yes");
    assert_eq!(again.code, 0, "{again:?}");
    let text = std::fs::read_to_string(&file).expect("text");
    assert!(
        text.starts_with(kept.trim_end()) && text.contains(gate),
        "{text}"
    );
    let nothing = site.run("scan --addr 1-6 --timeout 200ms --add --yes");
    assert!(nothing.err.contains("nothing new to add"), "{nothing:?}");
    assert_eq!(std::fs::read_to_string(&file).expect("text"), text);
}

#[test]
fn a_scan_that_was_broken_off_goes_on() {
    let (site, port) = bare("scan-resume");
    let scan = format!("scan -l {port} --addr 1-40");
    let none = site.run(&format!("{scan} --resume"));
    assert!(
        none.err.starts_with("error[E0271]") && none.code == 2,
        "{none:?}"
    );
    let first = site.run(&format!("{scan} --max-time 1s -o json"));
    assert_eq!(first.code, 11, "{first:?}");
    assert_eq!(first.error()["code"], "E1170");
    assert_eq!(first.json()["complete"], false);
    let left = first.json()["left_out"].clone();
    assert!(
        left.as_array().is_some_and(|left| !left.is_empty()),
        "{left}"
    );
    let other = site.run(&format!("{scan} --resume --proto rtu"));
    assert!(
        other.err.starts_with("error[E0272]") && other.code == 2,
        "{other:?}"
    );
    assert!(other.err.contains("addr=1,2,3"), "{other:?}");
    let rest = site.run(&format!("{scan} --resume -o json"));
    assert_eq!(
        (rest.code, models(&rest)),
        (0, ALL.map(str::to_owned).to_vec()),
        "{rest:?}"
    );
    let probes = |ran: &Ran| ran.json()["probes"].as_u64().expect("a number");
    assert!(probes(&rest) < 6 * 40, "{rest:?}");
    let done = site.run(&format!("{scan} --resume"));
    assert_eq!(done.code, 2, "{done:?}");
    let zh = site.run(&format!("{scan} --max-time 300ms --lang zh"));
    assert!(zh.err.contains("未扫描：9600 8N1 "), "{zh:?}");
}

#[test]
fn ctrl_c_keeps_what_was_found() {
    let (site, port) = bare("scan-stop");
    let mut command = site.command();
    let arguments = ["-o", "ndjson", "scan", "-l", &port, "--full"];
    let mut child = command
        .args(arguments)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("railbus starts");
    let mut said = BufReader::new(child.stdout.take().expect("it is piped"));
    let mut line = String::new();
    said.read_line(&mut line).expect("text");
    assert!(line.contains("\"found\""), "{line}");
    signal(&child, Signal::INT);
    let mut rest = String::new();
    said.read_to_string(&mut rest).expect("text");
    let end = rest.lines().last().expect("an end");
    let end: serde_json::Value = serde_json::from_str(end).expect("JSON");
    assert_eq!(
        (&end["ev"], &end["complete"]),
        (&"end".into(), &false.into())
    );
    let output = child.wait_with_output().expect("it ends");
    assert_eq!(output.status.code(), Some(130));
    let kept = format!("scan -l {port} --full --resume --max-time 300ms -o json");
    let resumed = site.run(&kept);
    assert_eq!(resumed.code, 11, "{resumed:?}");
    assert!(!models(&resumed).is_empty(), "{resumed:?}");
}

/// The daemon scans between its own polls, at any speed.
#[test]
fn all_of_it_goes_through_the_daemon() {
    let site = Site::served("scan-daemon");
    let socket = site.socket();
    let run = |line: &str| site.run(&format!("--socket {socket} {line}"));
    let ran = run("-o json scan --addr 1-6 --timeout 200ms --baud 9600,19200 --parity n,e");
    assert_eq!(
        (ran.code, models(&ran)),
        (0, ALL.map(str::to_owned).to_vec()),
        "{ran:?}"
    );
    assert_eq!(ran.json()["found"][0]["module"], "pump");
    let ended = run("-o json scan --max-time 500ms");
    assert_eq!(ended.code, 11, "{ended:?}");
    let online = |line: &str| line.contains(" online ");
    assert_eq!(run("ls").out.lines().filter(|line| online(line)).count(), 5);
}

/// A module whose replies are garbled every time.
#[test]
fn two_modules_on_one_address_are_told_of() {
    let site = Site::empty("scan-conflict");
    let port = liar(|_| vec![3, 0xFF, 0xFE, 0, 0, 0]);
    let scan = format!("scan -l pty:{port} --addr 3 --proto rtu");
    let ran = site.run(&scan);
    assert_eq!(ran.code, 0, "{ran:?}");
    let row = "3 (03h) rtu ? 3 of 3 replies wrong – garbled: two modules on one address?";
    assert_eq!(words(ran.out.lines().nth(1).expect("a row")), row);
    // The remedy is manual: the configuration has no module to recover.
    assert!(
        ran.err
            .contains("two modules at address 3? Switch one of them off"),
        "{ran:?}"
    );
    assert!(!ran.err.contains("config recover"), "{ran:?}");
    let nobody = site.run(&format!("config recover -l pty:{port} --addr 3"));
    assert!(
        nobody
            .err
            .contains("no module of the configuration has address 3"),
        "{nobody:?}"
    );
    let zh = site.run(&format!("{scan} --lang zh"));
    assert!(zh.out.contains("损坏：两个模块地址相同？"), "{zh:?}");
    let json = site.run(&format!("{scan} -o json")).json();
    assert_eq!(json["conflicts"], 1);
    let evidence = json["found"][0]["evidence"].as_array().map(Vec::len);
    assert_eq!(evidence, Some(3), "{json}");
}

/// Eight coils, and no reply to anything else: nothing proves the model. It is written only as what
/// the user says, and only if it could be that.
#[test]
fn what_could_be_several_is_added_only_by_name() {
    let site = Site::empty("scan-could-be");
    let port = liar(|frame| match frame {
        [address, 1, 0, 0, 0, 8, ..] => {
            let mut reply = vec![*address, 1, 1, 0];
            reply.extend(railbus_wire::crc16(&reply).to_le_bytes());
            reply
        }
        _ => Vec::new(),
    });
    let scan = format!("scan -l pty:{port} --addr 4 --proto rtu");
    let ran = site.run(&scan);
    let row = ran.out.lines().nth(1).map(words).unwrap_or_default();
    assert!(
        row.starts_with("4 (04h) rtu ? # ms could be EDA9050; not proven"),
        "{ran:?}"
    );
    let next = "railbus scan --addr 4 --add --model eda9050";
    assert!(ran.err.contains(next), "{ran:?}");
    let json = site.run(&format!("{scan} -o json")).json();
    let found = &json["found"][0];
    assert_eq!(
        (&found["verdict"], &found["model"]),
        (&"could_be".into(), &().into())
    );
    assert_eq!(found["could_be"], serde_json::json!(["eda9050"]));
    let zh = site.run(&format!("{scan} --lang zh"));
    assert!(zh.out.contains("可能是 EDA9050，无法确定"), "{zh:?}");
    let file = site.folder.join("railbus.toml");
    for flags in ["", " --model erc8"] {
        let none = site.run(&format!("{scan} --add --yes{flags}"));
        assert!(none.err.contains("nothing new to add"), "{flags}: {none:?}");
        assert!(!file.exists());
    }
    let added = site.run(&format!("{scan} --add --yes --model eda9050"));
    assert!(added.err.contains("added to "), "{added:?}");
    let text = std::fs::read_to_string(&file).expect("text");
    assert!(
        text.contains("model = \"eda9050\"\naddress = 4\nprotocol = \"rtu\"\n"),
        "{text}"
    );
}

/// A module that answers only when asked again with a longer timeout is found; others may have been
/// missed.
#[test]
fn a_line_on_which_modules_are_slow_is_told_of() {
    let site = Site::empty("scan-slow");
    let asked = AtomicUsize::new(0);
    // Later than the reply timeout, whether or not the machine is busy.
    let late = Duration::from_millis(60);
    let port = slave(move |_, frame| match frame {
        [1, 1, 0, 0, 0, 8, ..] if asked.fetch_add(1, Ordering::Relaxed) % 2 == 1 => {
            let mut reply = vec![1, 1, 1, 0];
            reply.extend(railbus_wire::crc16(&reply).to_le_bytes());
            vec![(late, reply)]
        }
        _ => Vec::new(),
    });
    let scan = format!("scan -l pty:{port} --proto rtu --addr");
    let ran = site.run(&format!("{scan} 1-17"));
    assert_eq!((ran.code, ran.out.lines().count()), (0, 2), "{ran:?}");
    // The same is scanned again.
    let again = |flags: &str| format!("railbus scan -l pty:{port} {flags} --timeout 400ms ");
    let next = again("--addr 1-17 --proto rtu");
    assert!(ran.err.contains(&format!("next:  {next}")), "{ran:?}");
    let zh = site.run(&format!("{scan} 1-17 --lang zh"));
    assert!(zh.err.contains(&next), "{zh:?}");
    let more = "--baud 9600,19200 --parity n,e --checksum off --describe";
    let deep = site.run(&format!("{scan} 1-9 --deep {more}"));
    let next = again(&format!("--deep --addr 1-9 --proto rtu {more}"));
    assert!(deep.err.contains(&next), "{deep:?}");
    let json = |range: &str| site.run(&format!("{scan} {range} -o json")).json();
    assert_eq!(json("1-17")["slow"], true);
    // All were waited for.
    let few = json("1-2");
    assert_eq!(
        (&few["slow"], &few["found"][0]["addr"]),
        (&false.into(), &1.into())
    );
}

/// In real time it takes as long as it says, and no less than on the wire; on a busy machine
/// longer.
#[test]
fn it_takes_about_as_long_as_it_says() {
    let (site, port) = bare("scan-time");
    let json = site.run(&format!("scan -l {port} -o json")).json();
    let of = |key: &str| json[key].as_f64().expect("a number");
    let (took, estimate) = (of("took_ms"), of("estimate_ms"));
    assert!((8_000.0..10_000.0).contains(&estimate), "{estimate}");
    // The estimate includes the wait for slow modules, which only an empty line needs.
    let without_wait = estimate - 1_000.0;
    assert!(
        took > 0.9 * without_wait && took < 4.0 * estimate,
        "{took} of {estimate}"
    );
}

/// A station that never stops sending is no module.
#[test]
fn a_line_that_is_never_silent_is_given_up() {
    let site = Site::empty("scan-noise");
    let port = liar(|_| vec![0xFE; 9]);
    let ran = site.run(&format!("scan -l pty:{port} --proto rtu"));
    assert_eq!((ran.code, ran.out.lines().count()), (5, 1), "{ran:?}");
    assert!(ran.err.contains("error[E0570]: "), "{ran:?}");
    assert!(ran.err.contains("left out: 9600 8N1 rtu "), "{ran:?}");
}

#[test]
fn only_the_addresses_asked_for_are_listed() {
    let site = Site::demo("scan-only");
    let ran = site.run("scan --addr 1-2 -o value");
    assert_eq!((ran.code, ran.out.as_str()), (0, "1\n2\n"), "{ran:?}");
}

#[test]
fn bad_input_is_told_of() {
    let site = Site::empty("scan-bad");
    for (flags, code) in [
        ("--addr 5-1", "E0201"),
        ("--addr 300", "E0201"),
        ("--addr x", "E0201"),
        ("--baud 9601", "E0201"),
        ("--proto dcon", "E0201"),
        ("--quick --full", "E0201"),
        ("--baud 9600 --all-bauds", "E0201"),
        ("--yes", "E0201"),
        ("--max-time 5", "E0201"),
        ("--proto r55 --baud 19200", "E0270"),
        ("--proto ascii --parity e", "E0270"),
    ] {
        let ran = site.run(&format!("scan -l /dev/none {flags}"));
        let begins = format!("error[{code}]: ");
        assert!(
            ran.code == 2 && ran.err.starts_with(&begins),
            "{flags}: {ran:?}"
        );
    }
    let server = site.run("scan -l tcp:127.0.0.1:1 --deep");
    assert!(server.err.starts_with("error[E0274]: "), "{server:?}");
    let none = site.run("scan");
    assert_eq!(none.code, 8, "{none:?}");
    let missing = site.run("scan -l /dev/none-such");
    assert_eq!(missing.code, 7, "{missing:?}");
}

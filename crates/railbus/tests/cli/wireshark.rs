//! Our capture files, opened by an unmodified Wireshark.

use crate::site::Site;
use crate::sniff::{Wire, captured, faulty};
use railbus_sniff::capture;
use railbus_wire::{Instant, Micros, SerialSettings};
use std::io::Write;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Whether there is a tshark. Without one the tests are skipped; continuous integration has it.
fn there_is_none(test: &str) -> bool {
    let none = Command::new("tshark").arg("-v").output().is_err();
    assert!(
        !none || std::env::var_os("CI").is_none(),
        "tshark is missing"
    );
    if none {
        let why = format!("{test}: skipped, there is no tshark (apt-get install tshark)");
        let _ = writeln!(std::io::stderr(), "{why}");
    }
    none
}

fn tshark(site: &Site, extcap: Option<&Path>, arguments: &[&str]) -> String {
    let mut command = match extcap {
        Some(_) if rustix::process::geteuid().is_root() => as_nobody("tshark"),
        _ => Command::new("tshark"),
    };
    command
        .current_dir(&site.folder)
        .env("HOME", &site.folder)
        .args(arguments);
    command.env("RAILBUS_CONFIG", site.folder.join("railbus.toml"));
    if let Some(folder) = extcap {
        command.env("WIRESHARK_EXTCAP_DIR", folder);
    }
    let output = command.output().expect("tshark runs");
    let err = String::from_utf8_lossy(&output.stderr);
    assert!(!err.contains("Lua:"), "{err}");
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// Wireshark does not let root choose where its capture sources are.
fn as_nobody(program: &str) -> Command {
    let mut command = Command::new("setpriv");
    command.args(["--reuid=65534", "--regid=65534", "--clear-groups", program]);
    command
}

/// Makes a file or folder readable for all users.
fn open_to_all(path: &Path) {
    let all = std::fs::Permissions::from_mode(0o777);
    std::fs::set_permissions(path, all).expect("it is ours");
}

/// The two files in the folder of a site.
fn installed(site: &Site) {
    let ran = site.run("sniff --install-wireshark --dir ws");
    assert_eq!(ran.code, 0, "{ran:?}");
    assert_eq!(
        ran.out,
        "wrote ws/plugins/railbus.lua\nwrote ws/extcap/railbus-extcap\n"
    );
}

#[test]
fn both_files_are_put_in_place_by_one_command() {
    let site = Site::empty("wireshark-install");
    let dry = site.run("sniff --install-wireshark --dir ws -n --lang zh");
    assert_eq!(
        dry.out,
        "将写入 ws/plugins/railbus.lua\n将写入 ws/extcap/railbus-extcap\n"
    );
    assert!(!site.folder.join("ws").exists());
    installed(&site);
    installed(&site);
    std::fs::write(site.folder.join("file"), "").expect("a file");
    let ran = site.run("sniff --install-wireshark --dir file/below -o json");
    assert_eq!(
        (ran.code, ran.error()["code"].as_str()),
        (1, Some("E0195")),
        "{ran:?}"
    );
}

/// What `sniff` and the dissector say of the frames of a file, one line each: protocols, role,
/// address, verdict, comment.
fn both(site: &Site, from: &str) -> (Vec<String>, Vec<String>) {
    let kept = site.folder.join("kept.pcapng").display().to_string();
    let ours = site.run(&format!("sniff --read {from} --write {kept} -o ndjson"));
    let ours = ours.out.lines().filter_map(|line| {
        let row: serde_json::Value = serde_json::from_str(line).expect("JSON");
        let text = |key: &str| match &row[key] {
            serde_json::Value::String(text) => text.clone(),
            serde_json::Value::Null => String::new(),
            other => other.to_string(),
        };
        let readings = row["readings"].as_array()?.iter();
        let mut protocols: Vec<&str> = readings
            .filter_map(|reading| reading["protocol"].as_str())
            .collect();
        protocols.dedup();
        let comment = format!("{}: {}", text("verdict"), text("meaning"));
        let cells = [text("role"), text("address"), text("verdict"), comment];
        Some(format!("{}\t{}", protocols.join(","), cells.join("\t")))
    });
    let ours = ours.collect();
    let fields = [
        "railbus.protocol",
        "railbus.also",
        "railbus.role",
        "railbus.address",
        "railbus.verdict",
        "frame.comment",
    ];
    let script = "lua_script:ws/plugins/railbus.lua";
    let mut arguments = vec!["-X", script, "-r", &kept, "-T", "fields"];
    arguments.extend(fields.iter().flat_map(|field| ["-e", *field]));
    let theirs = tshark(site, None, &arguments);
    let theirs = theirs
        .lines()
        .map(|line| match line.split('\t').collect::<Vec<_>>()[..] {
            [protocol, "", ref rest @ ..] => format!("{protocol}\t{}", rest.join("\t")),
            [protocol, also, ref rest @ ..] => format!("{protocol},{also}\t{}", rest.join("\t")),
            _ => line.to_owned(),
        });
    (ours, theirs.collect())
}

#[test]
fn the_dissector_gives_the_verdict_of_sniff() {
    if there_is_none("the_dissector_gives_the_verdict_of_sniff") {
        return;
    }
    let site = Site::empty("wireshark-verdict");
    installed(&site);
    let (ours, theirs) = both(&site, &captured(&site).display().to_string());
    assert_eq!(ours.len(), faulty().len());
    assert_eq!(theirs, ours);
}

/// Exchanges of all protocols, known and unknown, for any address.
fn pools(a: u8) -> Vec<Vec<u8>> {
    let rtu = |head: &[u8]| [head, &railbus_wire::crc16(head).to_le_bytes()].concat();
    let sum = |head: &[u8]| [head, &[railbus_wire::sum8(head)]].concat();
    let lc02 =
        |start: &[u8], body: &[u8]| [start, body, &[railbus_wire::sum8(body), 0x0D]].concat();
    let mut frames = vec![
        rtu(&[a, 1, 0, 60, 0, 9]),
        rtu(&[a, 1, 2, 5, 1]),
        rtu(&[a, 3, 0, 0, 0, 2]),
        rtu(&[a, 3, 4, 1, 2, 3, 4]),
        rtu(&[a, 5, 0, 60, 0xFF, 0]),
        rtu(&[a, 5, 0, 60, 0xFF, 0]),
        rtu(&[a, 15, 0, 60, 0, 8, 1, 5]),
        rtu(&[a, 15, 0, 60, 0, 8]),
        rtu(&[a, 6, 0, 4, 0, 1]),
        rtu(&[a, 0x86, 2]),
        rtu(&[a, 4, 0, 4, 0, 1]),
        vec![a, 0x84, 2],
        rtu(&[a, 0x2B, 14, 1, 0]),
        sum(&[0x55, a, 0x10, 0, 0, 0, 0]),
        sum(&[0x22, a, 0x10, 0, 0, 0, 5]),
        sum(&[0x55, a, 0x32, 0, 0, 0, 1]),
        sum(&[0x55, a, 0x12, 0, 0, 0, 40]),
        sum(&[0x55, a, 0x40, 0, 0, 0, 0]),
        sum(&[0x22, a, 0x40, 0, 0, 0, a]),
        lc02(b"LW", &[a, 3]),
        lc02(b"lc", &[a, 3, 2]),
        lc02(b"LW", &[a, 2, 5, 6, 0]),
        lc02(b"lc", &[5]),
        lc02(b"LW", &[a, 9]),
    ];
    let texts = [
        "$@6",
        "!030200",
        "$@M",
        "!@9060",
        "#@0003",
        ">",
        "#@1001",
        "?",
        "$@2",
        "!@400600",
        "%@05400600",
        "!05",
        "@@",
        ">0302",
        "$@4",
        "!1030200",
        "~@2",
        "!@110",
        "#**",
        "~@Oabc",
        "!@",
        "#@",
        ">+1.23",
        "$@6",
        "?@",
    ];
    let address = format!("{a:02X}");
    for text in texts {
        // The first @ after the delimiter stands for the address.
        let (mark, body) = text.split_at(1);
        let frame = format!("{mark}{}", body.replacen('@', &address, 1)).into_bytes();
        let sealed = format!("{:02X}", railbus_wire::sum8(&frame)).into_bytes();
        frames.push([&frame[..], b"\r"].concat());
        frames.push([&frame[..], &sealed, b"\r"].concat());
    }
    frames
}

#[test]
fn the_dissector_gives_the_verdict_of_sniff_on_lines_of_chance() {
    if there_is_none("the_dissector_gives_the_verdict_of_sniff_on_lines_of_chance") {
        return;
    }
    let site = Site::empty("wireshark-chance");
    installed(&site);
    let mut seed = 20_u32;
    let mut random = move |below: usize| {
        seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (seed >> 12) as usize % below
    };
    let mut file = capture::header("somebody");
    file.extend(capture::interface("main", "9600 8N1"));
    let mut at = Instant(1_795_269_787_000_000);
    for _ in 0..1_500 {
        let frames = pools([0, 1, 2, 3, 85, 245][random(6)]);
        let first = random(frames.len() - 1);
        // Often a request and what follows it, sometimes anything.
        for mut frame in frames.into_iter().skip(first).take(1 + random(2)) {
            let place = random(frame.len());
            match random(12) {
                0 => frame[place] ^= 1 << random(8),
                1 => frame.truncate(place.max(1)),
                2 => frame.insert(place, random(256) as u8),
                _ => {}
            }
            at = at + Micros([5_000, 25_000, 60_000, 350_000, 2_500_000][random(5)]);
            file.extend(capture::packet(0, at, &frame, None, ""));
            at = at + SerialSettings::FACTORY.frame_time(frame.len());
        }
    }
    let path = site.folder.join("chance.pcapng");
    std::fs::write(&path, file).expect("a file");
    let (ours, theirs) = both(&site, &path.display().to_string());
    assert!(ours.len() > 2_000, "{} frames", ours.len());
    let verdicts = [
        "\tok\t",
        "\trefused\t",
        "\tunknown\t",
        "\tbad checksum\t",
        "\tbad short\t",
    ];
    for verdict in verdicts {
        assert!(ours.iter().any(|line| line.contains(verdict)), "{verdict}");
    }
    let differing = ours.iter().zip(&theirs).filter(|(a, b)| a != b);
    let differing: Vec<_> = differing.take(5).collect();
    assert!(
        differing.is_empty() && ours.len() == theirs.len(),
        "{differing:#?}"
    );
}

#[test]
fn wireshark_lists_and_captures_our_lines() {
    if there_is_none("wireshark_lists_and_captures_our_lines") {
        return;
    }
    let site = Site::empty("wireshark-extcap");
    // If tshark runs as another user, the folder where the program was built may be closed to it.
    let program = site.folder.join("railbus");
    std::fs::copy(env!("CARGO_BIN_EXE_railbus"), &program).expect("it is there");
    let install = ["sniff", "--install-wireshark", "--dir", "ws"];
    let status = Command::new(&program)
        .current_dir(&site.folder)
        .args(install)
        .status();
    assert!(status.expect("it runs").success());
    open_to_all(&site.folder);
    let wire = Arc::new(Wire::new());
    site.configure(&format!("[line.main]\nport = \"{}\"\n", wire.name));
    open_to_all(Path::new(wire.name.trim_start_matches("pty:")));
    let folder = site.folder.join("ws/extcap");
    let listed = tshark(&site, Some(&folder), &["-D"]);
    assert!(
        listed.contains("railbus_main (railbus: main (pty:/dev/pts/"),
        "{listed}"
    );
    assert!(listed.contains("railbus: any RS-485 port"), "{listed}");
    let stop = Arc::new(AtomicBool::new(false));
    let (talker, ended) = (Arc::clone(&wire), Arc::clone(&stop));
    let talk = std::thread::spawn(move || {
        while !ended.load(Ordering::Relaxed) {
            for (_, frame) in &faulty()[..4] {
                talker.say(frame);
                std::thread::sleep(Duration::from_millis(40));
            }
        }
    });
    let script = "lua_script:ws/plugins/railbus.lua";
    let arguments = [
        "-X",
        script,
        "-i",
        "railbus_main",
        "-c",
        "8",
        "-T",
        "fields",
        "-e",
        "railbus.protocol",
        "-e",
        "railbus.verdict",
    ];
    let heard = tshark(&site, Some(&folder), &arguments);
    stop.store(true, Ordering::Relaxed);
    talk.join().expect("it ends");
    let lines: Vec<&str> = heard.lines().collect();
    assert_eq!(lines.len(), 8, "{heard}");
    assert!(
        lines.contains(&"ascii\tok") && lines.contains(&"rtu\tok"),
        "{heard}"
    );
}

#[test]
fn a_source_says_what_it_is() {
    let site = Site::empty("wireshark-words");
    let dlts = site
        .run("extcap --extcap-dlts --extcap-interface railbus")
        .out;
    assert_eq!(dlts, "dlt {number=147}{name=USER0}{display=RS-485}\n");
    let config = site
        .run("extcap --extcap-config --extcap-interface railbus")
        .out;
    assert!(
        config.starts_with("arg {number=0}{call=--line}{display=Port}{type=string}"),
        "{config}"
    );
    assert!(
        config.contains("value {arg=1}{value=9600}{display=9600}{default=true}"),
        "{config}"
    );
    assert_eq!(site.run("extcap").code, 2);
}

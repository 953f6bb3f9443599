//! What we keep, opened by a Wireshark that others wrote.

use crate::site::Site;
use crate::sniff::{Wire, captured, faulty};
use std::io::Write;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Whether there is a tshark. Without one there is nothing to ask; continuous integration has it.
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

/// Lets everybody use a file or folder.
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

#[test]
fn the_dissector_gives_the_verdict_of_sniff() {
    if there_is_none("the_dissector_gives_the_verdict_of_sniff") {
        return;
    }
    let site = Site::empty("wireshark-verdict");
    installed(&site);
    let from = captured(&site).display().to_string();
    let kept = site.folder.join("kept.pcapng").display().to_string();
    let ours = site.run(&format!("sniff --read {from} --write {kept} -o ndjson"));
    let ours = ours.out.lines().filter_map(|line| {
        let row: serde_json::Value = serde_json::from_str(line).expect("JSON");
        let text = |key: &str| match &row[key] {
            serde_json::Value::String(text) => text.clone(),
            serde_json::Value::Null => String::new(),
            other => other.to_string(),
        };
        let readings = row["readings"].as_array()?;
        let protocols = readings
            .iter()
            .filter_map(|reading| reading["protocol"].as_str());
        let protocols: Vec<&str> = protocols.collect();
        let comment = format!("{}: {}", text("verdict"), text("meaning"));
        let cells = [text("role"), text("address"), text("verdict"), comment];
        Some(format!("{}\t{}", protocols.join(","), cells.join("\t")))
    });
    let ours: Vec<String> = ours.collect();
    assert_eq!(ours.len(), faulty().len());
    let fields = [
        "railbus.protocol",
        "railbus.also",
        "railbus.role",
        "railbus.address",
        "railbus.verdict",
        "frame.comment",
    ];
    let mut arguments = vec![
        "-X",
        "lua_script:ws/plugins/railbus.lua",
        "-r",
        &kept,
        "-T",
        "fields",
    ];
    arguments.extend(fields.iter().flat_map(|field| ["-e", *field]));
    let theirs = tshark(&site, None, &arguments);
    let theirs = theirs
        .lines()
        .map(|line| match line.split('\t').collect::<Vec<_>>()[..] {
            [protocol, "", ref rest @ ..] => format!("{protocol}\t{}", rest.join("\t")),
            [protocol, also, ref rest @ ..] => format!("{protocol},{also}\t{}", rest.join("\t")),
            _ => line.to_owned(),
        });
    assert_eq!(theirs.collect::<Vec<_>>(), ours);
}

#[test]
fn wireshark_lists_and_captures_our_lines() {
    if there_is_none("wireshark_lists_and_captures_our_lines") {
        return;
    }
    let site = Site::empty("wireshark-extcap");
    // Where tshark runs as somebody else, he may not go where the program was built.
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

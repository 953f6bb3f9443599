//! The contract of `-o json`: what stdout and stderr hold parses and is as published, whatever
//! the flags, the end of the command, and the reader.

use crate::liar::liar;
use crate::published::{keeps_to, schema};
use crate::site::{Ran, Site};
use serde_json::Value;
use std::io::Read;
use std::process::Stdio;

/// What works on the demo line, with the exit code.
const GOOD: [&str; 34] = [
    "scan --addr 1-2",
    "ls",
    "ls points",
    "ls lines",
    "ls models",
    "ls ports",
    "get pump",
    "get tank.ai1 --raw",
    "get *.k*",
    "wait oven.k8=off gate.do7=off",
    "set pump.do0 on",
    "set yard 1,3=on k2=toggle",
    "set oven all=off -n",
    "pulse oven.k1 100ms",
    "scene list",
    "raw --crc 03 01 00 3C 00 08",
    "decode 550100030004C01D --all",
    "doctor",
    "bench --time 200ms",
    "export csv",
    "export mbpoll",
    "export nodered",
    "export prometheus --rules",
    "config check",
    "config path",
    "serve --check",
    "explain",
    "explain E0301",
    "explain exit-codes",
    "schema",
    "schema get",
    "help safety",
    "help exit-codes",
    "version",
];

/// These have tests of their own: the streams, the commands with many forms, and the file.
const ELSEWHERE: [&str; 14] = [
    "apply",
    "audit",
    "config-file",
    "error",
    "fleet",
    "history",
    "outlet",
    "plan",
    "replay",
    "sim",
    "sniff",
    "token",
    "user",
    "watch",
];

#[test]
fn no_schema_goes_untried() {
    let site = Site::empty("contract-schemas");
    for name in site.run("schema -o value").out.lines() {
        let tried = GOOD.iter().any(|line| line.split(' ').next() == Some(name));
        assert!(tried != ELSEWHERE.contains(&name), "{name}");
    }
}

const FLAGS: [&str; 4] = ["--lang zh -o json", "-o json -q", "-o json -v", "-o ndjson"];

#[test]
fn results_are_as_published_with_any_flags() {
    let site = Site::demo("contract");
    for line in GOOD {
        let listens = line == "doctor";
        for flags in &FLAGS[..if listens { 1 } else { FLAGS.len() }] {
            let line = format!("{flags} {line}");
            let ran = site.run(&line);
            assert_eq!(ran.code, 0, "{line}: {ran:?}");
            if !line.contains("ndjson") {
                keeps_to(&site, &line, &ran);
            }
        }
    }
}

#[test]
fn failures_are_as_published_too() {
    let site = Site::demo("contract-failures");
    let port = liar(|_| vec![0xFF; 6]);
    let dead = format!("-l pty:{port} -m erc8 -a 3");
    let lines = [
        "get".to_owned(),
        "get nosuch".to_owned(),
        "get pump --config missing.toml".to_owned(),
        "set pump.di0 on".to_owned(),
        "set pump.do0=on tank.k9=on".to_owned(),
        "pulse pump.do3 30s".to_owned(),
        "raw --crc 09 01 00 3C 00 08".to_owned(),
        "raw 55 F5 13 00 00 00 FF 5C".to_owned(),
        "decode FF".to_owned(),
        "decode 6C630103223 40D".to_owned(),
        "-l /dev/none-such scan --addr 1".to_owned(),
        "-l /dev/none-such doctor".to_owned(),
        "doctor D999".to_owned(),
        "-l nowhere doctor".to_owned(),
        "-l /dev/none-such -m erc8 -a 99 doctor".to_owned(),
        "-l nowhere bench".to_owned(),
        "doctor --fix".to_owned(),
        "explain E9999".to_owned(),
        "schema nosuch".to_owned(),
        "help nosuch".to_owned(),
        "config check --config missing.toml".to_owned(),
        format!("{dead} get erc8"),
        format!("{dead} doctor"),
    ];
    for line in lines {
        for flags in ["-o json", "-o json -q", "-o json -v"] {
            let line = format!("{flags} {line}");
            let ran = site.run(&line);
            let mends = line.ends_with("--fix");
            assert!(mends || ran.code != 0, "{line}: {ran:?}");
            keeps_to(&site, &line, &ran);
        }
    }
}

#[test]
fn a_stream_is_as_published() {
    let mut site = Site::demo("contract-watch");
    site.serve();
    let socket = site.socket();
    let mut child = site
        .command()
        .args(["--socket", &socket, "watch", "oven", "-o", "ndjson"])
        .stdout(Stdio::piped())
        .spawn()
        .expect("railbus starts");
    let mut stdout = child.stdout.take().expect("it is piped");
    let mut text = Vec::new();
    let mut buffer = [0; 4096];
    while text.iter().filter(|byte| **byte == b'\n').count() < 8 {
        let count = stdout.read(&mut buffer).expect("it is told");
        assert_ne!(count, 0, "it ended");
        text.extend_from_slice(&buffer[..count]);
    }
    child.kill().expect("it runs");
    child.wait().expect("it ran");
    let text = String::from_utf8(text).expect("text");
    let valid = schema(&site, "watch");
    for line in text.lines().take(8) {
        let event: Value = serde_json::from_str(line).expect("JSON");
        assert!(valid.is_valid(&event), "{event}");
    }
}

/// A reader may close the pipe at any time: output stops, without an error.
#[test]
fn a_broken_pipe_is_no_error() {
    let site = Site::demo("contract-pipe");
    for line in [
        "ls models",
        "get pump",
        "explain",
        "help",
        "--help",
        "man",
        "completions zsh",
    ] {
        let mut child = site
            .command()
            .args(line.split(' '))
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("railbus starts");
        drop(child.stdout.take());
        let output = child.wait_with_output().expect("it ends");
        let told = String::from_utf8_lossy(&output.stderr);
        assert_eq!(
            (output.status.code(), told.as_ref()),
            (Some(0), ""),
            "{line}"
        );
    }
}

#[test]
fn values_are_bare_and_csv_has_a_head() {
    let site = Site::demo("contract-value");
    let raw = site.run("get tank.ai1 --raw -o value").out;
    assert!(raw.trim().parse::<u16>().is_ok(), "{raw}");
    assert_eq!(site.run("get pump.do0 -o value").out, "off\n");
    assert_eq!(
        site.run("version -o value").out,
        concat!(env!("CARGO_PKG_VERSION"), "\n")
    );
    for (line, head) in [
        ("get pump", "time,module,label,value,unit,quality"),
        (
            "pulse oven.k2 100ms",
            "path,value,before,by,ms,confirmed,took_ms",
        ),
        ("ls ports", "port,driver,latency_timer_ms,plugged_s,stable"),
        ("explain exit-codes", "exit,name,meaning"),
        ("config check", "code,file,line,column,path,message"),
        ("doctor D204", "section,state,code,message"),
    ] {
        let ran = site.run(&format!("{line} -o csv"));
        assert_eq!(ran.out.lines().next(), Some(head), "{line}: {ran:?}");
    }
}

#[test]
fn colour_only_adds_and_only_where_it_is_wanted() {
    let site = Site::empty("contract-colour");
    let run = |variables: &[(&str, &str)], flags: &[&str]| {
        let mut command = site.command();
        command.args(flags).args(["get", "pump"]);
        command.env_remove("NO_COLOR").env_remove("CLICOLOR_FORCE");
        command.envs(variables.iter().copied());
        String::from_utf8(command.output().expect("it runs").stderr).expect("text")
    };
    let plain = run(&[], &[]);
    assert!(plain.starts_with("error[E0809]: "), "{plain}");
    for coloured in [
        run(&[("CLICOLOR_FORCE", "1")], &[]),
        run(&[], &["--color", "always"]),
    ] {
        assert!(
            coloured.starts_with("\x1b[1;31merror[E0809]\x1b[0m: "),
            "{coloured:?}"
        );
        let bare = coloured.replace("\x1b[1;31m", "").replace("\x1b[0m", "");
        assert_eq!(bare, plain);
    }
    assert_eq!(
        run(&[("CLICOLOR_FORCE", "1"), ("NO_COLOR", "1")], &[]),
        plain
    );
    assert_eq!(run(&[("CLICOLOR_FORCE", "1")], &["--color=never"]), plain);
    assert_eq!(
        run(&[("RAILBUS_COLOR", "never"), ("CLICOLOR_FORCE", "1")], &[]),
        plain
    );
}

#[test]
fn the_environment_may_hold_the_flags_of_every_command() {
    let site = Site::demo("contract-environment");
    let port = format!("pty:{}", site.folder.join("line").display());
    let run = |variables: &[(&str, &str)], line: &str| {
        let mut command = site.command();
        command
            .args(line.split(' '))
            .envs(variables.iter().copied());
        let output = command.output().expect("it runs");
        let text = |bytes| String::from_utf8(bytes).expect("text");
        Ran {
            code: output.status.code().unwrap_or(-1),
            out: text(output.stdout),
            err: text(output.stderr),
        }
    };
    let module = [
        ("RAILBUS_LINE", port.as_str()),
        ("RAILBUS_MODEL", "erc8"),
        ("RAILBUS_ADDRESS", "3"),
        ("RAILBUS_OUTPUT", "value"),
    ];
    let ran = run(&module, "get erc8.k1");
    assert_eq!((ran.code, ran.out.as_str()), (0, "off\n"), "{ran:?}");
    // The command line takes precedence.
    let ran = run(&module, "get erc8.k1 -o csv");
    assert!(ran.out.starts_with("time,"), "{ran:?}");
    let ran = run(&[("RAILBUS_OUTPUT", "json")], "get nosuch");
    assert_eq!(ran.error()["code"], "E0801", "{ran:?}");
    let ran = run(&[("RAILBUS_QUIET", "1")], "scan --addr 1");
    assert_eq!((ran.code, ran.err.as_str()), (0, ""), "{ran:?}");
    let wrong = run(&[("RAILBUS_BAUD", "9601")], "get pump");
    assert_eq!(wrong.code, 2, "{wrong:?}");
    assert!(wrong.err.contains("RAILBUS_BAUD=9601"), "{wrong:?}");
}

#[test]
fn other_programs_words_for_the_commands_are_known() {
    let site = Site::demo("contract-aliases");
    assert_eq!(
        site.run("list models -o value").out,
        site.run("ls models -o value").out
    );
    assert_eq!(site.run("read pump.do0 -o value").out, "off\n");
    assert_eq!(site.run("write pump.do0 on").code, 0);
    let help = site.run("--help").out;
    for hidden in ["  list", "  read", "  write", "  complete "] {
        assert!(!help.contains(hidden), "{help}");
    }
}

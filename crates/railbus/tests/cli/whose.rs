//! Which daemon: a command never goes to another site than the one that is meant.

use crate::site::{Ran, Site};
use crate::terminal::shown;
use serde_json::Value;
use std::io::{Read, Write};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// A demo at the place where commands look for a daemon.
fn demo(name: &str) -> Site {
    let mut site = Site::empty(name);
    site.start(&["serve", "--demo", "--listen", "127.0.0.1:0"], "socket");
    site
}

fn socket(site: &Site) -> PathBuf {
    site.folder.join("run/railbus.sock")
}

/// A site whose module has the name of one of the demo.
fn other(site: &Site) {
    let line = site.folder.join("no-such-line");
    site.configure(&format!(
        "[line.main]\nport = \"pty:{}\"\n[module.pump]\nline = \"main\"\n\
         model = \"eda9060a\"\naddress = 1\n",
        line.display()
    ));
}

/// Commands that reach a line, a store or an account of a site.
const REACHING: [&str; 21] = [
    "ls",
    "ls points",
    "get pump",
    "set pump.do3 on",
    "pulse pump.do1 100ms",
    "watch pump",
    "scan --addr 1",
    "scene list",
    "raw --ascii $01M",
    "sniff --time 100ms",
    "history pump.do0",
    "audit verify",
    "user list",
    "token list",
    "outlet list",
    "config show",
    "config set pump address=9 --yes",
    "config log",
    "config backup",
    "plan",
    "apply --yes",
];

#[test]
fn a_daemon_of_another_site_is_not_asked() {
    let site = demo("whose-other");
    let is_off = || site.run("get pump.do3 -o value").out == "off\n";
    assert!((0..200).any(|_| is_off()), "the demo is heard");
    let served = site.run("config path -o json").json()["paths"][0]["path"].clone();
    other(&site);
    for line in REACHING {
        let ran = site.run(&format!("{line} -o json"));
        assert_eq!((ran.code, ran.out.as_str()), (8, ""), "{line}: {ran:?}");
        let error = ran.error();
        assert_eq!(error["code"], "E0884", "{line}: {error}");
        let file = std::fs::canonicalize(site.folder.join("railbus.toml")).expect("a file");
        assert_eq!(error["config"], file.display().to_string(), "{error}");
        assert_eq!(error["served"], served, "{error}");
        assert_eq!(error["socket"], socket(&site).display().to_string());
    }
    // The suggested commands work.
    let error = site.run("ls -o json").error();
    let ways = error["hint"].as_array().expect("hints").iter();
    let ways: Vec<Ran> = ways
        .map(|way| way.as_str().expect("text"))
        .map(|way| site.run(way.strip_prefix("railbus ").expect("a command")))
        .collect();
    let [daemon, own] = &ways[..] else {
        panic!("{ways:?}");
    };
    assert!(daemon.out.contains("yard"), "{daemon:?}");
    assert!(
        own.out.contains("pump") && !own.out.contains("yard"),
        "{own:?}"
    );
    let mut command = site.command();
    command.env("RAILBUS_SOCKET", socket(&site)).arg("ls");
    let named = command.output().expect("it runs");
    assert!(String::from_utf8_lossy(&named.stdout).contains("yard"));
    // Nothing has changed meanwhile.
    let demo = format!("--socket {} get pump.do3 -o value", socket(&site).display());
    assert_eq!(site.run(&demo).out, "off\n");
    // A command that only reads the file uses it.
    assert_eq!(site.run("config check").code, 0);
    assert!(site.run("export csv").out.contains("pump.do0"));
    let path = site.run("config path -o json").json();
    assert_eq!(path["paths"][0]["why"], "place", "{path}");
}

#[test]
fn the_doctor_says_whose_daemon_it_is() {
    let site = demo("whose-doctor");
    let told = || {
        let ran = site.run("doctor -o json");
        let found = ran.json()["findings"].as_array().expect("findings").clone();
        let of_daemon = found.into_iter().filter(|one| one["section"] == "daemon");
        (ran.code, of_daemon.collect::<Vec<Value>>())
    };
    let (_, found) = told();
    let socket = socket(&site).display().to_string();
    let text = format!("running for the demo, {socket}");
    assert_eq!(found[0]["message"], text, "{found:?}");
    other(&site);
    let (code, found) = told();
    assert_ne!(code, 0);
    let refused = found.iter().find(|one| one["code"] == "D507");
    let detail = refused.expect("it is told")["message"].to_string();
    assert!(
        detail.contains("the demo") && detail.contains("railbus.toml"),
        "{detail}"
    );
    let mut site = Site::empty("whose-own");
    other(&site);
    site.start(&["serve", "--listen", "127.0.0.1:0"], "socket");
    let told = site.run("doctor -o value").out + &site.run("doctor").out;
    let file = std::fs::canonicalize(site.folder.join("railbus.toml")).expect("a file");
    assert!(
        told.contains(&format!("running for {}", file.display())),
        "{told}"
    );
    // The same file is the same site, whatever path leads to it.
    std::fs::create_dir(site.folder.join("below")).expect("a folder");
    std::os::unix::fs::symlink(&file, site.folder.join("link.toml")).expect("a link");
    for line in ["ls -o json", "--config link.toml ls -o json"] {
        let ran = site.run(line);
        assert_eq!((ran.code, ran.err.as_str()), (0, ""), "{line}: {ran:?}");
    }
    let mut below = site.command();
    below.current_dir(site.folder.join("below")).arg("ls");
    assert!(below.output().expect("it runs").status.success());
}

#[test]
fn without_a_configuration_of_ones_own_people_are_told() {
    let site = demo("whose-none");
    let said = shown(&site, 120, "ls lines");
    assert_eq!(
        said.matches("through the daemon of the demo\n").count(),
        1,
        "{said}"
    );
    for line in ["ls lines -o json", "ls lines -q", "ls lines -o value"] {
        let said = shown(&site, 120, line);
        assert!(!said.contains("through the daemon"), "{line}: {said}");
    }
    assert_eq!(site.run("ls lines").err, "", "it is no terminal");
}

/// A socket that is named is used, by every command that could ask a daemon.
#[test]
fn a_socket_that_is_named_succeeds_or_fails() {
    let site = Site::demo("whose-named");
    let missing = site.folder.join("nowhere");
    let dead = site.folder.join("dead");
    drop(std::os::unix::net::UnixListener::bind(&dead).expect("a socket"));
    let reasons = [
        (missing, "there is no such socket"),
        (dead, "nothing answers"),
    ];
    for (path, reason) in &reasons {
        for line in REACHING
            .iter()
            .chain(&["doctor", "sniff --time 100ms -o ndjson"])
        {
            let socket = path.display();
            let ran = site.run(&format!("--socket {socket} {line}"));
            assert_ne!(ran.code, 0, "{line}: {ran:?}");
            let all = ran.out + &ran.err;
            let told = all.contains(reason) && all.contains(&socket.to_string());
            assert!(told, "{line}: {all}");
        }
    }
    forbidden(&site.folder, &reasons[1].0);
}

/// One that can't be opened for lack of permission is reported as such. Root can open anything.
fn forbidden(folder: &Path, socket: &Path) {
    let mut command = std::process::Command::new("setpriv");
    let copy = folder.join("railbus");
    std::fs::copy(env!("CARGO_BIN_EXE_railbus"), &copy).expect("a copy");
    for path in [folder, &copy] {
        let mode = std::fs::Permissions::from_mode(0o755);
        std::fs::set_permissions(path, mode).expect("it is ours");
    }
    let mode = std::fs::Permissions::from_mode(0o600);
    std::fs::set_permissions(socket, mode).expect("it is ours");
    command
        .args(["--reuid=65534", "--regid=65534", "--clear-groups"])
        .arg(&copy)
        .args([
            "--socket",
            &socket.display().to_string(),
            "history",
            "pump.do0",
        ])
        .env("RAILBUS_LANG", "en");
    let Ok(output) = command.output() else {
        return;
    };
    let said = String::from_utf8_lossy(&output.stderr);
    // Only root can become another user.
    if !said.contains("setpriv:") {
        assert!(said.contains("no permission to open this socket"), "{said}");
    }
}

/// All changes of modules' settings go through the daemon that has them: also on the demo, whose
/// file was not made by hand.
#[test]
fn the_settings_of_modules_go_through_the_daemon() {
    let site = demo("whose-settings");
    let well = |line: &str| {
        let ran = site.run(line);
        assert_eq!(ran.code, 0, "{line}: {ran:?}");
        ran.out
    };
    let address = || {
        let modules = site.run("ls -o json").json()["modules"].clone();
        let mut modules = modules.as_array().expect("modules").clone().into_iter();
        let pump = modules.find(|module| module["module"] == "pump");
        pump.expect("pump")["address"].clone()
    };
    assert_eq!(well("config get pump address -o value"), "1\n");
    // The daemon gets its line back when the command ends, and asked at once it knows the values.
    assert_eq!(well("get pump.do0 -o value"), "off\n");
    well("config show -q");
    assert_eq!(well("set pump.do0 on -q"), "");
    well("config set pump address=9 --yes");
    assert_eq!(address(), 9);
    assert_eq!(well("get pump.do0 -o value"), "on\n");
    let log = well("config log");
    assert!(log.contains("address 1 → 9"), "{log}");
    // The daemon's pages and the command line share one journal.
    let csv = well("export csv");
    assert!(csv.contains("pump.do0,pump,do0,0,main,"), "{csv}");
    assert!(csv.contains(",eda9060a,9,ascii,"), "{csv}");
    assert!(well("export mbpoll").contains("-a 3 "));
    well("config backup -O site.json");
    assert_eq!(site.run("config diff site.json -q").out, "");
    assert!(well("plan").contains("0 to change"));
    well("apply --yes");
    well("config undo --yes");
    assert_eq!(address(), 1);
    assert!(well("config check").contains("no errors"));
    let doctor = well("doctor -o json");
    assert!(!doctor.contains("D301"), "{doctor}");
    // Nothing is left in the folder the commands ran in.
    assert!(!site.folder.join(".railbus").exists());
    assert!(!site.folder.join("railbus.toml").exists());
}

/// The daemon writes what a scan finds: it is served at once.
#[test]
fn modules_that_a_scan_adds_are_served_at_once() {
    let mut site = Site::demo("whose-add");
    let line = site.folder.join("line").display().to_string();
    let text = format!(
        "# the first of them\n[line.main]\nport = \"pty:{line}\"\n[module.pump]\n\
         line = \"main\"\nmodel = \"eda9060a\"\naddress = 1\n"
    );
    site.configure(&text);
    site.start(&["serve", "--listen", "127.0.0.1:0"], "socket");
    let ran = site.run("scan --addr 1-3 --add --yes");
    assert_eq!(ran.code, 0, "{ran:?}");
    let listed = site.run("ls -o value").out;
    assert_eq!(listed, "eda9050_2\nerc8_3\npump\n", "{ran:?}");
    let file = std::fs::read_to_string(site.folder.join("railbus.toml")).expect("a file");
    assert!(file.starts_with("# the first of them\n"), "{file}");
}

/// The suggested next step without a configuration: not to start what is already running.
#[test]
fn without_a_configuration_the_daemon_that_runs_is_named() {
    let site = demo("whose-hint");
    let error = site.run("--direct ls -o json").error();
    assert_eq!(error["code"], "E0809", "{error}");
    let way = error["hint"][0].as_str().expect("a hint");
    let ran = site.run(way.strip_prefix("railbus ").expect("a command"));
    assert!(ran.out.contains("yard"), "{way}: {ran:?}");
    let empty = Site::empty("whose-nothing");
    let error = empty.run("ls -o json").error();
    assert_eq!(error["hint"][0], "railbus serve --demo", "{error}");
}

/// A process at the place where commands look for a daemon that answers every request with this; or
/// never.
fn odd_daemon(site: &Site, answer: Option<&'static str>) {
    std::fs::create_dir_all(site.folder.join("run")).expect("a folder");
    let listener = std::os::unix::net::UnixListener::bind(socket(site)).expect("a socket");
    std::thread::spawn(move || {
        let mut silent = Vec::new();
        for stream in listener.incoming() {
            let mut stream = stream.expect("a connection");
            match answer {
                None => silent.push(stream),
                Some(answer) => {
                    // The head of a request; a mere check whether the socket is open sends none.
                    let _ = stream.read(&mut [0; 4096]);
                    let _ = stream.write_all(answer.as_bytes());
                }
            }
        }
    });
}

/// A daemon that is too old to report its site, or hangs, does not keep a command from using a
/// named file. Otherwise it may be the one that is meant, and the message says what it is.
#[test]
fn a_daemon_that_can_not_be_asked_is_skipped_or_told() {
    let bare = "HTTP/1.1 404 Not Found\r\ncontent-length: 0\r\n\r\n";
    let told = "HTTP/1.1 404 Not Found\r\ncontent-length: 41\r\n\r\n\
                {\"code\":\"E0110\",\"title\":\"-\",\"status\":404}";
    for (name, answer, code, reason) in [
        ("bare", Some(bare), "E0110", "/api/v1/site"),
        ("told", Some(told), "E0110", "/api/v1/site"),
        ("hangs", None, "E0109", "no answer within 5 s"),
    ] {
        let site = Site::demo(&format!("whose-odd-{name}"));
        odd_daemon(&site, answer);
        // Each waits for one that hangs.
        let count = if answer.is_some() { 2 } else { 1 };
        for line in ["get pump.do1", "config get pump address"]
            .iter()
            .take(count)
        {
            let ran = site.run(&format!("--config railbus.toml {line} -o value"));
            assert_eq!(ran.code, 0, "{name}: {line}: {ran:?}");
            let error = site.run(&format!("{line} -o json")).error();
            assert_eq!(error["code"], code, "{name}: {line}: {error}");
            assert_eq!(error["socket"], socket(&site).display().to_string());
            assert!(error.to_string().contains(reason), "{name}: {error}");
        }
        if answer.is_some() {
            std::fs::remove_file(site.folder.join("railbus.toml")).expect("a file");
            let error = site.run("ls -o json").error();
            assert_eq!(error["code"], code, "{name}: {error}");
        }
    }
}

/// A command that waits for half a minute seems to hang.
#[test]
fn a_daemon_that_hangs_is_told_within_seconds() {
    let site = Site::empty("whose-hangs");
    odd_daemon(&site, None);
    let named = format!("--socket {} ls -o json", socket(&site).display());
    for line in [named.as_str(), "doctor -o json"] {
        let begun = Instant::now();
        let ran = site.run(line);
        assert!(begun.elapsed() < Duration::from_secs(9), "{line}");
        let told = format!("{}{}", ran.out, ran.err);
        assert!(told.contains("no answer within 5 s"), "{line}: {ran:?}");
        assert_ne!(ran.code, 0, "{line}: {ran:?}");
    }
    let error = site.run(&named).error();
    assert_eq!(error["code"], "E0109", "{error}");
    assert!(error["hint"].to_string().contains("restart"), "{error}");
}

/// A file that is named is a site of its own: no daemon of another one gives it exclusive access to
/// a line.
#[test]
fn a_line_is_borrowed_only_from_the_daemon_of_the_file_that_is_named() {
    let mut site = Site::demo("whose-lends");
    site.start(&["serve", "--listen", "127.0.0.1:0"], "socket");
    let file = site.folder.join("railbus.toml");
    std::fs::copy(&file, site.folder.join("other.toml")).expect("a copy");
    let of = |config: &str| site.run(&format!("--config {config} config get pump address -q"));
    let own = of("railbus.toml");
    assert_eq!(own.code, 0, "{own:?}");
    let other = of("other.toml");
    assert_eq!(other.code, 7, "{other:?}");
    assert!(other.err.contains("E0706"), "{other:?}");
    // A port that is named is used, whichever process has it.
    let port = site.folder.join("line").display().to_string();
    let line = format!("-l pty:{port} -m eda9060a -a 1 config show -q");
    let named = site.run(&line);
    assert_eq!(named.code, 0, "{named:?}");
}

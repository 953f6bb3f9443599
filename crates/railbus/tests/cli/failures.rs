//! Bad input and bad lines: each with its code, cause, next step and exit code.

use crate::liar::liar;
use crate::site::Site;
use std::fs::Permissions;
use std::os::unix::fs::PermissionsExt;
use std::os::unix::process::CommandExt;

/// The same in both languages and as JSON.
#[track_caller]
fn fails(site: &Site, line: &str, code: &str, exit: i32) {
    let ran = site.run(line);
    assert_eq!(ran.code, exit, "{line}: {ran:?}");
    assert!(
        ran.err.starts_with(&format!("error[{code}]: ")),
        "{line}: {ran:?}"
    );
    assert!(ran.err.contains("\n  try:"), "{line}: {ran:?}");
    let zh = site.run(&format!("--lang zh {line}"));
    assert!(
        zh.err.starts_with(&format!("错误[{code}]：")),
        "{line}: {zh:?}"
    );
    let json = site.run(&format!("-o json {line}"));
    assert_eq!(json.code, exit, "{line}: {json:?}");
    let error = json.error();
    assert_eq!(error["code"], code, "{error}");
    assert_eq!(error["exit"], exit, "{error}");
    assert!(
        error["hint"]
            .as_array()
            .is_some_and(|hints| !hints.is_empty()),
        "{error}"
    );
    assert!(
        error["message"]
            .as_str()
            .is_some_and(|text| !text.is_empty()),
        "{error}"
    );
}

/// Messages of a parser or the system are shown in Chinese as well.
#[test]
fn reasons_are_told_in_chinese() {
    let site = Site::empty("reasons");
    let zh = |line: &str| site.run(&format!("--lang zh {line}")).err;
    for (text, wanted) in [
        ("[line.main\n", "不是 TOML：表头未闭合，应为 `]`"),
        ("[line.main]\nport = /dev/ttyUSB0\n", "不是 TOML："),
        (
            "[line.main]\nport = \"/dev/x\"\nbaud = \"fast\"\n",
            "类型应为：整数",
        ),
    ] {
        site.configure(text);
        let told = zh("ls");
        assert!(!told.contains(": : "), "{told}");
        assert!(
            told.contains(wanted) && !told.contains("expected"),
            "{text}: {told}"
        );
    }
    let missing = zh("--config /none/such.toml ls");
    assert!(missing.contains("找不到文件或目录"), "{missing}");
}

#[test]
fn wrong_arguments() {
    let site = Site::empty("arguments");
    fails(&site, "-l /dev/x -m erc9 -a 3 get erc9", "E0201", 2);
    fails(&site, "-l /dev/x -m erc8 -a 300 get erc8", "E0201", 2);
    fails(&site, "-m erc8 -a 3 get erc8", "E0201", 2);
    fails(&site, "get", "E0201", 2);
    fails(&site, "set pump.do0 maybe", "E0201", 2);
    fails(&site, "pulse pump.do0 500", "E0201", 2);
    fails(&site, "decode xyz", "E0201", 2);
    fails(&site, "raw 55 F5 13 00 00 00 FF 5C", "E0202", 2);
    fails(&site, "get pump", "E0809", 8);
    fails(&site, "get pump --config missing.toml", "E0824", 8);
}

#[test]
fn wrong_configurations_are_told_with_their_place() {
    let site = Site::empty("config");
    let line = "[line.main]\nport = \"/dev/ttyUSB0\"\n";
    let pump = "[module.pump]\nline = \"main\"\nmodel = \"erc8\"\naddress = 3\n";
    for (text, code, place) in [
        ("[line.main\n".to_owned(), "E0811", ":1:"),
        (format!("{line}prot = 1\n"), "E0812", ":3:1"),
        ("[line.main]\nbaud = 9600\n".to_owned(), "E0813", ":1:"),
        (
            format!("{line}{}", pump.replace("erc8", "erc9")),
            "E0815",
            ":5:",
        ),
        (
            format!("{line}{}", pump.replace("= 3", "= 300")),
            "E0816",
            ":6:",
        ),
        (
            format!("{line}{}", pump.replace("\"main\"", "\"mian\"")),
            "E0820",
            ":4:",
        ),
        (
            format!("{line}{}", pump.replace("= 3", "= 99")),
            "E0822",
            ":6:",
        ),
        (
            format!("{line}{pump}{}", pump.replace("pump", "copy")),
            "E0823",
            ":",
        ),
    ] {
        site.configure(&text);
        fails(&site, "ls", code, 8);
        let told = site.run("ls").err;
        assert!(
            told.contains("railbus.toml") && told.contains(place),
            "{told}"
        );
    }
}

#[test]
fn ports_that_can_not_be_opened() {
    let site = Site::demo("ports");
    fails(
        &site,
        "-l /dev/none-such -m erc8 -a 3 set erc8.k1 on",
        "E0705",
        7,
    );
    fails(&site, "-l /dev/none-such scan --addr 1", "E0705", 7);
    fails(&site, "-l tcp:127.0.0.1:1 scan --addr 1", "E0709", 7);
    let file = site.folder.join("railbus.toml").display().to_string();
    fails(&site, &format!("-l {file} scan --addr 1"), "E0708", 7);
    fails(&site, "-l nowhere scan --addr 1", "E0803", 8);
}

#[test]
fn modules_that_do_not_do_as_they_are_told() {
    let site = Site::demo("modules");
    let port = format!("-l pty:{}", site.folder.join("line").display());
    fails(
        &site,
        &format!("{port} -m erc8 -a 9 set erc8.k1 on"),
        "E0301",
        3,
    );
    fails(&site, &format!("{port} -m erc8 -a 9 get erc8"), "E0301", 3);
    fails(
        &site,
        &format!("{port} -m erc8 -a 5 set erc8.k1 on"),
        "E0401",
        4,
    );
    fails(
        &site,
        &format!("{port} raw --crc 05 01 00 3C 00 08"),
        "E0401",
        4,
    );
    fails(
        &site,
        &format!("{port} raw --crc 09 01 00 3C 00 08"),
        "E0301",
        3,
    );
    fails(&site, "get nosuch", "E0801", 8);
    fails(&site, "get pump.do9", "E0802", 8);
    fails(&site, "set pump.di0 on", "E0807", 8);
    fails(&site, "pulse pump.do3 30s", "E0804", 8);
    let mixed = site.run("set pump.do0=on tank.k9=on -o json");
    assert_eq!(
        (mixed.code, mixed.error()["code"].as_str()),
        (11, Some("E1101")),
        "{mixed:?}"
    );
}

/// A line has one master: the process that holds the port is named.
#[test]
fn a_port_that_another_program_holds() {
    let mut site = Site::demo("busy");
    site.serve();
    // A daemon may be asked before it has opened its ports: this waits for a module's answer.
    let socket = site.socket();
    let served = || {
        site.run(&format!("--socket {socket} get oven --fresh"))
            .code
            == 0
    };
    assert!((0..100).any(|_| served()), "the daemon never got the port");
    fails(&site, "--direct get oven", "E0706", 7);
    let told = site.run("--direct get oven").err;
    assert!(
        told.contains("railbus (") || told.contains("held by"),
        "{told}"
    );
}

#[test]
fn a_module_whose_replies_are_garbled() {
    let site = Site::empty("garbled");
    let port = liar(|_| vec![0xFF; 6]);
    let flags = format!("-l pty:{port} -m erc8 -a 3");
    fails(&site, &format!("{flags} get erc8"), "E0501", 5);
}

/// It acknowledges every command, and its relays stay off.
#[test]
fn a_module_that_says_yes_and_does_nothing() {
    let site = Site::empty("liar");
    let port = liar(|request| match request[1] {
        1 => vec![3, 1, 1, 0, 0x50, 0x30],
        _ => request.to_vec(),
    });
    let flags = format!("-l pty:{port} -m erc8 -a 3");
    fails(&site, &format!("{flags} set erc8.k1 on"), "E0601", 6);
    // An acknowledgement that repeats its request may be an echo: one reading follows, and counts.
    let unverified = format!("{flags} set erc8.k1 on --no-verify");
    fails(&site, &unverified, "E0601", 6);
}

/// Without permission for a port, the error names its owner. Root may open anything, so the program
/// then runs as another user.
#[test]
fn a_port_that_one_may_not_open() {
    let site = Site::empty("denied");
    let port = liar(|_| Vec::new());
    std::fs::set_permissions(&port, Permissions::from_mode(0o000)).expect("it is ours");
    std::fs::set_permissions(&site.folder, Permissions::from_mode(0o755)).expect("it is ours");
    let program = site.folder.join("railbus");
    std::fs::copy(env!("CARGO_BIN_EXE_railbus"), &program).expect("there is room");
    let mut command = std::process::Command::new(program);
    command.args(["-l", &port, "-m", "erc8", "-a", "3", "get", "erc8"]);
    command.current_dir(&site.folder).env("RAILBUS_LANG", "en");
    if rustix::process::geteuid().is_root() {
        command.uid(65_534).gid(65_534);
    }
    let ran = command.output().expect("it runs");
    let told = String::from_utf8_lossy(&ran.stderr);
    assert_eq!(ran.status.code(), Some(7), "{told}");
    assert!(told.starts_with("error[E0707]: "), "{told}");
    assert!(told.contains("\n  try:"), "{told}");
    // If no module could be asked, that is not shown as a list of silent modules.
    site.configure(&format!(
        "[line.main]\nport = \"pty:{port}\"\n{}",
        include_str!("modules.toml")
    ));
    let mut list = std::process::Command::new(command.get_program());
    list.args(["--direct", "ls"]);
    list.current_dir(&site.folder).env("RAILBUS_LANG", "en");
    if rustix::process::geteuid().is_root() {
        list.uid(65_534).gid(65_534);
    }
    let ran = list.output().expect("it runs");
    let told = String::from_utf8_lossy(&ran.stderr);
    assert_eq!(ran.status.code(), Some(7), "{told}");
    assert_eq!(told.matches("error[E0707]: ").count(), 1, "{told}");
    assert!(!told.contains("usermod"), "nobody's group opens it: {told}");
}

/// Each part of a command that may have acted is reported as such, whatever the form of the answer.
#[test]
fn what_may_have_acted_is_told_of_each_part() {
    const EN: &str = "the command may still have taken effect; look before repeating";
    const ZH: &str = "命令可能已生效，重复前请先查看实际状态";
    let site = Site::empty("perhaps");
    let dead = liar(|_| Vec::new());
    let module = |name: &str, address: u8| {
        format!("[module.{name}]\nline = \"main\"\nmodel = \"erc8\"\naddress = {address}\n")
    };
    site.configure(&format!(
        "[line.main]\nport = \"pty:{dead}\"\n{}{}\
         [group.all]\nmembers = [\"a.k1\", \"b.k1\"]\n\
         [scene.go]\nsteps = [{{ set = \"a.k1\", to = true }}]\n",
        module("a", 3),
        module("b", 4)
    ));
    for (command, parts) in [
        ("set a.k1 on", 1),
        ("set a.k1 toggle", 0),
        ("set a.k1=on b.k1=on", 2),
        ("set a.k1=on b.di1=on", 1),
        ("set @all on", 2),
        ("scene run go", 1),
        ("pulse a.k1 300ms", 1),
        ("raw --crc 03 05 00 3C FF 00", 1),
        ("raw --crc 03 01 00 3C 00 08", 0),
        ("get a.k1", 0),
    ] {
        // Every form that has parts.
        let formats: &[&str] = match command {
            "set a.k1=on b.k1=on" => &["table", "csv", "value", "json"],
            _ => &["json"],
        };
        for format in formats {
            let ran = site.run(&format!("-o {format} {command}"));
            assert_eq!(
                ran.err.matches(EN).count(),
                parts,
                "{format} {command}: {ran:?}"
            );
            if *format == "json" {
                let told = ran.error()["may_have_acted"].clone();
                assert_eq!(told == true, parts > 0, "{command}: {ran:?}");
            }
        }
    }
    let zh = site.run("--lang zh set a.k1=on b.k1=on");
    assert_eq!(zh.err.matches(ZH).count(), 2, "{zh:?}");
}

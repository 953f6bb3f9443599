//! `railbus doctor` on the demo line, on bad lines, and mending.

use crate::liar::{Replies, liar, slave, talker};
use crate::site::Site;
use railbus_wire::crc16;
use std::os::unix::net::UnixListener;
use std::time::Duration;

/// What changes from run to run.
fn steady(site: &Site, text: &str) -> String {
    let today = text
        .split_once(['k', '钟'])
        .map(|(_, rest)| rest.trim_start());
    let date: String = today.unwrap_or_default().chars().take(10).collect();
    text.replace(&site.folder.display().to_string(), "DIR")
        .replace(&date, "DATE")
}

/// The same, without the findings about adapters that this machine happens to have.
#[track_caller]
fn reads(site: &Site, told: &str, wanted: &str) {
    let ports = site.run("ls ports -o json").json();
    if ports["ports"].as_array().is_some_and(Vec::is_empty) {
        assert_eq!(told, wanted);
        return;
    }
    // The summary counts them, and a heading may stand before one of them.
    let lines = wanted
        .lines()
        .filter_map(|line| line.split_once(['✓', '✗']));
    for (_, line) in lines {
        assert!(told.contains(line), "{line}: {told}");
    }
}

#[test]
fn the_demo_line_is_well_in_both_languages() {
    let site = Site::demo("doctor");
    site.command();
    let run = |lang: &str| {
        let mut command = site.command();
        command.env("LC_ALL", "C.UTF-8");
        let socket = site.socket();
        command.args(["--lang", lang, "--socket", &socket, "doctor", "--direct"]);
        let output = command.output().expect("it runs");
        let text = String::from_utf8(output.stdout).expect("text");
        assert_eq!(output.status.code(), Some(0), "{text}");
        steady(&site, &text)
    };
    reads(
        &site,
        &run("en"),
        "system   ✓ clock DATE, locale C.UTF-8\n\
         port     ✓ pty:DIR/line opens, 9600 8N1\n\
         line     ✓ main: no data in 2.0 s\n\
         modules  ✓ online on main: gate oven pump tank yard (5)\n\
         config   ✓ DIR/railbus.toml: valid; estimated load main 79 %\n\
         daemon   ✓ not running; commands open the line themselves\n\
         errors: 0, warnings: 0\n",
    );
    reads(
        &site,
        &run("zh"),
        "系统      ✓ 时钟 DATE，语言环境 C.UTF-8\n\
         端口      ✓ pty:DIR/line 可以打开，9600 8N1\n\
         总线      ✓ main 2.0 秒内无数据\n\
         模块      ✓ main 上 5 个模块应答：gate oven pump tank yard\n\
         配置      ✓ DIR/railbus.toml：有效；估计负载 main 79 %\n\
         守护进程  ✓ 未运行；命令会自行打开总线\n\
         错误：0，警告：0\n",
    );
}

fn codes(ran: &crate::site::Ran) -> Vec<String> {
    let found = ran.json()["findings"]
        .as_array()
        .cloned()
        .unwrap_or_default();
    let codes = found.iter().filter_map(|finding| finding["code"].as_str());
    // The machine that runs this may have adapters and a locale of its own.
    let of_machine = ["D105", "D106", "D108", "D110"];
    codes
        .filter(|code| !of_machine.contains(code))
        .map(str::to_owned)
        .collect()
}

#[test]
fn a_silent_module_is_named_and_the_exit_code_is_1() {
    let site = Site::demo("doctor-silent");
    let file = site.folder.join("railbus.toml");
    let text = std::fs::read_to_string(&file).expect("a file");
    let more = "[module.shed]\nline = \"main\"\nmodel = \"erc8\"\naddress = 9\n";
    site.configure(&format!("{text}\n{more}"));
    let ran = site.run("doctor --direct -o json");
    assert_eq!(ran.code, 1, "{ran:?}");
    assert!(codes(&ran).contains(&"D301".to_owned()), "{ran:?}");
    assert!(!codes(&ran).contains(&"D205".to_owned()), "{ran:?}");
    assert_eq!(ran.error()["code"], "E0196", "{ran:?}");
    let ran = site.run("doctor D301 --direct");
    assert!(
        ran.out
            .contains("✗ D301 the module does not reply: shed (address 9"),
        "{ran:?}"
    );
    // Only what was asked for counts.
    assert_eq!(site.run("doctor D204 --direct").code, 0);
}

#[test]
fn the_daemon_is_asked_where_it_has_the_line() {
    let mut site = Site::demo("doctor-daemon");
    site.serve();
    let socket = site.socket();
    let healthy = || {
        let ran = site.run(&format!("--socket {socket} doctor -o json"));
        ran.code == 0 && ran.out.contains("is open (daemon)")
    };
    assert!((0..100).any(|_| healthy()), "it never got well");
    let ran = site.run(&format!("--socket {socket} doctor"));
    assert!(ran.out.contains("daemon   ✓ running for "), "{ran:?}");
    let direct = site.run("--direct doctor -o json");
    assert_eq!(codes(&direct), ["D104"], "{direct:?}");
}

#[test]
fn bad_lines_are_told_apart() {
    let site = Site::empty("doctor-lines");
    let of = |flags: &str| codes(&site.run(format!("{flags} doctor -o json").trim()));
    assert_eq!(of("-l /dev/none-such"), ["D103"]);
    assert_eq!(of("-l tcp:127.0.0.1:1"), ["D112"]);
    let file = site.folder.join("file");
    std::fs::write(&file, "").expect("a file");
    assert_eq!(of(&format!("-l {}", file.display())), ["D111"]);
    let deaf = liar(|_| Vec::new());
    assert_eq!(of(&format!("-l pty:{deaf} -m erc8 -a 3")), ["D205", "D301"]);
    let garbling = liar(|_| vec![0xFF; 6]);
    assert_eq!(of(&format!("-l pty:{garbling} -m erc8 -a 3")), ["D302"]);
    assert_eq!(of(""), ["D401"]);
    site.configure("[line.main\n");
    assert_eq!(of(""), ["D402"]);
}

/// A module whose replies are garbled is not silent, in every command: the bytes received are
/// reported, with how often and what is wrong with them.
#[test]
fn replies_that_are_garbled_are_told_as_such_directly_and_by_the_daemon() {
    /// Its outputs, or the settings that a fence asks for.
    fn reply(function: u8) -> Vec<u8> {
        let mut reply = match function {
            3 => vec![3, 3, 6, 0, 3, 0, 1, 0, 0],
            _ => vec![3, 1, 1, 0],
        };
        reply.extend(crc16(&reply).to_le_bytes());
        reply
    }
    fn wrong(function: u8) -> Replies {
        let mut reply = reply(function);
        *reply.last_mut().expect("bytes") ^= 1;
        vec![(Duration::ZERO, reply)]
    }
    fn pieces(function: u8) -> Replies {
        let piece = |(at, byte): (u64, u8)| (Duration::from_millis(100 * at), vec![byte]);
        (0_u64..).zip(reply(function)).map(piece).collect()
    }
    type Script = fn(usize, u8) -> Replies;
    let sum: Script = |_, function| wrong(function);
    // One garbled reply before silence is no silence.
    let once: Script = |number, function| match number {
        0 => wrong(function),
        _ => Vec::new(),
    };
    let cases: [(&str, Script, [&str; 2]); 3] = [
        ("sum", sum, ["wrong checksum", "校验错误"]),
        (
            "pieces",
            |_, function| pieces(function),
            ["incomplete", "不完整"],
        ),
        ("once", once, ["wrong checksum", "校验错误"]),
    ];
    for (name, script, why) in cases {
        let port = slave(move |number, request| script(number, request[1]));
        let mut site = Site::empty(&format!("doctor-garbled-{name}"));
        site.configure(&format!(
            "[line.main]\nport = \"pty:{port}\"\n\
            [module.oven]\nline = \"main\"\nmodel = \"erc8\"\naddress = 3\n"
        ));
        let direct = site.run("doctor --direct -o json");
        assert_eq!(codes(&direct), ["D302"], "{name}: {direct:?}");
        assert!(direct.out.contains(why[0]), "{name}: {direct:?}");
        if name == "once" {
            assert!(direct.out.contains("garbled replies: 1"), "{direct:?}");
            continue;
        }
        site.serve();
        std::thread::sleep(Duration::from_secs(1));
        let socket = site.socket();
        let told = site.run(&format!("--socket {socket} doctor D302"));
        assert!(
            told.out
                .contains("✗ D302 the module's replies are garbled: oven"),
            "{name}: {told:?}"
        );
        assert!(
            told.out.contains("requests: ") && told.out.contains(why[0]),
            "{name}: {told:?}"
        );
        assert!(
            told.out.contains("likely: two modules on one address"),
            "{name}: {told:?}"
        );
        let zh = site.run(&format!("--socket {socket} --lang zh doctor"));
        assert!(
            zh.out.contains("✗ D302 模块的应答损坏：oven"),
            "{name}: {zh:?}"
        );
        assert!(
            zh.out.contains("应答损坏 ") && zh.out.contains(why[1]),
            "{name}: {zh:?}"
        );
        assert!(!zh.out.contains("D301"), "{name}: {zh:?}");
    }
}

#[test]
fn what_is_heard_on_an_idle_line_is_told_apart() {
    let site = Site::empty("doctor-noise");
    let line = |path: &str| format!("-l pty:{path}");
    let of = |path: &str| codes(&site.run(&format!("{} doctor -o json", line(path))));
    let often = Duration::from_millis(200);
    assert_eq!(of(&talker(&[0xFF, 0x00, 0xFE], often)), ["D201"]);
    // A PLC that polls an ERC-8.
    let poll = &[0x03, 0x01, 0x00, 0x3C, 0x00, 0x08, 0xFC, 0x22];
    assert_eq!(of(&talker(poll, often)), ["D202"]);
    assert_eq!(
        of(&talker(&[0xFF; 256], Duration::from_millis(20))),
        ["D204"]
    );
    // An adapter that echoes, and an ERC-8 behind it.
    let echo = liar(|request| {
        let mut back = request.to_vec();
        if request[..2] == [3, 1] {
            back.extend([3, 1, 1, 0, 0x50, 0x30]);
        }
        back
    });
    assert_eq!(of(&format!("{echo} -m erc8 -a 3")), ["D203"]);
}

#[test]
fn a_bad_line_reads_so_in_both_languages() {
    let site = Site::empty("doctor-bad");
    let run = |lang: &str| {
        let mut command = site.command();
        let (socket, port) = (site.socket(), "/dev/none-such");
        command
            .env("LC_ALL", "C.UTF-8")
            .args(["--lang", lang, "--socket", &socket]);
        let output = command
            .args(["-l", port, "doctor"])
            .output()
            .expect("it runs");
        assert_eq!(output.status.code(), Some(1), "{output:?}");
        let text = |bytes| String::from_utf8(bytes).expect("text");
        steady(&site, &text(output.stdout)) + &text(output.stderr)
    };
    reads(
        &site,
        &run("en"),
        "system   ✓ clock DATE, locale C.UTF-8\n\
         port     ✗ D103 port not found: /dev/none-such\n                \
         likely: adapter not plugged in · another number after plugging it in \
         again\n                \
         fix:    railbus ls ports\n\
         daemon   ✓ not running; commands open the line themselves\n\
         errors: 1, warnings: 0\n\
         error[E0196]: the doctor found errors: 1\n  \
         try:    railbus explain D103\n",
    );
    reads(
        &site,
        &run("zh"),
        "系统      ✓ 时钟 DATE，语言环境 C.UTF-8\n\
         端口      ✗ D103 端口不存在：/dev/none-such\n                 \
         可能： 转换器未插好 · 重新插入后编号改变\n                 \
         处理： railbus ls ports\n\
         守护进程  ✓ 未运行；命令会自行打开总线\n\
         错误：1，警告：0\n\
         错误[E0196]：诊断发现 1 个错误\n  \
         可试：  railbus explain D103\n",
    );
}

#[test]
fn a_socket_left_behind_is_removed_after_a_yes_only() {
    let site = Site::empty("doctor-fix");
    let socket = site.socket();
    drop(UnixListener::bind(&socket).expect("a socket"));
    let asked = site.run(&format!("--socket {socket} doctor D501 --fix"));
    assert_eq!(asked.code, 2, "{asked:?}");
    assert!(
        asked.err.contains(&format!("  rm '{socket}'\n")),
        "{asked:?}"
    );
    assert!(
        std::fs::symlink_metadata(&socket).is_ok(),
        "nobody said yes"
    );
    let done = site.run(&format!("--socket {socket} doctor D501 --fix --yes"));
    assert_eq!(done.code, 0, "{done:?}");
    assert!(std::fs::symlink_metadata(&socket).is_err(), "{done:?}");
    let again = site.run(&format!("--socket {socket} doctor D501 --fix --yes"));
    assert!(again.err.contains("no automatic fix"), "{again:?}");
}

#[test]
fn what_is_unwise_is_told_with_its_place() {
    let site = Site::empty("doctor-lint");
    site.configure(
        "[line.main]\nport = \"/dev/ttyUSB7\"\n\n[module.a]\nline = \"main\"\n\
         model = \"eda9060a\"\nprotocol = \"rtu\"\naddress = 0x55\npoll = \"2s\"\n\
         [module.b]\nline = \"main\"\nmodel = \"r55\"\naddress = 4\npoll = \"2s\"\n",
    );
    let ran = site.run("config check");
    assert_eq!(ran.code, 0, "{ran:?}");
    assert!(ran.out.contains("! L020"), "{ran:?}");
    assert!(
        ran.out.contains("railbus.toml:8:1: module.a.address\n"),
        "{ran:?}"
    );
    assert!(ran.out.contains("85 (55h) beside r55"), "{ran:?}");
    let found = site.run("doctor --direct -o json");
    assert_eq!(codes(&found), ["D103", "D107", "L001"], "{found:?}");
    let zh = site.run("--lang zh config check");
    assert!(zh.out.contains("r55 旁的 85 (55h)"), "{zh:?}");
}

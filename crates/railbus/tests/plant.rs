//! `railbus sim plant.toml` with the real program: lines, orders and faults as used by a person, a
//! script and a client of the line.

use rustix::process::{Pid, Signal, kill_process};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::os::unix::fs::PermissionsExt;
use std::path::PathBuf;
use std::process::{Child, ChildStdin, ChildStdout, Command, Output, Stdio};
use std::time::{Duration, Instant};

/// Two lines, one module of each family.
const PLANT: &str = r#"
[line.main]
port = "pty:FOLDER/main"

[line.field]
port = "pty:FOLDER/field"
baud = 19200

[module.pump]
line = "main"
model = "eda9060a"
address = 1
sim.inputs = { di0 = 0, di2 = 0 }

[module.gate]
line = "main"
model = "eda9050"
address = 2

[module.yard]
line = "main"
model = "r55"
address = 4
outputs = 8
[module.yard.sim]
factory = true
power = "off"

[module.oven]
line = "field"
model = "erc8"
address = 3

[module.tank]
line = "field"
model = "emd2a2q"
address = 5
sim.inputs = { ai1 = 8.71 }
"#;

/// A folder with a plant's file, and the simulator that was started in it.
struct Plant {
    folder: PathBuf,
    sim: Option<Child>,
    stdin: Option<ChildStdin>,
    stdout: Option<BufReader<ChildStdout>>,
    head: String,
}

impl Plant {
    /// The file alone.
    fn file(name: &str, text: &str) -> Plant {
        let unique = format!("railbus-plant-{}-{name}", std::process::id());
        let folder = std::env::temp_dir().join(unique);
        std::fs::create_dir_all(&folder).expect("a folder");
        let text = text.replace("FOLDER", folder.to_str().expect("text"));
        std::fs::write(folder.join("plant.toml"), text).expect("a file");
        Plant {
            folder,
            sim: None,
            stdin: None,
            stdout: None,
            head: String::new(),
        }
    }

    /// The plant above, simulated.
    fn start(name: &str, more: &[&str]) -> Plant {
        let mut plant = Plant::file(name, PLANT);
        plant.begin(more);
        plant
    }

    /// Starts the simulator, and waits until it has said what it serves.
    fn begin(&mut self, more: &[&str]) {
        let mut child = self
            .command()
            .args(["sim", "plant.toml", "--control", "ctl"])
            .args(more)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .expect("railbus starts");
        let mut stdout = BufReader::new(child.stdout.take().expect("it is piped"));
        let mut head = String::new();
        while !head.contains("ctl") {
            assert_ne!(stdout.read_line(&mut head).expect("text"), 0, "it ended");
        }
        self.stdin = child.stdin.take();
        self.sim = Some(child);
        self.stdout = Some(stdout);
        self.head = head;
    }

    fn command(&self) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_railbus"));
        command
            .current_dir(&self.folder)
            .env("RAILBUS_LANG", "en")
            .env("HOME", &self.folder)
            .env("XDG_RUNTIME_DIR", &self.folder)
            .env("RAILBUS_RUN", &self.folder)
            .env_remove("RAILBUS_CONFIG");
        command
    }

    /// Runs a command to its end.
    fn run(&self, arguments: &[&str]) -> Output {
        let command = &mut self.command();
        command.args(arguments).output().expect("railbus starts")
    }

    /// The output of a command that succeeds.
    fn good(&self, arguments: &[&str]) -> String {
        let output = self.run(arguments);
        assert!(output.status.success(), "{arguments:?}: {output:?}");
        String::from_utf8(output.stdout).expect("text")
    }

    /// Sends an order, and gives the answer.
    fn order(&self, order: &str) -> String {
        let answer = self.good(&["sim", "ctl", "ctl", order]);
        assert_eq!(answer.lines().count(), 1, "{order}: {answer}");
        answer.trim_end().to_owned()
    }

    /// The values of points, read through the line.
    fn get(&self, target: &str) -> String {
        let arguments = [
            "--config",
            "plant.toml",
            "--direct",
            "get",
            target,
            "-o",
            "value",
        ];
        self.good(&arguments).trim_end().to_owned()
    }

    fn get_fails(&self, target: &str) -> i32 {
        let output = self.run(&["--config", "plant.toml", "--direct", "get", target]);
        output.status.code().unwrap_or(-1)
    }

    /// Types a line and gives the answer.
    fn type_in(&mut self, line: &str) -> String {
        let stdin = self.stdin.as_mut().expect("it is open");
        writeln!(stdin, "{line}").expect("it is heard");
        let mut answer = String::new();
        let stdout = self.stdout.as_mut().expect("it is open");
        stdout.read_line(&mut answer).expect("text");
        answer.trim_end().to_owned()
    }

    /// Waits until the simulator has ended by itself.
    fn ended(&mut self) -> i32 {
        let sim = self.sim.as_mut().expect("it was started");
        let begun = Instant::now();
        loop {
            if let Some(status) = sim.try_wait().expect("it can be waited for") {
                return status.code().unwrap_or(-1);
            }
            assert!(begun.elapsed() < Duration::from_secs(60), "it runs on");
            std::thread::sleep(Duration::from_millis(20));
        }
    }
}

impl Drop for Plant {
    fn drop(&mut self) {
        if let Some(sim) = &mut self.sim {
            let _ = sim.kill();
            let _ = sim.wait();
        }
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}

#[test]
fn all_lines_of_a_plant_are_served() {
    let mut plant = Plant::start("served", &[]);
    let folder = plant.folder.display().to_string();
    let first = "plant.toml (lines: 2, modules: 5), all simulated, until you press Ctrl-C:\n";
    assert!(plant.head.starts_with(first), "{}", plant.head);
    let place = |line: &str| {
        let row = plant.head.lines().find(|row| row.starts_with(line));
        row.unwrap_or_default()
            .split_whitespace()
            .collect::<Vec<_>>()
    };
    let (main, field) = (format!("{folder}/main"), format!("{folder}/field"));
    assert_eq!(place("main"), ["main", "9600", "8N1", "3", &main, "-"]);
    assert_eq!(place("field"), ["field", "19200", "8N1", "2", &field, "-"]);
    assert!(plant.get("pump.di0") == "off", "the file serves both sides");
    let port = format!("pty:{field}");
    let found = plant.good(&[
        "-l",
        &port,
        "--baud",
        "19200",
        "-m",
        "emd2a2q",
        "-a",
        "5",
        "get",
        "emd2a2q.ai1",
        "-o",
        "value",
    ]);
    assert_eq!(found.trim_end(), "8.71");
    let pid = Pid::from_child(plant.sim.as_ref().expect("it runs"));
    kill_process(pid, Signal::TERM).expect("it runs");
    assert_eq!(plant.ended(), 0);
    for left in ["main", "field", "ctl"] {
        let path = plant.folder.join(left);
        assert!(std::fs::symlink_metadata(path).is_err(), "{left} is left");
    }
}

#[test]
fn a_plain_site_file_is_enough() {
    let text = "[line.main]\nport = \"/dev/ttyUSB7\"\n\
        [module.oven]\nline = \"main\"\nmodel = \"erc8\"\naddress = 3\n";
    let mut plant = Plant::file("plain", text);
    plant.begin(&["-o", "json"]);
    let head: serde_json::Value = serde_json::from_str(&plant.head).expect("JSON");
    assert_eq!(head["schema"], 1);
    let pty = head["lines"][0]["pty"].as_str().expect("a path").to_owned();
    assert_eq!(
        pty,
        plant.folder.join("railbus-sim-main").display().to_string()
    );
    let port = format!("pty:{pty}");
    let found = plant.good(&[
        "-l", &port, "-m", "erc8", "-a", "3", "get", "erc8.k1", "-o", "value",
    ]);
    assert_eq!(found.trim_end(), "off");
}

#[test]
fn flags_say_where_lines_are_served() {
    let text = PLANT.replace(
        "\"pty:FOLDER/main\"",
        "\"/dev/ttyUSB0\"\nsim.tcp = \"127.0.0.1:0\"",
    );
    let mut plant = Plant::file("flags", &text);
    let elsewhere = plant.folder.join("v0").display().to_string();
    let pty = format!("field={elsewhere}");
    plant.begin(&["--pty", &pty, "-o", "json"]);
    let head: serde_json::Value = serde_json::from_str(&plant.head).expect("JSON");
    let lines = &head["lines"];
    assert_eq!(
        (&lines[0]["line"], &lines[0]["pty"]),
        (&"field".into(), &elsewhere.into())
    );
    assert!(lines[0]["tcp"].is_null() && lines[1]["pty"].is_null());
    let tcp = lines[1]["tcp"].as_str().expect("an address");
    let port = format!("tcp:{tcp}");
    let found = plant.good(&[
        "-l",
        &port,
        "-m",
        "eda9060a",
        "-a",
        "1",
        "get",
        "eda9060a.di0",
        "-o",
        "value",
    ]);
    assert_eq!(found.trim_end(), "off");
}

#[test]
fn a_fresh_board_gets_its_power_and_its_address() {
    let plant = Plant::start("fresh", &[]);
    assert_eq!(plant.get_fails("yard"), 3);
    assert_eq!(plant.order("power yard on"), "yard: power on");
    let port = format!("pty:{}", plant.folder.join("main").display());
    // Address 4, within 10 s of the power.
    let raw = ["-l", &port, "raw", "--yes", "55 01 41 00 00 00 04 9B"];
    plant.good(&raw);
    assert!(
        plant
            .order("show yard")
            .starts_with("yard: 0x55 board 4 (04h) r55 9600 8N1; ")
    );
    assert!(plant.get("yard.k1") == "off");
    plant.order("power yard cycle");
    assert!(plant.get("yard.k1") == "off", "it kept its address");
    assert_eq!(plant.order("dip yard 9"), "yard: DIP switch at 9");
    assert_eq!(plant.get_fails("yard"), 3);
    plant.order("dip yard 0");
    plant.order("reset yard");
    assert_eq!(plant.get_fails("yard"), 3, "the factory's address is 1");
}

#[test]
fn a_client_meets_what_the_prompt_does() {
    let plant = Plant::start("client", &[]);
    assert_eq!(plant.get("pump.di1"), "on");
    assert_eq!(plant.order("pump.di1 = 0"), "pump.di1 = low");
    assert_eq!(plant.get("pump.di1"), "off");
    assert_eq!(plant.order("tank.ai1 = 2.50 V"), "tank.ai1 = 2.50");
    assert_eq!(plant.get("tank.ai1"), "2.5");
    assert_eq!(plant.order("init gate on"), "gate: INIT* grounded");
    assert_eq!(plant.get_fails("gate"), 3, "it speaks LC-02 now");
    assert_eq!(plant.order("init gate off"), "gate: INIT* open");
    assert_eq!(plant.order("fault gate mute"), "gate: faults: mute");
    assert_eq!(plant.get_fails("gate"), 3);
    assert_eq!(plant.order("fault clear"), "all faults cleared");
    assert!(plant.get("gate.di0") == "on");
    assert_eq!(
        plant.order("fault line field echo"),
        "line field: faults: echo"
    );
    assert_eq!(plant.get("tank.ai1"), "2.5", "echo is compensated");
}

#[test]
fn faults_of_flags_and_files_are_there_from_the_start() {
    let mut plant = Plant::file(
        "faults",
        &PLANT.replace("address = 2\n", "address = 2\nsim.faults = \"mute\"\n"),
    );
    plant.begin(&[
        "--fault",
        "pump: dead",
        "--fault",
        "line field: delay 30ms±10",
    ]);
    assert_eq!(plant.get_fails("gate"), 3);
    assert_eq!(plant.get_fails("pump"), 3);
    assert!(plant.order("show pump").contains("power off"));
    assert!(plant.get("oven.k1") == "off");
}

#[test]
fn each_line_typed_is_answered_by_one_line() {
    let mut plant = Plant::start("typed", &[]);
    assert_eq!(plant.type_in("pump.di1 = 1"), "pump.di1 = high");
    assert_eq!(plant.type_in("fault tank mute"), "tank: faults: mute");
    assert_eq!(
        plant.type_in("show tank"),
        "tank: EMD-2A2Q 5 (05h) rtu 19200 8N1; power on; outputs 00; analog 8.71 0.00; LED on; \
         replies 0; saved 0; restarts 0; faults: mute"
    );
    assert_eq!(plant.type_in("show").split(" | ").count(), 7);
    assert_eq!(
        plant.type_in("frob"),
        "error[E0290]: unknown command \"frob\"; try help"
    );
    assert!(plant.type_in("help").contains("fault tank mute 10s"));
    // The end of a pipe does not end the plant.
    plant.stdin = None;
    assert_eq!(plant.order("power pump cycle"), "pump: power-cycled");
    assert_eq!(plant.order("quit"), "simulator stopped");
    assert_eq!(plant.ended(), 0);
}

#[test]
fn the_prompt_speaks_chinese() {
    let mut plant = Plant::start("chinese", &["--lang", "zh"]);
    let first = "plant.toml：2 条总线，5 个模块，均为仿真，按 Ctrl-C 结束：\n";
    assert!(plant.head.starts_with(first), "{}", plant.head);
    assert_eq!(plant.type_in("pump.di1 = 1"), "pump.di1 = 高电平");
    assert_eq!(plant.type_in("power yard on"), "yard：电源开");
    assert_eq!(plant.type_in("fault tank mute"), "tank：故障：mute");
    assert_eq!(
        plant.type_in("show tank"),
        "tank: EMD-2A2Q 5 (05h) rtu 19200 8N1; 电源开; 输出 00; 模拟量 8.71 0.00; 指示灯开; \
         应答 0; 存储 0; 重启 0; 故障：mute"
    );
    assert_eq!(
        plant.type_in("frob"),
        "错误[E0290]：未知命令 \"frob\"；可输入 help"
    );
    let refused = plant.run(&["sim", "ctl", "ctl", "frob"]);
    assert_eq!(refused.status.code(), Some(2));
    assert_eq!(plant.type_in("quit"), "仿真器已停止");
    assert_eq!(plant.ended(), 0);
}

#[test]
fn scripts_control_it() {
    let plant = Plant::start("control", &[]);
    let mode = std::fs::metadata(plant.folder.join("ctl")).expect("a socket");
    assert_eq!(mode.permissions().mode() & 0o777, 0o600);
    assert_eq!(
        plant.good(&["sim", "ctl", "ctl", "power", "yard", "on"]),
        "yard: power on\n"
    );
    let refused = plant.run(&["sim", "ctl", "ctl", "power", "yrd", "on"]);
    assert_eq!(refused.status.code(), Some(2));
    let told = String::from_utf8(refused.stderr).expect("text");
    assert!(
        told.starts_with("error[E0290]: there is no module \"yrd\"; there are: gate, "),
        "{told}"
    );
    let mut child = plant
        .command()
        .args(["sim", "ctl", "ctl"])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("railbus starts");
    let mut stdin = child.stdin.take().expect("it is piped");
    stdin
        .write_all(b"init gate on\n\ndip yard 3\n")
        .expect("it is heard");
    drop(stdin);
    let mut answers = String::new();
    let mut stdout = child.stdout.take().expect("it is piped");
    stdout.read_to_string(&mut answers).expect("text");
    assert!(child.wait().expect("it ends").success());
    assert_eq!(answers, "gate: INIT* grounded\nyard: DIP switch at 3\n");
    let nobody = plant.run(&["sim", "ctl", "nothing", "show"]);
    assert_eq!(nobody.status.code(), Some(7));
    let told = String::from_utf8(nobody.stderr).expect("text");
    assert!(told.starts_with("error[E0790]: "), "{told}");
    let second = plant.run(&["sim", "plant.toml", "--control", "ctl"]);
    assert_eq!(second.status.code(), Some(7), "{second:?}");
}

#[test]
fn settings_outlive_the_simulator() {
    let mut plant = Plant::start("state", &["--state", "state.json"]);
    plant.order("power yard on");
    let port = format!("pty:{}", plant.folder.join("main").display());
    plant.good(&["-l", &port, "raw", "--yes", "55 01 41 00 00 00 04 9B"]);
    plant.order("quit");
    plant.ended();
    plant.begin(&["--state", "state.json"]);
    plant.order("power yard on");
    assert!(plant.get("yard.k1") == "off", "it is factory-fresh no more");
    plant.order("quit");
    plant.ended();
    let state = plant.folder.join("state.json");
    let text = std::fs::read_to_string(&state).expect("a file");
    for wrong in [
        text.replace("r55", "erc8"),
        text.replace("9600", "9601"),
        "{}".to_owned(),
    ] {
        std::fs::write(&state, wrong).expect("a file");
        let refused = plant.run(&["sim", "plant.toml", "--state", "state.json"]);
        assert_eq!(refused.status.code(), Some(8));
        let told = String::from_utf8(refused.stderr).expect("text");
        assert!(
            told.starts_with("error[E0891]: state.json can't be used"),
            "{told}"
        );
    }
}

#[test]
fn what_is_wrong_is_told_with_its_place() {
    let told = |text: &str, flags: &[&str]| {
        let plant = Plant::file("wrong", text);
        let mut arguments = vec!["sim", "plant.toml"];
        arguments.extend(flags);
        let output = plant.run(&arguments);
        let told = String::from_utf8(output.stderr).expect("text");
        (output.status.code().unwrap_or(-1), told)
    };
    let bad = PLANT.replace("power = \"off\"", "powr = \"off\"");
    let (code, text) = told(&bad, &[]);
    assert_eq!(code, 8);
    assert!(
        text.contains("plant.toml:27:1: module.yard.sim.powr: "),
        "{text}"
    );
    assert!(text.contains("did you mean \"power\"?"), "{text}");
    let bad = PLANT.replace("factory = true", "faults = \"dorp 5%\"");
    let (code, text) = told(&bad, &[]);
    assert_eq!(code, 8);
    assert!(text.starts_with("error[E0890]: "), "{text}");
    assert!(
        text.contains("plant.toml:26:10: module.yard.sim.faults: there is no fault \"dorp\""),
        "{text}"
    );
    for (flags, code, told_so) in [
        (
            &["--pty", "/tmp/x"][..],
            8,
            "error[E0892]: the plant has several lines: name one, as --pty field=/tmp/x",
        ),
        (
            &["--tcp", "yard=127.0.0.1:0"],
            8,
            "error[E0892]: there is no line \"yard\" in the plant; there are: field, main",
        ),
        (
            &["--tcp", "main=here"],
            2,
            "error[E0201]: \"here\" is not a TCP address",
        ),
        (
            &["--fault", "pump drop 5%"],
            2,
            "error[E0290]: write it as: pump: drop 5%",
        ),
        (
            &["--fault", "pmp: mute"],
            2,
            "error[E0290]: there is no module \"pmp\"; there are: ",
        ),
        (
            &["--speed", "0"],
            2,
            "error[E0201]: invalid value \"0\" for --speed <F>",
        ),
        (&["--demo"], 2, "error[E0201]: "),
    ] {
        let (is, text) = told(PLANT, flags);
        assert_eq!(is, code, "{flags:?}: {text}");
        assert!(text.starts_with(told_so), "{flags:?}: {text}");
    }
    let (code, text) = told(PLANT, &["--pty", "main=/tmp/x", "--pty", "field=/tmp/x"]);
    assert_eq!(code, 8);
    let same = "error[E0892]: two lines are to be served at /tmp/x";
    assert!(text.starts_with(same), "{text}");
    let (code, text) = told("", &[]);
    assert_eq!(code, 8);
    assert!(
        text.starts_with("error[E0892]: plant.toml has no line to simulate"),
        "{text}"
    );
}

#[test]
fn time_may_be_stretched() {
    let text = PLANT.replace(
        "\"pty:FOLDER/field\"",
        "\"tcp:127.0.0.1:1\"\nsim.tcp = \"127.0.0.1:0\"",
    );
    let mut plant = Plant::file("speed", &text);
    plant.begin(&["--speed", "0.05", "-o", "json"]);
    let head: serde_json::Value = serde_json::from_str(&plant.head).expect("JSON");
    let tcp = head["lines"][0]["tcp"].as_str().expect("an address");
    let mut client = TcpStream::connect(tcp).expect("it listens");
    let patience = Some(Duration::from_secs(60));
    client.set_read_timeout(patience).expect("a timeout");
    // Relay 1 of `oven` on, answered by its echo.
    let request = [0x03, 0x05, 0x00, 0x3C, 0xFF, 0x00, 0x4D, 0xD4];
    let begun = Instant::now();
    client.write_all(&request).expect("it takes bytes");
    let mut reply = [0; 8];
    client.read_exact(&mut reply).expect("an answer");
    assert_eq!(reply, request);
    // Two frames of 4.167 ms, 1.823 ms of silence, 5 ms of turnaround, twenty times longer.
    assert!(begun.elapsed() >= Duration::from_micros(20 * 15_157));
}

#[test]
fn a_pty_takes_the_parity_of_the_module_that_is_meant() {
    let text = PLANT.replace("address = 3\n", "address = 3\nformat = \"8E1\"\n");
    let mut plant = Plant::file("parity", &text);
    plant.begin(&[]);
    assert_eq!(plant.get("oven.k1"), "off");
    assert_eq!(plant.get("tank.ai1"), "8.71");
}

#[test]
fn time_may_pass_faster() {
    let mut plant = Plant::file("fast", PLANT);
    plant.begin(&["--speed", "100", "--fault", "oven: mute 200s"]);
    let begun = Instant::now();
    while !plant.order("show oven").ends_with("faults: none") {
        assert!(
            begun.elapsed() < Duration::from_secs(60),
            "it is mute for long"
        );
        std::thread::sleep(Duration::from_millis(100));
    }
}

#[test]
fn a_line_that_is_never_silent_still_takes_orders() {
    let mut plant = Plant::file("loud", PLANT);
    let fault = "line main: babble, noise 1ms";
    plant.begin(&["--speed", "1000", "--fault", fault]);
    assert!(
        plant
            .order("show line main")
            .contains("faults: babble, noise 1ms")
    );
    assert_eq!(plant.order("power pump cycle"), "pump: power-cycled");
    assert_eq!(plant.order("quit"), "simulator stopped");
    assert_eq!(plant.ended(), 0);
}

#[test]
fn a_line_may_be_on_a_pty_and_on_tcp() {
    let mut plant = Plant::file("both", PLANT);
    plant.begin(&["--tcp", "main=127.0.0.1:0", "-o", "json"]);
    let head: serde_json::Value = serde_json::from_str(&plant.head).expect("JSON");
    let tcp = head["lines"][1]["tcp"].as_str().expect("an address");
    let mut client = TcpStream::connect(tcp).expect("it listens");
    let patience = Some(Duration::from_secs(60));
    client.set_read_timeout(patience).expect("a timeout");
    assert_eq!(plant.get("pump.di0"), "off");
    // Clients on TCP received that.
    let mut heard = [0; 2];
    client.read_exact(&mut heard).expect("the line");
    assert!(plant.order("show pump").contains("; replies "));
}

#[test]
fn frames_of_all_lines_are_shown_in_columns() {
    let mut plant = Plant::start("frames", &["-v"]);
    plant.get("oven.k1");
    plant.order("quit");
    plant.ended();
    let mut shown = String::new();
    let mut stdout = plant.stdout.take().expect("it is open");
    stdout.read_to_string(&mut shown).expect("text");
    let head = "  TIME s     +ms  WHO         EVENT        BYTES\n";
    assert!(shown.contains(head), "{shown}");
    let sent = "  host.field  sends        03 01 00 3C 00 08 FC 22";
    let oven = "  oven        sends        03 01 01 00 ";
    for told in [sent, oven] {
        assert!(shown.contains(told), "{told}: {shown}");
    }
}

//! Settings of modules on the demo line: shown, changed, journaled, backed up, planned.

mod bad;

use crate::site::{Ran, Site};

fn setting<'a>(shown: &'a serde_json::Value, name: &str) -> &'a serde_json::Value {
    let all = shown["settings"].as_array().expect("a list");
    all.iter()
        .find(|one| one["setting"] == name)
        .unwrap_or_else(|| panic!("{name} in {shown}"))
}

#[track_caller]
fn fails(ran: &Ran, code: &str, exit: i32) {
    assert_eq!(ran.code, exit, "{ran:?}");
    assert!(ran.err.contains(code), "{ran:?}");
    let told = ran.err.contains("\n  try:") || ran.err.contains("\n  可试：");
    assert!(told, "the next step is missing: {ran:?}");
}

fn toml(site: &Site) -> String {
    std::fs::read_to_string(site.folder.join("railbus.toml")).expect("a file")
}

fn journal(site: &Site) -> String {
    std::fs::read_to_string(site.folder.join(".railbus/journal.jsonl")).unwrap_or_default()
}

#[test]
fn settings_are_shown_with_where_they_come_from() {
    let site = Site::demo("config-show");
    let ran = site.run("-q config show pump");
    assert_eq!(
        ran.out,
        "SETTING      VALUE    ALLOWED                    NOTE\n\
         address      1 (01h)  0-255                      in EEPROM; in effect after the reply\n\
         baud         9600     1200 2400 4800 9600 19200  in EEPROM; in effect after the reply\n\
         checksum     off      on | off                   in EEPROM; in effect after the reply\n\
         protocol     ascii    ascii | lc02 | rtu         only with the vendor's software\n\
         do0.mode     level    level | pulse              in EEPROM; in effect after the reply\n\
         do1.mode     level    level | pulse              in EEPROM; in effect after the reply\n\
         do2.mode     level    level | pulse              in EEPROM; in effect after the reply\n\
         do3.mode     level    level | pulse              in EEPROM; in effect after the reply\n\
         pulse_width  1.0 s    0.1-20.0 s                 in EEPROM; in effect after the reply\n"
    );
    let zh = site.run("-q config show yard --lang zh");
    assert_eq!(
        zh.out,
        "设置     值       可选           说明\n\
         address  4 (04h)  1-244 246-255  存于 EEPROM；仅在上电 10 秒内、拨码为 0 时可写\n\
         baud     9600     9600           固定\n"
    );
    let all = site.run("-q config show -o json").json();
    assert_eq!(all["schema"], 1);
    let gate = site.run("-q config show gate -o json").json();
    // No LC-02 frame tells the checksum state.
    assert_eq!(setting(&gate, "checksum")["value"], serde_json::Value::Null);
    assert_eq!(setting(&gate, "protocol")["access"], "init_pin");
    assert_eq!(
        site.run("-q config get tank baud calibration_voltage -o value")
            .out,
        "9600\n5.00 V\n"
    );
    fails(&site.run("config get pump parity"), "E0840", 8);
    fails(&site.run("config show nobody"), "E0801", 8);
}

#[test]
fn a_change_is_journaled_and_the_configuration_follows() {
    let site = Site::demo("config-set");
    let before = toml(&site);
    let dry = site.run("-q config set pump address=9 baud=19200 -n");
    assert!(dry.out.contains("frame  %0109400700<CR>"), "{dry:?}");
    assert!(dry.out.contains("needs two speed changes"), "{dry:?}");
    assert!(dry.out.ends_with("nothing written\n"), "{dry:?}");
    assert_eq!(
        (toml(&site), journal(&site)),
        (before.clone(), String::new())
    );
    // There is no terminal for a question here.
    fails(&site.run("config set pump address=9"), "E0240", 2);
    assert_eq!(journal(&site), "");

    let ran = site.run("-q config set pump address=9 baud=19200 --yes -o json");
    let changed = ran.json()["changed"][0].clone();
    assert_eq!(changed["change"], 1, "{ran:?}");
    assert_eq!(changed["set"]["address"]["value"], "9");
    assert_eq!(
        toml(&site),
        before.replace("address = 1\n", "address = 9\nbaud = 19200\n")
    );
    let states: Vec<String> = journal(&site)
        .lines()
        .map(|line| serde_json::from_str::<serde_json::Value>(line).expect("JSON"))
        .map(|record| record["state"].as_str().unwrap_or_default().to_owned())
        .collect();
    assert_eq!(states, ["intent", "done", "filed"]);
    // It answers at the new address, to everything else as well.
    assert_eq!(site.run("get pump.do0 -o value").out, "off\n");

    let same = site.run("config set pump address=9 --yes");
    assert_eq!(
        same.out,
        "pump  unchanged, at 9 (09h), 19200 8N1: nothing written\n"
    );
    let undone = site.run("config undo 1 --yes --lang zh");
    assert!(
        undone
            .out
            .starts_with("pump  已写入并回读一致（1 (01h)，9600 8N1）"),
        "{undone:?}"
    );
    let log = site.run("config log -o json").json();
    assert_eq!(log["changes"][1]["undoes"], 1, "{log}");
    assert_eq!(log["changes"][1]["set"]["baud"][1], "9600");
    let told = site.run("config log").out;
    assert!(
        told.contains("address 1 → 9, baud 9600 → 19200  done\n"),
        "{told}"
    );
    assert_eq!(
        site.run("config recover").err.trim(),
        "no unfinished change: nothing to recover"
    );
    fails(&site.run("config undo 77 --yes"), "E0846", 8);
}

#[test]
fn what_can_not_be_is_refused_before_anything_is_written() {
    let site = Site::demo("config-refused");
    for (line, code, exit) in [
        ("config set oven address=33 --yes", "E0841", 8),
        ("config set oven baud=1200 --yes", "E0841", 8),
        ("config set oven address=0 --yes", "E0841", 8),
        ("config set yard address=245 --yes", "E0841", 8),
        ("config set pump protocol=rtu --yes", "E0842", 8),
        ("config set gate protocol=ascii --yes", "E0842", 8),
        ("config set gate checksum=on --yes", "E0842", 8),
        ("config set yard baud=9600 --yes", "E0842", 8),
        ("config set oven colour=red --yes", "E0840", 8),
        ("config set oven address --yes", "E0201", 2),
        // The tank is at that address, in the same protocol.
        ("config set oven address=5 --yes", "E0440", 4),
        // A pseudo-terminal has no parity, a serial server its own speed.
        ("config set oven parity=even --yes", "E0843", 8),
        ("config undo --yes", "E0846", 8),
        ("config calibrate pump --yes", "E0842", 8),
        ("config calibrate tank --yes --voltage 21V", "E0841", 8),
        ("config calibrate tank", "E0240", 2),
        ("config factory tank", "E0240", 2),
        ("config set -l main address=9 --yes", "E0201", 2),
    ] {
        fails(&site.run(line), code, exit);
        let zh = site.run(&format!("{line} --lang zh"));
        assert_eq!(zh.code, exit, "{zh:?}");
        assert!(zh.err.contains(code) && zh.err.contains("错误["), "{zh:?}");
        let json = site.run(&format!("{line} -q -o json"));
        assert_eq!(json.error()["code"], code, "{json:?}");
    }
    assert_eq!(journal(&site), "");
    let port = format!("-l pty:{}", site.folder.join("line").display());
    // Another model, and no module.
    fails(
        &site.run(&format!("{port} -m erc8 -a 5 config show")),
        "E0442",
        4,
    );
    fails(
        &site.run(&format!("{port} -m erc8 -a 9 config show")),
        "E0301",
        3,
    );
}

/// A journal that ends in an intent: the host died, and how far it came is unknown.
#[test]
fn what_was_cut_short_is_recovered() {
    let site = Site::demo("config-recover");
    assert_eq!(site.run("-q config set oven address=7 --yes").code, 0);
    let all = journal(&site);
    let path = site.folder.join(".railbus/journal.jsonl");
    let intent = all.lines().next().expect("an intent").to_owned();
    // The end of the change is torn off, and the configuration has its previous text.
    std::fs::write(&path, format!("{intent}\n{}", &intent[..40])).expect("a file");
    site.configure(&toml(&site).replace("address = 7", "address = 3"));
    let log = site.run("config log").out;
    assert!(log.contains("interrupted: railbus config recover"), "{log}");
    let ran = site.run("-q config recover");
    assert_eq!(ran.code, 0, "{ran:?}");
    assert_eq!(
        ran.out,
        "oven  7 (07h), 9600 8N1  found; the change is complete  #1\n"
    );
    assert!(toml(&site).contains("address = 7"));
    assert!(site.run("config log").out.contains("done"));

    // And one whose write was never sent.
    let intent = intent
        .replace("\"change\":1", "\"change\":2")
        .replace("\"address\":7", "\"address\":8");
    let intent = intent
        .replace("\"address\":3", "\"address\":7")
        .replace("[\"3\",\"7\"]", "[\"7\",\"8\"]");
    let before = journal(&site);
    std::fs::write(&path, format!("{before}{intent}\n")).expect("a file");
    let ran = site.run("-q config recover --lang zh");
    assert_eq!(
        ran.out, "oven  7 (07h)，9600 8N1  已找到；更改未执行  #2\n",
        "{ran:?}"
    );
    // The host died before it had written the configuration.
    let filed = journal(&site);
    let done: Vec<&str> = filed
        .lines()
        .filter(|line| !line.contains("filed"))
        .collect();
    let done = done.iter().filter(|line| line.contains("\"change\":1,"));
    let done: String = done.map(|line| format!("{line}\n")).collect();
    std::fs::write(&path, done).expect("a file");
    site.configure(&toml(&site).replace("address = 7", "address = 3"));
    let ran = site.run("-q config recover");
    assert!(
        ran.out
            .starts_with("oven  7 (07h), 9600 8N1  found at another address"),
        "{ran:?}"
    );
    assert!(toml(&site).contains("address = 7"));

    // A module that does not answer anywhere.
    let port = format!("-l pty:{}", site.folder.join("line").display());
    let gone = format!(
        "{port} -m r55 -a 77 config recover r55 --state {}",
        site.folder.display()
    );
    assert_eq!(
        site.run(&format!("{gone} -q")).code,
        0,
        "the board at 4 is found by looking around"
    );
}

#[test]
fn a_backup_is_compared_and_written_back() {
    let site = Site::demo("config-backup");
    let ran = site.run("config backup -O site.json -q");
    assert_eq!((ran.code, ran.out.as_str()), (0, ""), "{ran:?}");
    let file = site.folder.join("site.json");
    let text = std::fs::read_to_string(&file).expect("a file");
    let backup: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    assert_eq!(
        backup["modules"]["pump"]["settings"]["pulse_width"],
        "1.0 s"
    );
    assert_eq!(backup["modules"]["tank"]["version"], 12);
    assert_eq!(
        site.run("-q config backup").out,
        text,
        "the same modules give the same text"
    );
    assert_eq!(site.run("config diff site.json --exit-code").code, 0);

    assert_eq!(
        site.run("config set pump pulse_width=0.7s do3.mode=pulse --yes -q")
            .code,
        0
    );
    let diff = site.run("-q config diff site.json");
    assert_eq!(
        (diff.code, diff.out.as_str()),
        (
            0,
            "MODULE  SETTING      BACKUP  NOW\n\
             pump    do3.mode     level   pulse\n\
             pump    pulse_width  1.0 s   0.7 s\n"
        ),
        "{diff:?}"
    );
    let differs = site.run("-q config diff site.json pump --exit-code");
    assert_eq!(
        (differs.code, differs.err.as_str()),
        (10, ""),
        "{differs:?}"
    );
    fails(&site.run("config restore site.json"), "E0240", 2);
    let dry = site.run("-q config restore site.json --module pump -n");
    assert!(dry.out.contains("pulse_width  0.7 s  →  1.0 s"), "{dry:?}");
    assert_eq!(site.run("-q config restore site.json --yes").code, 0);
    assert_eq!(site.run("config diff site.json --exit-code").code, 0);

    for (from, to, code) in [
        ("\"schema\": 1", "\"schema\": 7", "E0849"),
        ("railbus backup", "shopping list", "E0848"),
        ("\"site\": \"", "\"site\": \"0", "E0850"),
        ("{", "", "E0848"),
    ] {
        std::fs::write(&file, text.replacen(from, to, 1)).expect("a file");
        fails(&site.run("config restore site.json --yes"), code, 8);
        fails(&site.run("config diff site.json"), code, 8);
    }
    std::fs::write(&file, text.replacen("\"site\": \"", "\"site\": \"0", 1)).expect("a file");
    assert_eq!(site.run("config diff site.json --other-site").code, 0);
    fails(&site.run("config restore none.json --yes"), "E0848", 8);
    fails(
        &site.run("config restore site.json --other-site --yes --module nobody"),
        "E0801",
        8,
    );
    // The settings of an EDA9060A can't be restored to an ERC-8.
    fails(
        &site.run("config restore site.json --other-site --yes --map pump=oven"),
        "E0442",
        4,
    );
}

/// One module is off: the others are shown and backed up anyway, and that is reported.
#[test]
fn a_silent_module_does_not_hide_the_others() {
    let site = Site::demo("config-silent");
    site.configure(&toml(&site).replace("address = 3", "address = 13"));
    let ran = site.run("-q config show");
    fails(&ran, "E1101", 11);
    assert!(ran.err.contains("oven: E0301"), "{ran:?}");
    assert!(ran.out.contains("pump    pulse_width  "), "{ran:?}");
    let ran = site.run("-q config backup -O site.json");
    fails(&ran, "E1101", 11);
    let text = std::fs::read_to_string(site.folder.join("site.json")).expect("a file");
    assert!(
        text.contains("\"tank\"") && !text.contains("\"oven\""),
        "{text}"
    );
    fails(&site.run("config show oven"), "E0301", 3);
}

#[test]
fn a_plan_is_made_and_applied() {
    let site = Site::demo("config-plan");
    let settings = "[module.pump.settings]\npulse_width = \"0.7s\"\ndo3.mode = \"pulse\"\n\
        [module.tank.settings]\ncalibration_voltage = \"4.00V\"\n";
    let text = toml(&site);
    // The gate should be at 12, and is not where the configuration has it.
    site.configure(&format!("{text}{settings}"));
    let plan = site.run("-q plan");
    assert_eq!(
        (plan.code, plan.out.as_str()),
        (
            0,
            "=  gate\n=  oven\n\
             ~  pump  do3.mode             level → pulse\n\
             ~  pump  pulse_width          1.0 s → 0.7 s\n\
             ~  tank  calibration_voltage  5.00 V → 4.00 V\n\
             =  yard\n\
             2 to change, 0 missing, 3 unchanged, 0 unclear\n"
        ),
        "{plan:?}"
    );
    for form in ["table", "csv"] {
        let differs = site.run(&format!("-q plan --exit-code -o {form}"));
        assert_eq!(
            (differs.code, differs.err.as_str()),
            (10, ""),
            "{differs:?}"
        );
    }
    // Writing needs confirmation, and there is no terminal to ask.
    fails(&site.run("apply"), "E0240", 2);
    assert!(
        site.run("-q plan --lang zh")
            .out
            .ends_with("待更改 2，缺失 0，不变 3，不明 0\n")
    );
    let applied = site.run("-q apply --only pump --yes -O report.json");
    assert_eq!(applied.code, 0, "{applied:?}");
    let report = std::fs::read_to_string(site.folder.join("report.json")).expect("a file");
    assert!(
        report.contains("\"module\":\"pump\"") && report.contains("\"done\":true"),
        "{report}"
    );
    assert_eq!(site.run("-q apply --yes").code, 0);
    assert_eq!(site.run("-q plan --exit-code").code, 0);
    let nothing = site.run("-q apply");
    assert_eq!((nothing.code, nothing.err.as_str()), (0, ""), "{nothing:?}");

    // A missing module is reported, and stops the rest.
    let missing = toml(&site).replace("address = 3", "address = 13");
    site.configure(&missing);
    let plan = site.run("-q plan -o json").json();
    let oven = plan["plan"]
        .as_array()
        .expect("a list")
        .iter()
        .find(|one| one["module"] == "oven");
    assert_eq!(oven.expect("oven")["state"], "missing");
    fails(&site.run("apply --yes"), "E0341", 3);

    // The keys of the table are checked as strictly as all others, with their position.
    for (bad, code) in [
        ("pulse_width = \"0.75s\"", "E0841"),
        ("colour = \"red\"", "E0840"),
        ("address = \"9\"", "E0840"),
        ("pulse_width = 7", "E0814"),
    ] {
        site.configure(&format!("{text}[module.pump.settings]\n{bad}\n"));
        let ran = site.run("ls");
        assert!(ran.code == 8 && ran.err.contains(code), "{bad}: {ran:?}");
        assert!(
            ran.err.contains("railbus.toml:") && ran.err.contains("settings"),
            "{ran:?}"
        );
    }
}

#[test]
fn a_module_fresh_from_the_factory_is_found_and_sent_to_its_place() {
    let site = Site::demo("config-fresh");
    assert_eq!(site.run("-q config set oven address=1 --yes").code, 0);
    // It should be at 6 at another speed; it is at the factory's address.
    site.configure(&toml(&site).replace(
        "model = \"erc8\"\naddress = 1",
        "model = \"erc8\"\nbaud = 19200\naddress = 6",
    ));
    let plan = site.run("-q plan oven").out;
    assert!(plan.contains("~  oven  address  1 → 6"), "{plan}");
    let ran = site.run("-q apply --only oven --yes");
    assert_eq!(ran.code, 0, "{ran:?}");
    assert_eq!(
        site.run("-q config get oven address baud -o value").out,
        "6\n19200\n"
    );
}

#[test]
fn a_calibration_a_factory_reset_and_a_whole_line() {
    let site = Site::demo("config-guided");
    let ran = site.run("-q config calibrate tank --voltage 4.00V --yes -o json");
    assert_eq!(ran.code, 0, "{ran:?}");
    assert_eq!(ran.json()["calibrated"][0]["change"], 1);
    assert_eq!(
        site.run("-q config get tank calibration_voltage -o value")
            .out,
        "4.00 V\n"
    );
    fails(&site.run("config undo 1 --yes"), "E0847", 8);
    let ran = site.run("config factory tank --yes");
    assert!(
        ran.out
            .starts_with("tank  written and verified at 1 (01h), 9600 8N1"),
        "{ran:?}"
    );
    assert!(ran.err.contains("loses its calibration"), "{ran:?}");
    assert_eq!(
        site.run("-q config get tank calibration_voltage -o value")
            .out,
        "5.00 V\n"
    );

    let ran = site.run("-q config set -l main checksum=on --yes -o json");
    assert_eq!(ran.json()["changed"][0]["module"], "pump", "{ran:?}");
    assert!(toml(&site).contains("checksum = true"));
    assert_eq!(site.run("get pump.do0 -o value").out, "off\n");

    fails(&site.run("set --all-boards on"), "E0202", 2);
    let dry = site.run("set --all-boards on -n");
    assert_eq!(dry.out, "would send  main  55 F5 33 FF FF FF FF 79\n");
    let all = site.run("set --all-boards on --confirm broadcast");
    assert_eq!(all.out, "yard  on  read back\n", "{all:?}");
    assert_eq!(site.run("get yard.k8 -o value").out, "on\n");
    let all = site.run("set --all-boards off --confirm broadcast --lang zh");
    assert_eq!(all.out, "yard  断开  已回读\n");
}

/// The daemon gives the command exclusive access to its line for as long as it runs, and knows the
/// module's address afterwards.
#[test]
fn the_daemon_lends_its_line() {
    let mut site = Site::demo("config-daemon");
    site.serve();
    let socket = site.socket();
    let patiently = |done: &dyn Fn() -> bool| {
        (0..400).any(|_| {
            std::thread::sleep(std::time::Duration::from_millis(50));
            done()
        })
    };
    let served = |module: &str| {
        let get = format!("--socket {socket} get {module} --fresh");
        patiently(&|| site.run(&get).code == 0)
    };
    assert!(served("oven"), "the daemon never got the port");
    let ran = site.run(&format!(
        "--socket {socket} config set oven address=9 --yes"
    ));
    assert_eq!(ran.code, 0, "{ran:?}");
    assert!(
        ran.err
            .contains("polling of line \"main\" pauses during this command"),
        "{ran:?}"
    );
    assert!(
        served("oven"),
        "the daemon took the line back, and the configuration with it"
    );
    let ls = site.run(&format!("--socket {socket} ls -o json")).json();
    let oven = ls["modules"]
        .as_array()
        .expect("a list")
        .iter()
        .find(|one| one["module"] == "oven");
    assert_eq!(oven.expect("oven")["address"], 9, "{ls}");

    // Meanwhile no other client gets it, and the daemon says why.
    let file = site.folder.join("railbus.toml");
    let text = std::fs::read_to_string(&file).expect("a file");
    std::thread::sleep(std::time::Duration::from_secs(11));
    // Waiting for a board to be power-cycled holds the line for a minute.
    let mut child = site
        .command()
        .args([
            "--socket",
            &socket,
            "config",
            "set",
            "yard",
            "address=8",
            "--yes",
        ])
        .stdout(std::process::Stdio::null())
        .stderr(std::process::Stdio::null())
        .spawn()
        .expect("railbus starts");
    let lines = || site.run(&format!("--socket {socket} ls lines -o json")).out;
    assert!(patiently(&|| lines().contains("\"lent\"")), "{}", lines());
    fails(
        &site.run(&format!("--socket {socket} config show pump")),
        "E0706",
        7,
    );
    let get = site.run(&format!("--socket {socket} get oven --fresh -o json"));
    assert_eq!(
        (get.code, get.error()["reason"].as_str()),
        (7, Some("lent")),
        "{get:?}"
    );
    // However the command ends, the daemon gets its line back.
    child.kill().expect("it runs");
    child.wait().expect("it ends");
    assert!(
        served("oven"),
        "the daemon did not take the line back: {:?} {}",
        site.run(&format!("--socket {socket} get oven --fresh")),
        lines()
    );
    assert_eq!(std::fs::read_to_string(&file).expect("a file"), text);

    // A command that bypasses the daemon finds the port in use.
    fails(&site.run("--direct config show pump"), "E0706", 7);
    assert!(
        site.run("--direct config show pump")
            .err
            .contains("railbus serve")
    );
}

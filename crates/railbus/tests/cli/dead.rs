//! Wherever a value is shown, its quality is shown with it: for dead modules, for missing lines,
//! and without the daemon.

use crate::liar::slave;
use crate::site::{Ran, Site};
use serde_json::Value;
use std::io::{BufRead, BufReader};
use std::process::Stdio;
use std::time::Duration;

/// A simulated line whose modules can be switched off, and a configuration for it that has some
/// more.
pub(crate) fn plant(name: &str, more: &str) -> Site {
    let mut site = Site::empty(name);
    let pty = site.folder.join("line").display().to_string();
    let modules = include_str!("modules.toml");
    let plant = format!("[line.main]\nport = \"pty:{pty}\"\n{modules}");
    site.configure(&(plant.clone() + more));
    std::fs::write(site.folder.join("plant.toml"), plant).expect("a file");
    site.start(&["sim", "plant.toml", "--control", "ctl"], "ctl");
    site
}

pub(crate) fn power(site: &Site, module: &str, on: &str) {
    let ran = site.run(&format!("sim ctl ctl power {module} {on}"));
    assert_eq!(ran.code, 0, "{ran:?}");
}

#[test]
fn a_module_is_not_blamed_for_the_silence_of_others() {
    let dead = |name: &str, address: u8| {
        format!("[module.{name}]\nline = \"main\"\nmodel = \"erc8\"\naddress = {address}\n")
    };
    let site = plant("blame", &(dead("kiln", 9) + &dead("lamp", 10)));
    let ran = site.run("get *.k1 gate -o json");
    assert_eq!(ran.code, 3, "{ran:?}");
    assert_eq!(
        ran.error()["modules"],
        serde_json::json!(["kiln", "lamp"]),
        "{ran:?}"
    );
    let points = ran.json()["points"].as_array().expect("points").clone();
    let gate: Vec<&Value> = points.iter().filter(|p| p["module"] == "gate").collect();
    assert!(!gate.is_empty(), "{ran:?}");
    for point in gate {
        assert_eq!(point["quality"], "good", "{point}");
        // The dead ones were waited for after it was read.
        assert!(point["age_ms"].as_u64() > Some(1_000), "{point}");
    }
    let listed = site.run("ls").out;
    let of_gate = listed.lines().find(|line| line.starts_with("gate "));
    assert!(of_gate.is_some_and(|line| !line.contains('?')), "{listed}");
    let shown = site.run("get gate.do0 kiln.k1 -o value");
    assert_eq!(
        (shown.code, shown.out.as_str()),
        (3, "off\n?\n"),
        "{shown:?}"
    );
    let shown = site.run("get gate.do0 kiln.k1");
    assert!(shown.out.starts_with("gate.do0  off"), "{shown:?}");
    assert!(
        shown.err.starts_with("error[E0301]: no reply from: kiln\n"),
        "{shown:?}"
    );
}

/// Asks the daemon; of an endless answer, the first part.
fn asked(site: &Site, line: &str) -> Ran {
    let line = format!("--socket {} {line}", site.socket());
    if !line.contains(" watch ") {
        return site.run(&line);
    }
    let mut child = site
        .command()
        .args(line.split(' '))
        .stdout(Stdio::piped())
        .spawn()
        .expect("railbus starts");
    let mut said = BufReader::new(child.stdout.take().expect("it is piped")).lines();
    // The headers of CSV contain no values yet.
    let word = said
        .by_ref()
        .map(|line| line.expect("text"))
        .find(|line| !line.starts_with("time,"));
    child.kill().expect("it ran");
    child.wait().expect("it ends");
    Ran {
        code: 0,
        out: word.unwrap_or_default() + "\n",
        err: String::new(),
    }
}

#[test]
fn what_was_read_too_long_ago_is_not_listed_as_if_it_were_now() {
    let mut site = plant("stale", "");
    let text = std::fs::read_to_string(site.folder.join("railbus.toml")).expect("a file");
    let slow = "address = 3\npoll = \"60s\"\nmax_age = \"300ms\"\n";
    site.configure(&text.replace("address = 3\n", slow));
    site.serve();
    let stale = (0..400).any(|_| {
        std::thread::sleep(Duration::from_millis(25));
        asked(&site, "get oven.k1 -o csv").out.ends_with(",stale\n")
    });
    assert!(stale, "it stays fresh");
    let modules = asked(&site, "ls -o json").json()["modules"].clone();
    let oven = modules.as_array().into_iter().flatten();
    let oven = oven.clone().find(|module| module["module"] == "oven");
    let oven = oven.expect("oven");
    assert_eq!(
        (&oven["state"], &oven["outputs"]),
        (&"online".into(), &"????????".into())
    );
}

/// Every command and form that shows the state of an output which was on and is unknown now.
fn tells_the_quality(run: &dyn Fn(&str) -> Ran, why: &str) {
    let value = run("get oven.k1 -o value");
    assert_eq!(value.out, "?\n", "{value:?}");
    assert_ne!(value.code, 0, "{value:?}");
    assert_eq!(run("get oven.k1 -o value --last-known").out, "on\n");
    let table = run("get oven.k1").out;
    assert!(
        table.starts_with("oven.k1  on  ") && table.contains(why),
        "{table}"
    );
    let csv = run("get oven.k1 -o csv").out;
    assert!(csv.ends_with(",on,,bad\n"), "{csv}");
    for format in ["json", "ndjson"] {
        let json = run(&format!("get oven.k1 -o {format}")).json();
        let point = match format {
            "json" => json["points"][0].clone(),
            _ => json,
        };
        assert_eq!(point["quality"], "bad", "{point}");
    }
    assert_eq!(run("ls points oven -o value").out.lines().next(), Some("?"));
    let table = run("ls points oven").out;
    assert!(table.lines().all(|line| line.contains(why)), "{table}");
    let modules = run("ls -o json").json()["modules"].clone();
    let mut modules = modules.as_array().expect("modules").iter();
    let oven = modules
        .find(|module| module["module"] == "oven")
        .expect("oven");
    assert_eq!(
        (&oven["outputs"], &oven["rtt_ms"]),
        (&"????????".into(), &Value::Null),
        "{oven}"
    );
    assert_eq!(oven["state"], "offline", "{oven}");
    let at = oven["last_good"].as_str().expect("when it was heard last");
    let listed = run("ls").out;
    assert!(listed.contains("????????"), "{listed}");
    assert!(
        listed.contains("offline, last good") && at.contains('T'),
        "{listed}"
    );
    let csv = run("ls -o csv").out;
    assert!(csv.contains("????????"), "{csv}");
    together_tells_the_quality(run);
    watch_tells_the_quality(run, why);
}

/// What groups and scenes report about outputs of which one is unknown now: the group has no state,
/// and a failure is reported with its error in every form.
fn together_tells_the_quality(run: &dyn Fn(&str) -> Ran) {
    for (line, no_states) in [
        ("ls groups -o csv", "group,frames"),
        ("scene list -o csv", "scene"),
        (
            "export csv",
            "point,module,label,index,line,port,model,address,protocol,baud,format,name_en,name_zh",
        ),
    ] {
        let ran = run(line);
        assert_eq!(ran.out.lines().next(), Some(no_states), "{line}: {ran:?}");
    }
    for line in [
        "set @night on",
        "set oven.k1=on yard.k1=on",
        "scene run evening",
    ] {
        let told = |format: &str| {
            let ran = run(&format!("{line} -o {format}"));
            assert_ne!(ran.code, 0, "{line}: {ran:?}");
            let mut rows = ran.out.lines();
            let of_oven = rows.find(|row| row.contains("oven.k1") || format == "value");
            of_oven
                .unwrap_or_else(|| panic!("{line}: {ran:?}"))
                .to_owned()
        };
        let table = told("table");
        assert!(table.starts_with("oven.k1  E0"), "{line}: {table}");
        let csv = told("csv");
        let error = csv.strip_prefix("oven.k1,,,,,E0");
        assert_eq!(error.map(str::len), Some(3), "{line}: {csv}");
        assert_eq!(told("value"), "?", "{line}");
        let json: Value = serde_json::from_str(&told("json")).expect("JSON");
        let oven = &json["set"][0];
        assert!(oven["error"]["code"].is_string(), "{line}: {oven}");
        assert!(oven["value"].is_null(), "{line}: {oven}");
    }
}

/// The first reading of the output in `watch`, in every form.
fn watch_tells_the_quality(run: &dyn Fn(&str) -> Ran, why: &str) {
    let first = |format: &str| run(&format!("watch oven.k1 -o {format}")).out;
    let table = first("table");
    assert!(
        table.contains("oven.k1  on  ") && table.contains(why),
        "{table}"
    );
    let csv = first("csv");
    assert!(csv.contains(",oven.k1,on,bad,"), "{csv}");
    assert_eq!(first("value"), "?\n");
    for format in ["json", "ndjson"] {
        let point: Value = serde_json::from_str(&first(format)).expect("JSON");
        assert_eq!(point["quality"], "bad", "{point}");
    }
}

/// An adapter that passes a reply on byte by byte: the module never comes online, commands expire,
/// and the received bytes are reported.
#[test]
fn replies_in_pieces_are_told_where_a_command_expires() {
    let piece = |at: usize, byte: u8| (Duration::from_millis(100 * at as u64), vec![byte]);
    let reply = [3, 1, 1, 0, 0x51, 0xF0];
    let port = slave(move |_, _| (0..).zip(reply).map(|(at, byte)| piece(at, byte)).collect());
    let mut site = Site::empty("pieces");
    site.configure(&format!(
        "[line.main]\nport = \"pty:{port}\"\n\
        [module.oven]\nline = \"main\"\nmodel = \"erc8\"\naddress = 3\n"
    ));
    site.serve();
    std::thread::sleep(Duration::from_secs(2));
    let ran = asked(&site, "set oven.k1 on");
    assert!(ran.err.starts_with("error[E0106]: "), "{ran:?}");
    assert!(
        ran.err.contains("no valid reply from oven: requests: ")
            && ran.err.contains("two modules on one address"),
        "{ran:?}"
    );
    let zh = asked(&site, "--lang zh set oven.k1 on");
    assert!(zh.err.contains("oven 没有有效应答：请求 "), "{zh:?}");
}

/// A 0x55 board does not report how many channels it has: if it answers except for one of them,
/// that is reported; if it is silent, it is not.
#[test]
fn a_channel_that_a_board_may_not_have_is_told() {
    let mut site = plant("channel", "");
    let text = std::fs::read_to_string(site.folder.join("railbus.toml")).expect("a file");
    site.configure(&text.replace("outputs = 8\n", "outputs = 32\n"));
    let hint =
        "the board answers, but not for k20: does it have that many relays? See outputs of yard";
    let zh = "此板有应答，但 k20 无响应：是否有这么多路继电器？请核对 yard 的 outputs";
    let whys = |error: &Value| error["why"].to_string();
    for served in [false, true] {
        let socket = match served {
            true => format!("--socket {} ", site.socket()),
            false => String::new(),
        };
        if served {
            site.serve();
            let first = (0..400).any(|_| {
                std::thread::sleep(Duration::from_millis(25));
                asked(&site, "get yard.k1 -o csv").out.ends_with(",good\n")
            });
            assert!(first, "it was never read");
        }
        let run = |line: &str| site.run(&format!("{socket}{line}"));
        for line in ["set yard.k20 on", "pulse yard.k20 300ms"] {
            let ran = run(line);
            assert_eq!(ran.code, 3, "{ran:?}");
            assert!(ran.err.contains(hint), "{line}: {ran:?}");
            let error = run(&format!("--lang zh {line} -o json")).error();
            assert!(whys(&error).contains(zh), "{error}");
        }
        let both = run("set yard k19=on k20=on");
        let told = "error[E0601]: not verified: yard was acknowledged";
        assert!(both.err.starts_with(told), "{both:?}");
    }
    power(&site, "yard", "off");
    let silent = (0..400).any(|_| {
        std::thread::sleep(Duration::from_millis(25));
        asked(&site, "get yard.k1 -o csv").out.ends_with(",bad\n")
    });
    assert!(silent, "it goes on");
    let error = asked(&site, "set yard.k20 on -o json").error();
    assert!(!whys(&error).contains("relays"), "{error}");
}

#[test]
fn how_good_a_value_is_stands_beside_it_in_every_form() {
    const TOGETHER: &str = "[group.night]\nmembers = [\"oven.k1\", \"yard.k1\"]\n\
        [scene.evening]\nsteps = [{ set = \"oven.k1\", to = true },\n\
        { set = \"yard.k1\", to = true }]\n";
    let mut site = plant("quality", TOGETHER);
    site.serve();
    let socket = site.socket();
    let run = |line: &str| asked(&site, line);
    let until = |what: &dyn Fn() -> bool| {
        let came = (0..400).any(|_| {
            std::thread::sleep(Duration::from_millis(25));
            what()
        });
        assert!(came, "it did not come");
    };
    until(&|| run("set oven.k1 on").code == 0);
    let is_bad = || run("get oven.k1 -o csv").out.ends_with(",bad\n");
    power(&site, "oven", "off");
    until(&is_bad);
    tells_the_quality(&run, "offline");
    let history = run("history oven.k1 -o value");
    assert_eq!(history.out.lines().last(), Some("?"), "{history:?}");
    power(&site, "oven", "on");
    until(&|| run("set oven.k1 on").code == 0);
    // The adapter is pulled out: its name goes as well, or it would lead to another test's
    // terminal.
    site.end_first();
    let run = |line: &str| asked(&site, line);
    until(&|| run("get oven.k1 -o csv").out.ends_with(",bad\n"));
    tells_the_quality(&run, "port missing");
    let told = run("get oven.k1");
    assert_eq!(told.code, 7, "{told:?}");
    assert!(told.err.starts_with("error[E0705]: "), "{told:?}");
    // The daemon is gone: nothing is known, and that is what is reported.
    site.stop_first();
    for line in [
        "get oven.k1 -o value",
        "ls",
        "ls points oven -o value",
        "ls -o csv",
        "ls groups",
        "scene list",
        "watch oven.k1",
        "watch oven.k1 -o csv",
        "set @night on",
        "set oven.k1=on yard.k1=on -o csv",
        "scene run evening -o value",
        "history oven.k1",
    ] {
        let ran = site.run(&format!("--socket {socket} {line}"));
        assert_ne!(ran.code, 0, "{line}: {ran:?}");
        assert_eq!(ran.out, "", "{line}: {ran:?}");
    }
}

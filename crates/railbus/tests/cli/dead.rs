//! Where a value stands, how good it is stands beside it: of modules that are dead, of lines that
//! are not there, and where the daemon is gone.

use crate::site::{Ran, Site};
use serde_json::Value;

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

/// Every command and form that shows the state of an output which was on and is not known now.
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
}

#[test]
fn how_good_a_value_is_stands_beside_it_in_every_form() {
    let mut site = plant("quality", "");
    site.serve();
    let socket = site.socket();
    let run = |line: &str| site.run(&format!("--socket {socket} {line}"));
    let until = |what: &dyn Fn() -> bool| {
        let came = (0..400).any(|_| {
            std::thread::sleep(std::time::Duration::from_millis(25));
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
    // The adapter is pulled out.
    site.stop_first();
    let run = |line: &str| site.run(&format!("--socket {socket} {line}"));
    until(&|| run("get oven.k1 -o csv").out.ends_with(",bad\n"));
    tells_the_quality(&run, "port missing");
    let told = run("get oven.k1");
    assert_eq!(told.code, 7, "{told:?}");
    assert!(told.err.starts_with("error[E0705]: "), "{told:?}");
    // The daemon is gone: nobody knows anything, and that is what is told.
    site.stop_first();
    for line in [
        "get oven.k1 -o value",
        "ls",
        "ls points oven -o value",
        "watch oven.k1",
    ] {
        let ran = site.run(&format!("--socket {socket} {line}"));
        assert_ne!(ran.code, 0, "{line}: {ran:?}");
        assert_eq!(ran.out, "", "{line}: {ran:?}");
    }
}

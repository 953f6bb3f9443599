//! Another model at a module's address: reported everywhere, given no commands, and forgotten as
//! soon as the right one is back.

use crate::site::{Ran, Site};
use std::io::{Read, Write};
use std::os::unix::net::UnixStream;
use std::time::{Duration, Instant};

/// An EDA9050 and an EDA9060A out of their boxes; the second one has no power yet.
const PLANT: &str = "[line.main]\nport = \"pty:LINE\"\n\
    [module.wrong]\nline = \"main\"\nmodel = \"eda9050\"\naddress = 3\n\
    sim = { factory = true }\n\
    [module.right]\nline = \"main\"\nmodel = \"eda9060a\"\naddress = 2\n\
    sim = { factory = true, power = \"off\" }\n";

/// The configuration.
const CONFIG: &str = "[line.main]\nport = \"pty:LINE\"\n\
    [module.pump]\nline = \"main\"\nmodel = \"eda9060a\"\naddress = 1\n";

fn site(name: &str) -> Site {
    let mut site = Site::empty(name);
    let line = site.folder.join("line").display().to_string();
    let plant = PLANT.replace("LINE", &line);
    std::fs::write(site.folder.join("plant.toml"), plant).expect("a file");
    site.start(&["sim", "plant.toml", "--control", "./ctl"], "commands");
    site.configure(&CONFIG.replace("LINE", &line));
    site
}

/// Runs a command, against the daemon if there is one.
fn run(site: &Site, line: &str) -> Ran {
    let socket = site.socket();
    let mut words: Vec<&str> = line.split(' ').collect();
    if std::path::Path::new(&socket).exists() {
        words.extend(["--socket", &socket]);
    }
    site.run_with(&words, "")
}

/// Takes one module off the line and puts the other one there, once it is missed: no hand is so
/// fast that no poll comes in between.
fn swap(site: &Site, out: &str, into: &str) {
    power(site, &format!("{out} off"));
    until(site, "offline");
    power(site, &format!("{into} on"));
}

fn power(site: &Site, order: &str) {
    let ran = site.run_with(&["sim", "ctl", "./ctl", &format!("power {order}")], "");
    assert_eq!(ran.code, 0, "{ran:?}");
}

/// Waits until the module is reported like this.
fn until(site: &Site, state: &str) -> serde_json::Value {
    let begun = Instant::now();
    loop {
        let module = run(site, "ls -o json").json()["modules"][0].clone();
        if module["state"] == state {
            return module;
        }
        assert!(begun.elapsed() < Duration::from_secs(15), "{module}");
        std::thread::sleep(Duration::from_millis(20));
    }
}

fn refused(ran: &Ran) {
    let error = ran.error();
    assert_eq!(
        (ran.code, &error["code"], &error["answers_as"]),
        (4, &"E0402".into(), &"EDA9050".into()),
        "{ran:?}"
    );
    assert!(error["may_have_acted"].is_null(), "{ran:?}");
}

/// What the daemon answers to a request.
fn asked(site: &Site, method: &str, path: &str, body: &str) -> String {
    let mut daemon = UnixStream::connect(site.socket()).expect("a daemon");
    let request = format!(
        "{method} /api/v1/{path} HTTP/1.1\r\nHost: railbus\r\nConnection: close\r\n\
         Content-Type: application/json\r\nContent-Length: {}\r\n\r\n{body}",
        body.len()
    );
    daemon.write_all(request.as_bytes()).expect("it listens");
    let mut told = String::new();
    daemon.read_to_string(&mut told).expect("text");
    told
}

/// Changes keys of the module in the configuration of the daemon.
fn change(site: &Site, keys: &str) {
    let told = asked(site, "PATCH", "config/modules/pump", keys);
    assert!(told.starts_with("HTTP/1.1 200 "), "{told}");
}

/// It is reported as the configured module, with all its values, and nowhere as another model.
fn is_taken_for_the_model(site: &Site) {
    let module = until(site, "online");
    assert!(module["answers_as"].is_null(), "{module}");
    let get = run(site, "get pump --fresh -o json");
    assert_eq!(get.code, 0, "{get:?}");
    for point in get.json()["points"].as_array().expect("points") {
        assert_eq!(point["quality"], "good", "{point}");
    }
    let doctor = run(site, "doctor").out;
    assert!(!doctor.contains("D307"), "{doctor}");
}

/// All its outputs are off, whatever was commanded.
fn is_untouched(site: &Site, module: &str) -> bool {
    let show = format!("show {module}");
    let shown = site.run_with(&["sim", "ctl", "./ctl", &show], "").out;
    shown.contains("; outputs 00000000;")
}

#[test]
fn another_model_is_told_everywhere_and_gets_no_commands() {
    let mut site = site("stranger");
    site.serve();
    let module = until(&site, "other_model");
    assert_eq!(module["answers_as"], "EDA9050", "{module}");
    assert_eq!(
        (&module["outputs"], &module["inputs"]),
        (&"????".into(), &"????".into())
    );
    let table = run(&site, "ls").out;
    assert!(table.contains("other model (EDA9050)"), "{table}");
    let point = run(&site, "ls points -o json").json()["points"][0].clone();
    assert_eq!(
        (
            &point["quality"],
            &point["reason"],
            point["value"].is_null()
        ),
        (&"bad".into(), &"other_model".into(), true),
        "{point}"
    );
    let table = run(&site, "ls points").out;
    assert!(table.contains("other model"), "{table}");
    refused(&run(&site, "get pump.do0 -o json"));
    for order in ["set pump.do0 on -o json", "pulse pump.do0 200ms -o json"] {
        refused(&run(&site, order));
    }
    let told = run(&site, "set pump.do0 on").err;
    let why = "the module reports EDA9050; the configuration says EDA9060A";
    assert!(told.contains(why), "{told}");
    assert!(is_untouched(&site, "wrong"));
    let doctor = run(&site, "doctor").out;
    assert!(doctor.contains("D307") && doctor.contains(why), "{doctor}");

    swap(&site, "wrong", "right");
    let module = until(&site, "online");
    assert!(module["answers_as"].is_null(), "{module}");
    let set = run(&site, "set pump.do0 on");
    assert!(set.code == 0 && set.out.contains("read back"), "{set:?}");
    assert_eq!(
        run(&site, "ls -o json").json()["modules"][0]["outputs"],
        "1000"
    );

    // And the wrong one once more: it is never reported as the right one.
    swap(&site, "right", "wrong");
    let begun = Instant::now();
    loop {
        let module = run(&site, "ls -o json").json()["modules"][0].clone();
        match module["state"].as_str() {
            Some("offline") => {}
            Some("other_model") => break,
            state => panic!("{state:?}"),
        }
        assert!(begun.elapsed() < Duration::from_secs(15), "{module}");
    }
    let events = asked(&site, "GET", "events", "");
    assert_eq!(
        events.matches("\"module_other_model\"").count(),
        2,
        "{events}"
    );
    assert!(events.contains("\"text\":\"EDA9050\""), "{events}");
}

#[test]
fn without_a_daemon_too() {
    let site = site("stranger-direct");
    let module = until(&site, "other_model");
    assert_eq!(module["answers_as"], "EDA9050", "{module}");
    refused(&run(&site, "get pump.do0 -o json"));
    refused(&run(&site, "set pump.do0 on -o json"));
    assert!(is_untouched(&site, "wrong"));
    let doctor = run(&site, "doctor").out;
    assert!(doctor.contains("D307"), "{doctor}");
    power(&site, "wrong off");
    power(&site, "right on");
    assert_eq!(run(&site, "set pump.do0 on").code, 0);
    assert_eq!(until(&site, "online")["outputs"], "1000");
}

#[test]
fn who_is_not_to_be_asked_is_taken_for_the_model() {
    let mut site = site("stranger-unasked");
    let file = site.folder.join("railbus.toml");
    let config = || std::fs::read_to_string(&file).expect("a file");
    // Without a daemon nothing is polled, and the key works there too.
    site.configure(&format!("{}identify = false\n", config()));
    is_taken_for_the_model(&site);

    site.serve();
    is_taken_for_the_model(&site);
    let events = asked(&site, "GET", "events", "");
    assert!(!events.contains("module_other_model"), "{events}");
    // Meanwhile a different key is changed.
    change(&site, "{\"poll\":\"100ms\"}");
    assert!(config().contains("identify = false"), "{}", config());
    is_taken_for_the_model(&site);

    // A running daemon does not have to restart to begin or stop asking for the model.
    change(&site, "{\"identify\":null}");
    assert!(!config().contains("identify"), "{}", config());
    until(&site, "other_model");
    refused(&run(&site, "set pump.do0 on -o json"));
    change(&site, "{\"identify\":false}");
    is_taken_for_the_model(&site);
    let set = run(&site, "set pump.do0 on");
    assert_eq!(set.code, 0, "{set:?}");
}

//! The evening when forty modules come out of their boxes, by a script of railbus commands alone.

#[path = "cli/site.rs"]
mod site;

use site::Site;
use std::fmt::Write;

const FAMILIES: [&str; 5] = ["eda9060a", "eda9050", "erc8", "r55", "emd2a2q"];
const MODULES: usize = 40;

/// The modules on the lines: all new, and without power.
fn plant(site: &Site) -> String {
    let mut text = String::new();
    for line in ["north", "south"] {
        let pty = site.folder.join(line);
        let _ = writeln!(text, "[line.{line}]\nport = \"pty:{}\"", pty.display());
    }
    for at in 0..MODULES {
        let (line, family) = (["north", "south"][at / 20], FAMILIES[at % 5]);
        let outputs = if family == "r55" { "outputs = 8\n" } else { "" };
        let _ = writeln!(
            text,
            "[module.m{:02}]\nline = \"{line}\"\nmodel = \"{family}\"\naddress = {}\n{outputs}\
             sim = {{ factory = true, power = \"off\" }}",
            at + 1,
            at % 20 + 2,
        );
    }
    text
}

#[test]
fn forty_new_modules_are_commissioned_by_a_script() {
    let mut site = Site::empty("forty");
    std::fs::write(site.folder.join("plant.toml"), plant(&site)).expect("a file");
    site.start(&["sim", "plant.toml", "--control", "./ctl"], "commands");
    let program = std::path::Path::new(env!("CARGO_BIN_EXE_railbus"));
    let path = std::env::var("PATH").unwrap_or_default();
    let script = std::process::Command::new("sh")
        .args(["-c", include_str!("commissioning/commission.sh")])
        .current_dir(&site.folder)
        .env(
            "PATH",
            format!("{}:{path}", program.parent().expect("a folder").display()),
        )
        .env("HOME", &site.folder)
        .env("RAILBUS_LANG", "en")
        .env_remove("RAILBUS_CONFIG")
        .env("RAILBUS_RUN", site.folder.join("run"))
        .output()
        .expect("a shell");
    let said = String::from_utf8_lossy(&script.stderr);
    assert!(script.status.success(), "{said}");
    // The modules themselves say where they are now.
    for at in 0..MODULES {
        let told = site.run(&format!("sim ctl ./ctl show m{:02}", at + 1)).out;
        let place = format!(" {} ({:02X}h) ", at % 20 + 2, at % 20 + 2);
        let settings = match FAMILIES[at % 5] {
            "eda9060a" | "eda9050" => "ascii 19200 8N1; checksum on",
            "r55" => "r55 9600 8N1",
            _ => "rtu 19200 8N1",
        };
        assert!(told.contains(&place) && told.contains(settings), "{told}");
    }
    let backup = std::fs::read_to_string(site.folder.join("site.json")).expect("a backup");
    let backup: serde_json::Value = serde_json::from_str(&backup).expect("JSON");
    assert_eq!(
        backup["modules"].as_object().map(|all| all.len()),
        Some(MODULES)
    );
    // And a daemon reads all of them.
    site.serve();
    let socket = site.socket();
    let online = || {
        let ls = site.run(&format!("--socket {socket} ls -o json")).json();
        let modules = ls["modules"].as_array().cloned().unwrap_or_default();
        let online = modules.iter().filter(|module| module["state"] == "online");
        online.count()
    };
    let all = (0..300).any(|_| {
        std::thread::sleep(std::time::Duration::from_millis(100));
        online() == MODULES
    });
    assert!(all, "{} of {MODULES} are online", online());
}

//! How each exit code is reached: every code of the table is covered.

use crate::liar::liar;
use crate::site::{Site, signal};
use rustix::process::Signal;
use std::io::{BufRead, BufReader};
use std::process::Stdio;

/// A run that ends with the code; none if that takes more than a command line.
fn reached(site: &Site, exit: u8) -> Option<String> {
    let port = format!("pty:{}", site.folder.join("line").display());
    Some(match exit {
        0 => "version".to_owned(),
        1 => "-l /dev/none-such doctor".to_owned(),
        2 => "get".to_owned(),
        3 => format!("-l {port} -m erc8 -a 9 get erc8"),
        4 => format!("-l {port} -m erc8 -a 5 set erc8.k1 on"),
        5 => "decode FF".to_owned(),
        6 => {
            // It acknowledges every command, and its relays stay off.
            let yes = liar(|request| match request[1] {
                1 => vec![3, 1, 1, 0, 0x50, 0x30],
                _ => request.to_vec(),
            });
            format!("-l pty:{yes} -m erc8 -a 3 set erc8.k1 on")
        }
        7 => "-l /dev/none-such scan --addr 1".to_owned(),
        8 => "get nosuch".to_owned(),
        9 => "serve --demo --listen 0.0.0.0:0".to_owned(),
        10 => {
            // A configured module that is missing is a difference.
            let text = std::fs::read_to_string(site.folder.join("railbus.toml"));
            let shed = "\n[module.shed]\nline = \"main\"\nmodel = \"erc8\"\naddress = 9\n";
            let text = text.expect("a file") + shed;
            std::fs::write(site.folder.join("more.toml"), text).expect("a file");
            "--config more.toml plan --exit-code".to_owned()
        }
        11 => "set pump.do0=on tank.k9=on".to_owned(),
        12 => "wait pump.do1=on --timeout 1ms".to_owned(),
        _ => return None,
    })
}

#[test]
fn every_exit_code_is_reached() {
    let site = Site::demo("exits");
    let table = site.run("help exit-codes -o json").json();
    let exits = table["exits"].as_array().expect("a table").clone();
    assert!(exits.len() >= 13, "{exits:?}");
    for exit in exits {
        let code = exit["exit"]
            .as_u64()
            .and_then(|code| u8::try_from(code).ok());
        let code = code.expect("a byte");
        let ended = match reached(&site, code) {
            Some(line) => site.run(&line).code,
            None if code == 130 => interrupted(&site),
            None => panic!("nothing reaches {exit}"),
        };
        assert_eq!(ended, i32::from(code), "{exit}");
    }
}

/// Ctrl-C as soon as something was found.
fn interrupted(site: &Site) -> i32 {
    let mut child = site
        .command()
        .args(["scan", "--addr", "1-200", "-o", "ndjson"])
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .expect("railbus starts");
    let mut stdout = BufReader::new(child.stdout.take().expect("it is piped"));
    let mut found = String::new();
    stdout.read_line(&mut found).expect("text");
    signal(&child, Signal::INT);
    std::io::copy(&mut stdout, &mut std::io::sink()).expect("text");
    child.wait().expect("it ends").code().unwrap_or(-1)
}

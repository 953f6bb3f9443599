//! The integrations of a daemon: what is listed of them, their addresses, and a test.

use crate::published::{Forms, keeps_to};
use crate::site::Site;
use std::net::{Ipv4Addr, TcpListener};

const SITE: &str = "[line.main]\nport = \"/dev/railbus-test-nothing\"\n\
                    [module.oven]\nline = \"main\"\nmodel = \"erc8\"\naddress = 3\n";

#[test]
fn integrations_are_listed_tried_and_mapped() {
    let free = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).expect("a port");
    let at = free.local_addr().expect("an address");
    drop(free);
    let mut site = Site::empty("outlets");
    site.configure(&format!(
        "{SITE}[outlet.scada]\ntype = \"modbus_tcp\"\nlisten = \"{at}\"\n\
         [outlet.spare]\ntype = \"modbus_tcp\"\nlisten = \"{at}\"\nenabled = false\n\
         [webhook.spare]\nurl = \"http://127.0.0.1:9/hook\"\n"
    ));
    site.serve();
    let socket = site.socket();
    let run = |line: &str| site.run(&format!("{line} --socket {socket}"));
    let mut forms = Forms::of(&site, "outlet");
    let mut one = |line: &str| {
        let line = format!("{line} -o json");
        let documents = keeps_to(&site, &line, &run(&line));
        forms.see(&documents);
        documents[0].clone()
    };
    // It listens as soon as a test can reach it, which waits for nothing.
    let listens = (0..200).any(|_| run("outlet test scada").code == 0);
    assert!(listens, "{:?}", run("outlet test scada"));
    let tried = one("outlet test scada");
    assert!(tried["answer"].as_str().expect("text").contains("railbus"));
    let listed = one("outlet list");
    assert_eq!(listed["outlets"][0]["state"], "running");
    assert!(listed["outlets"][0]["clients"].is_number(), "{listed}");
    let map = one("outlet map modbus_tcp/scada");
    assert_eq!(map["rows"][0][2], "k1");
    forms.all_seen();
    let table = run("outlet list").out;
    let spare = table.lines().find(|line| line.starts_with("spare"));
    assert!(spare.expect("a row").contains(" off "), "{table}");
    let csv = run("outlet map scada -o csv --lang en").out;
    assert!(csv.starts_with("Unit,Module,Point,Table,"), "{csv}");
    assert!(csv.contains("\n3,oven,k1,coil,60,"), "{csv}");
    // Two kinds have one of this name.
    let either = run("outlet map spare -o json");
    assert_eq!(either.error()["code"], "E0864", "{either:?}");
    assert_eq!(run("outlet map modbus_tcp/spare -o csv").code, 0);
    let unknown = run("outlet map nosuch -o json");
    assert_eq!(
        (unknown.code, &unknown.error()["code"]),
        (8, &"E0864".into())
    );
    assert_eq!(unknown.error()["known"][0], "modbus_tcp/scada");
}

/// Integrations run in a daemon only.
#[test]
fn without_a_daemon_there_are_none() {
    let site = Site::empty("outlets-alone");
    site.configure(SITE);
    let ran = site.run("outlet list -o json");
    assert_eq!(ran.error()["code"], "E0109", "{ran:?}");
    assert_eq!(ran.error()["hint"][0], "railbus serve", "{ran:?}");
}

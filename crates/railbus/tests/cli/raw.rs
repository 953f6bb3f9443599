//! Raw frames on a line opened here: a late reply counts for no request.

use crate::liar::{Replies, slave};
use crate::site::Site;
use railbus_wire::crc16;
use std::process::Stdio;
use std::sync::mpsc;
use std::time::Duration;

const READ: &str = "raw --crc 03 01 00 3C 00 08 -o json";
const ON: &str = "raw --crc 03 05 00 3C FF 00 -o json";

fn rtu(head: &[u8]) -> Vec<u8> {
    let mut frame = head.to_vec();
    frame.extend(crc16(head).to_le_bytes());
    frame
}

fn coils(on: u8) -> Vec<u8> {
    rtu(&[3, 1, 1, on])
}

fn after(ms: u64, bytes: Vec<u8>) -> (Duration, Vec<u8>) {
    (Duration::from_millis(ms), bytes)
}

/// The first reply comes 400 ms after its request, which waited 100 ms for it; by then another
/// request was sent, and is answered after it. Outputs are 5 at first, then 10.
fn late() -> String {
    slave(|number, _| -> Replies {
        match number {
            0 => vec![after(400, coils(5))],
            _ => vec![after(200, coils(10))],
        }
    })
}

#[test]
fn a_late_reply_is_not_taken_for_that_to_the_next_raw_frame() {
    let site = Site::empty("raw-late");
    let port = late();
    let first = site.run(&format!("-l pty:{port} {READ} --timeout 100ms"));
    assert_eq!(first.code, 3, "{first:?}");
    let second = site.run(&format!("-l pty:{port} {READ}"));
    let bytes = second.json()["bytes"].clone();
    assert_eq!(bytes, "03 01 01 0A D0 37", "{second:?}");
}

#[test]
fn a_late_reply_is_not_taken_for_that_to_the_next_get() {
    let site = Site::empty("raw-get");
    let port = late();
    let first = site.run(&format!("-l pty:{port} {READ} --timeout 100ms"));
    assert_eq!(first.code, 3, "{first:?}");
    let get = format!("-l pty:{port} -m erc8 -a 3 get erc8.k1 erc8.k2 -o value");
    let told = site.run(&get);
    assert_eq!((told.code, told.out.as_str()), (0, "off\non\n"), "{told:?}");
}

/// A module's reply to a command of one coil repeats that command, and an adapter that echoes does
/// so for a dead module.
#[test]
fn an_echo_is_no_acknowledgement_of_a_dead_module() {
    let site = Site::empty("raw-echo");
    let port = slave(|_, request| vec![after(2, request.to_vec())]);
    let told = site.run(&format!("-l pty:{port} {ON}"));
    assert_eq!(told.code, 3, "{told:?}");
    assert_eq!(told.error()["code"], "E0301", "{told:?}");
    assert_eq!(told.json()["bytes"], "", "{told:?}");
}

#[test]
fn an_acknowledgement_is_told_with_an_echo_and_without() {
    let site = Site::empty("raw-ack");
    for echo in [false, true] {
        let port = slave(move |_, request| {
            let reply = match request[1] {
                5 => request.to_vec(),
                _ => rtu(&[3, 0x81, 2]),
            };
            let echo = echo.then(|| after(2, request.to_vec()));
            echo.into_iter().chain([after(20, reply)]).collect()
        });
        let told = site.run(&format!("-l pty:{port} {ON}"));
        assert_eq!(told.code, 0, "{told:?}");
        assert_eq!(told.json()["bytes"], "03 05 00 3C FF 00 4D D4", "{told:?}");
    }
}

/// Bytes that are no request of any protocol are sent if that is confirmed; what comes back is
/// shown as it is.
#[test]
fn what_nobody_knows_is_sent_and_not_interpreted() {
    let site = Site::empty("raw-unknown");
    let port = slave(|_, _| vec![after(20, vec![1, 2, 3])]);
    let told = site.run(&format!(
        "-l pty:{port} raw FF FE FD FC FB FA F9 F8 --yes -o json"
    ));
    assert_eq!(
        (told.code, &told.json()["bytes"]),
        (0, &"01 02 03".into()),
        "{told:?}"
    );
    assert_eq!(told.json()["meaning"], serde_json::Value::Null, "{told:?}");
}

/// A killed process can't wait for the reply to its request, which comes 300 ms later: the next
/// user of the port waits until it has come.
#[test]
fn the_reply_to_one_that_was_killed_is_not_taken_for_that_to_the_next() {
    let site = Site::empty("killed");
    let (asked, was_asked) = mpsc::channel();
    let port = slave(move |number, _| {
        let _ = asked.send(());
        match number {
            0 => vec![after(300, coils(5))],
            _ => vec![after(200, coils(10))],
        }
    });
    let get = format!("-l pty:{port} -m erc8 -a 3 get erc8.k1 erc8.k2 -o value");
    let mut killed = site
        .command()
        .args(get.split(' '))
        .stdout(Stdio::null())
        .spawn()
        .expect("railbus starts");
    was_asked.recv().expect("a request");
    killed.kill().expect("it runs");
    killed.wait().expect("it ends");
    let told = site.run(&get);
    assert_eq!((told.code, told.out.as_str()), (0, "off\non\n"), "{told:?}");
}

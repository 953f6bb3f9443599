//! Captures played again: by one as the modules, by another as the host.

use crate::published::keeps_to;
use crate::site::{Ran, Site};
use crate::sniff::{Wire, captured, faulty, listening};
use railbus_sniff::capture;
use railbus_wire::{Instant, crc16};

/// A file of requests and their replies, some of them writes.
pub(crate) fn asked_of_the_demo(site: &Site) -> String {
    let rtu = |head: &[u8]| {
        let mut frame = head.to_vec();
        frame.extend(crc16(head).to_le_bytes());
        frame
    };
    let on = rtu(&[0x03, 0x05, 0x00, 0x3C, 0xFF, 0x00]);
    let frames = [
        b"$01M\r".to_vec(),
        b"!019060\r".to_vec(),
        rtu(&[0x03, 0x01, 0x00, 0x3C, 0x00, 0x08]),
        rtu(&[0x03, 0x01, 0x01, 0x55]),
        on.clone(),
        on,
        b"#**\r".to_vec(),
        b"%0102400600\r".to_vec(),
    ];
    let mut file = capture::header("test");
    file.extend(capture::interface("main", "9600 8N1"));
    for (number, frame) in frames.iter().enumerate() {
        let at = Instant(1_000_000 + 40_000 * number as u64);
        file.extend(capture::packet(0, at, frame, None, ""));
    }
    let path = site.folder.join("asked.pcapng");
    std::fs::write(&path, file).expect("a file");
    path.display().to_string()
}

#[test]
fn as_host_only_reads_are_sent_and_replies_are_compared() {
    let site = Site::demo("replay-host");
    let file = asked_of_the_demo(&site);
    let shown = site.run(&format!("replay {file} --as-host"));
    assert_eq!(shown.code, 0, "{shown:?}");
    let expected = "\
24 30 31 4D 0D  read name
  same: 21 30 31 39 30 36 30 0D
03 01 00 3C 00 08 FC 22  read 8 coils from 60
  differs: 03 01 01 00 50 30, recorded 03 01 01 55 90 0F
03 05 00 3C FF 00 4D D4  coil 60 on
  not sent: not a read, unknown, or also a command of another protocol
23 2A 2A 0D  all modules: sample now
  not sent: not a read, unknown, or also a command of another protocol
25 30 31 30 32 34 30 30 36 30 30 0D  configure: address 2 (02h), speed code 06h, format 00h
  not sent: not a read, unknown, or also a command of another protocol
";
    assert_eq!(shown.out, expected, "{shown:?}");
    assert_eq!(shown.err, "same: 1, different: 1, not sent: 3\n");
    assert_eq!(site.run("get oven.k1 -o value").out, "off\n");
    let coded = site.run(&format!(
        "replay {file} --as-host --exit-code -o json --lang zh"
    ));
    assert_eq!(
        (coded.code, coded.error()["code"].as_str()),
        (10, Some("E1080")),
        "{coded:?}"
    );
    let first = coded.out.lines().next().unwrap_or_default();
    let first: serde_json::Value = serde_json::from_str(first).expect("JSON");
    assert_eq!(
        (first["result"].as_str(), first["schema"].as_u64()),
        (Some("same"), Some(1))
    );
}

#[test]
fn writes_are_sent_only_where_that_was_said_and_confirmed() {
    let site = Site::demo("replay-writes");
    let file = asked_of_the_demo(&site);
    let asked = site.run(&format!("replay {file} --as-host --writes"));
    assert_eq!(asked.code, 2, "{asked:?}");
    assert!(asked.err.starts_with("error[E0202]"), "{asked:?}");
    let sent = site.run(&format!("replay {file} --as-host --writes --yes"));
    assert!(
        sent.out
            .contains("coil 60 on\n  same: 03 05 00 3C FF 00 4D D4"),
        "{sent:?}"
    );
    assert!(sent.err.ends_with("not sent: 2\n"), "{sent:?}");
    assert_eq!(site.run("get oven.k1 -o value").out, "on\n");
    let all = "--writes --yes --confirm broadcast";
    let all = site.run(&format!("replay {file} --as-host {all}"));
    assert!(
        all.out.contains("all modules: sample now\n  same: silence"),
        "{all:?}"
    );
    assert!(all.err.ends_with("not sent: 1\n"), "{all:?}");
}

#[test]
fn as_module_every_byte_is_answered_as_it_was() {
    let site = Site::empty("replay-module");
    let file = captured(&site).display().to_string();
    let wire = Wire::new();
    let arguments = [
        "replay",
        &file,
        "--as-module",
        "-l",
        &wire.name,
        "--count",
        "4",
        "-o",
        "ndjson",
    ];
    let (child, _) = listening(&site, &arguments, "replying on");
    let faulty = faulty();
    // A pair, a request that was answered differently each time, and one that never was.
    let read = &faulty[2].1;
    for (request, reply) in [
        (&faulty[0].1, Some(&faulty[1].1)),
        (read, Some(&faulty[3].1)),
        (read, Some(&faulty[11].1)),
    ] {
        wire.say(request);
        let wanted = reply.map(Vec::as_slice).unwrap_or_default();
        let mut heard: Vec<u8> = Vec::new();
        while heard.len() < wanted.len() {
            let mut buffer = [0; 64];
            let count = rustix::io::read(&wire.master, &mut buffer).expect("it answers");
            heard.extend(&buffer[..count]);
        }
        assert_eq!(heard, wanted);
    }
    wire.say(&[0x55, 0x09, 0x10, 0, 0, 0, 0, 0x6E]);
    let ended = child.wait_with_output().expect("it ends");
    let out = String::from_utf8(ended.stdout).expect("text");
    let last: serde_json::Value =
        serde_json::from_str(out.lines().last().unwrap_or_default()).expect("JSON");
    assert_eq!(
        (ended.status.code(), last["reply"].is_null()),
        (Some(0), true),
        "{out}"
    );
    let ran = Ran {
        code: 0,
        out,
        err: String::new(),
    };
    keeps_to(&site, "replay", &ran);
}

#[test]
fn what_can_not_be_played_is_told() {
    let site = Site::empty("replay-none");
    let mut file = capture::header("test");
    file.extend(capture::interface("main", "9600 8N1"));
    file.extend(capture::packet(0, Instant(5), &[0xFE, 0x00], None, ""));
    std::fs::write(site.folder.join("noise.pcapng"), file).expect("a file");
    let ran = site.run("replay noise.pcapng --as-host -l pty:/tmp/none");
    assert_eq!(ran.code, 1, "{ran:?}");
    assert!(
        ran.err.starts_with("error[E0183]: no request in the file"),
        "{ran:?}"
    );
    let both = site.run("replay noise.pcapng --as-host --as-module");
    assert_eq!(both.code, 2, "{both:?}");
    assert_eq!(site.run("replay noise.pcapng").code, 2);
}

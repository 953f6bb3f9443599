//! Commands that need no line.

use crate::site::Site;

#[test]
fn a_misprint_of_the_manual_is_known() {
    let site = Site::empty("misprint");
    let ran = site.run("decode 6C 63 01 03 22 34 0D");
    assert_eq!(ran.code, 5);
    assert!(ran.err.starts_with("error[E0502]: "), "{ran:?}");
    let lines: Vec<&str> = ran.out.lines().collect();
    assert_eq!(lines[0], "lc02 reply, address 1 (01h)");
    assert_eq!(lines[1], "  outputs do0 do1 on; inputs di1 di5 on");
    assert_eq!(lines[2], "  checksum  34  WRONG, should be 26");
    assert!(lines[3].starts_with("  known     E-01: "), "{ran:?}");
}

#[test]
fn frames_come_by_stdin_and_go_as_json() {
    let site = Site::empty("stdin");
    let ran = site.run_with(
        &["decode", "-", "-o", "ndjson"],
        "$01M\n55 04 10 00 00 00 00 69\n",
    );
    assert_eq!(ran.code, 0, "{ran:?}");
    let protocols: Vec<String> = ran
        .out
        .lines()
        .map(|line| serde_json::from_str::<serde_json::Value>(line).expect("JSON"))
        .map(|row| row["readings"][0]["protocol"].to_string())
        .collect();
    assert_eq!(protocols, ["\"ascii\"", "\"r55\""]);
}

#[test]
fn bytes_that_two_protocols_accept_are_shown_as_both() {
    let site = Site::empty("both");
    let ran = site.run("decode 550100030004C01D --all");
    assert_eq!(ran.code, 0, "{ran:?}");
    assert!(
        ran.out
            .contains("rtu request, address 85 (55h)\n  read 4 coils from 3\n"),
        "{ran:?}"
    );
    assert!(
        ran.out
            .contains("r55 request, address 1 (01h)\n  unknown function 00h\n"),
        "{ran:?}"
    );
}

#[test]
fn codes_are_explained_in_both_languages() {
    let site = Site::empty("explain");
    let ran = site.run("explain E0301");
    assert!(
        ran.out
            .starts_with("E0301  no reply within the time limit\n"),
        "{ran:?}"
    );
    let ran = site.run("explain e0301 --lang zh");
    assert!(
        ran.out.starts_with("E0301  无应答：限定时间内未收到应答\n"),
        "{ran:?}"
    );
    let codes = site.run("explain exit-codes");
    assert!(
        codes.out.contains("130  interrupted   Ctrl-C\n"),
        "{codes:?}"
    );
    let all = site.run("explain");
    for line in all.out.lines() {
        let code = line.split(' ').next().expect("a code");
        assert_eq!(site.run(&format!("explain {code}")).code, 0, "{line}");
    }
    for short in ["e301", "301", "0301", "E301"] {
        let ran = site.run(&format!("explain {short}"));
        assert!(ran.out.starts_with("E0301  "), "{short}: {ran:?}");
    }
    for wrong in ["E9999", "E", "999999999999", "301x"] {
        assert_eq!(site.run(&format!("explain {wrong}")).code, 2, "{wrong}");
    }
}

#[test]
fn models_and_ports_need_no_configuration() {
    let site = Site::empty("models");
    let ran = site.run("ls models -o value");
    assert_eq!(ran.out, "eda9060a\neda9050\nerc8\nr55\nemd2a2q\n");
    assert_eq!(site.run("ls ports -o json").json()["schema"], 1);
}

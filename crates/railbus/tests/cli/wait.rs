//! `railbus wait`: through the daemon and on a line opened here.

use crate::dead::{plant, power};
use crate::published::keeps_to;
use crate::site::{Ran, Site};
use std::process::Stdio;

/// What must hold whoever has the line.
fn waits(site: &Site, flags: &[&str]) {
    let run = |line: &str| {
        let line = format!("{} {line}", flags.join(" "));
        site.run(line.trim())
    };
    let there = run("wait pump.do1=off tank.k1=OFF tank.ai1=-10..20 -o csv");
    let lines: Vec<&str> = there.out.lines().collect();
    assert_eq!(there.code, 0, "{there:?}");
    assert_eq!(lines[0], "time,path,value,unit,quality,took_ms");
    assert!(lines[1].contains(",pump.do1,off,,good,"), "{there:?}");
    assert_eq!(lines.len(), 4, "{there:?}");

    // It comes while it is waited for, however slow the machine is.
    let mut command = site.command();
    command.args(flags);
    command.args(["wait", "pump.di1=on", "--timeout", "60s", "-o", "value"]);
    command.stdout(Stdio::piped()).stderr(Stdio::piped());
    let waiting = command.spawn().expect("it starts");
    assert_eq!(
        site.run_with(&["sim", "ctl", "ctl", "pump.di1 = 1"], "")
            .code,
        0
    );
    let ended = waiting.wait_with_output().expect("it ends");
    assert_eq!(ended.status.code(), Some(0), "{ended:?}");
    assert_eq!(ended.stdout, b"on\n");

    let vain = run("wait pump.di1=off tank.ai2=99 --timeout 3s");
    assert_eq!((vain.code, vain.out.as_str()), (12, ""), "{vain:?}");
    let told: Vec<&str> = vain.err.lines().collect();
    assert_eq!(told[0], "error[E1201]: not reached within 3.0 s");
    assert!(
        told[1].contains("waiting for pump.di1=off: it is on, read "),
        "{vain:?}"
    );
    assert!(
        told[2].contains("waiting for tank.ai2=99: it is "),
        "{vain:?}"
    );
    let json = run("-o json wait pump.di1=off --timeout 3s");
    keeps_to(site, "-o json wait", &json);
    let error = json.error();
    assert_eq!(error["points"][0]["value"], true, "{error}");
    assert!(error["points"][0]["age_ms"].is_u64(), "{error}");

    for wrong in [
        "pump.di1",
        "pump=on",
        "*.di1=on",
        "tank.ai1=on",
        "pump.di1=7",
    ] {
        let ran: Ran = run(&format!("wait {wrong}"));
        assert_eq!(ran.code, 2, "{wrong}: {ran:?}");
    }
    assert_eq!(run("wait pump.no=on").code, 8);

    // A value of which nothing is known any more does not count, though it is the wanted one.
    power(site, "oven", "off");
    if !flags.is_empty() {
        let is_missed = (0..400).any(|_| run("get oven.k1 -o value").out == "?\n");
        assert!(is_missed, "the daemon hears nothing more");
    }
    let dead = run("wait oven.k1=off --timeout 8s");
    let known = flags.is_empty().then_some("never read");
    assert_eq!(dead.code, 12, "{dead:?}");
    assert!(dead.err.contains(known.unwrap_or("offline")), "{dead:?}");
}

#[test]
fn through_the_daemon_it_waits_for_what_happens() {
    let mut site = plant("wait-daemon", "");
    site.serve();
    let socket = site.socket();
    waits(&site, &["--socket", &socket]);
}

#[test]
fn it_waits_on_a_line_opened_here() {
    let site = plant("wait-line", "");
    waits(&site, &[]);
}

//! The service: what the daemon reports to systemd, and systemd's rating of the unit.

use rustix::process::{Pid, Signal, kill_process};
use std::os::unix::net::UnixDatagram;
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::time::Duration;

const UNIT: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../../packaging/railbus.service"
);
/// What systemd calls "OK" ends at 4.9; the unit is well below, at most this, in tenths.
const EXPOSURE_MAX: &str = "25";

#[test]
fn systemd_hears_that_it_is_ready_alive_and_stopping() {
    let unique = format!("railbus-notify-{}", std::process::id());
    let folder = std::env::temp_dir().join(unique);
    std::fs::create_dir_all(&folder).expect("a folder");
    let path: PathBuf = folder.join("notify");
    let manager = UnixDatagram::bind(&path).expect("a socket");
    let patience = Some(Duration::from_secs(60));
    manager.set_read_timeout(patience).expect("a socket");
    let mut child = Command::new(env!("CARGO_BIN_EXE_railbus"))
        .args(["serve", "--demo", "--listen", "127.0.0.1:0", "--socket"])
        .arg(folder.join("socket"))
        .env("NOTIFY_SOCKET", &path)
        .env("WATCHDOG_USEC", "200000")
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .expect("railbus starts");
    let hear = || {
        let mut word = [0; 64];
        let len = manager.recv(&mut word).expect("a word");
        String::from_utf8_lossy(&word[..len]).into_owned()
    };
    assert_eq!(hear(), "READY=1\n");
    for _ in 0..3 {
        assert_eq!(hear(), "WATCHDOG=1\n");
    }
    kill_process(Pid::from_child(&child), Signal::TERM).expect("it runs");
    while hear() != "STOPPING=1\n" {}
    assert!(child.wait().expect("it ends").success());
    let _ = std::fs::remove_dir_all(&folder);
}

#[test]
fn the_unit_is_well_confined() {
    let text = std::fs::read_to_string(UNIT).expect("a file");
    for line in [
        "Type=notify",
        "DynamicUser=yes",
        "DevicePolicy=closed",
        "WatchdogSec=",
    ] {
        assert!(text.contains(line), "{line}");
    }
    let judged = Command::new("systemd-analyze")
        .args(["security", "--offline=true", "--no-pager"])
        .arg(format!("--threshold={EXPOSURE_MAX}"))
        .arg(UNIT)
        .output();
    // Without systemd there is no rating.
    if let Ok(judged) = judged {
        let told = String::from_utf8_lossy(&judged.stdout).into_owned();
        assert!(judged.status.success(), "{told}");
    }
}

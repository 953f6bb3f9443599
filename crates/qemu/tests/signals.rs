//! Whatever ends the program, nothing stays behind.

use rustix::process::{Pid, Signal, kill_process};
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};

/// How it is ended.
type End = fn(&mut Child);

/// A line without modules, once it is served.
fn serve(link: &Path) -> Child {
    let mut child = Command::new(env!("CARGO_BIN_EXE_railbus-qemu"))
        .arg(link)
        .args(["--images", "."])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("it starts");
    let stdout = child.stdout.take().expect("it is piped");
    let mut ready = String::new();
    let read = BufReader::new(stdout).read_line(&mut ready);
    assert_eq!((read.expect("text"), ready.as_str()), (3, "ok\n"));
    child
}

#[test]
fn what_ends_it_leaves_nothing_behind() {
    let ends: [(&str, End); 4] = [
        ("int", |child| signal(child, Signal::INT)),
        ("term", |child| signal(child, Signal::TERM)),
        ("hup", |child| signal(child, Signal::HUP)),
        ("input", |child| drop(child.stdin.take())),
    ];
    for (name, end) in ends {
        let unique = format!("railbus-qemu-{}-{name}", std::process::id());
        let link = std::env::temp_dir().join(unique);
        let mut child = serve(&link);
        assert!(link.is_symlink(), "{name}");
        end(&mut child);
        // To wait for it would end its input, too.
        let input = child.stdin.take();
        let status = child.wait().expect("it ends");
        drop(input);
        assert!(status.success(), "{name}: {status}");
        assert!(!link.is_symlink(), "{name}");
    }
}

fn signal(child: &Child, signal: Signal) {
    kill_process(Pid::from_child(child), signal).expect("it runs");
}

//! The audit log: nothing that was acknowledged is lost, and whatever is changed shows.

mod files;

use railbus_device::{Point, PointKind};
use railbus_host::Fault;
use railbus_site::{CommandError, Config, Service, WriteTerms};
use railbus_store::audit::{AuditLog, Filter, OpenReport, Verified, verify_folder};
use std::collections::BTreeMap;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

/// A line whose port is not there: commands are written down, and fail.
const CONFIG: &str = r#"
[line.main]
port = "/dev/no-such-port"

[module.oven]
line = "main"
model = "erc8"
address = 3
"#;

const K1: Point = Point {
    kind: PointKind::Output,
    index: 0,
};

/// A folder that goes with the test.
struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Folder {
        let path = std::env::temp_dir().join(format!("railbus-{name}-{}", std::process::id()));
        let _ = std::fs::remove_dir_all(&path);
        std::fs::create_dir_all(&path).unwrap();
        Folder(path)
    }

    fn log(&self) -> PathBuf {
        self.0.join("audit.log")
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

async fn site(folder: &Path) -> Service {
    let service = Service::start_quiet(Config::parse(CONFIG).unwrap()).unwrap();
    let log = reopened(folder).await.0;
    let keep = std::env::var("AUDIT_KEEP");
    log.keep(keep.ok().and_then(|bytes| bytes.parse().ok()));
    service.keep_audit(log);
    service
}

/// The log of a folder, once whoever had it before has let go of it.
async fn reopened(folder: &Path) -> (AuditLog, OpenReport) {
    for _ in 0..1_000 {
        if let Ok(opened) = AuditLog::open(folder) {
            return opened;
        }
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
    panic!("the log is never free");
}

/// What a check of a folder finds, once whoever wrote its log has let go of it.
fn checked(folder: &Path) -> Verified {
    for _ in 0..1_000 {
        match verify_folder(folder) {
            Err(error) if error.kind() == ErrorKind::WouldBlock => {
                std::thread::sleep(Duration::from_millis(10));
            }
            found => return found.unwrap(),
        }
    }
    panic!("the log is never free");
}

/// Tries a write, which fails; it is written down all the same.
async fn switch(service: &Service) {
    let end = service.write("oven", &[(K1, true)], WriteTerms::default());
    end.await.unwrap_err();
}

#[tokio::test]
async fn what_is_done_is_in_the_log_with_its_end() {
    let folder = Folder::new("audit-entries");
    let service = site(&folder.0).await;
    for _ in 0..5 {
        switch(&service).await;
    }
    let log = service.audit_log().unwrap();
    let first = log.page(None, 3, Filter::default()).await.unwrap();
    assert_eq!(first.entries.len(), 3);
    let entry = &first.entries[0];
    assert_eq!(
        (
            entry.module.as_str(),
            entry.what.as_str(),
            entry.end.as_deref()
        ),
        ("oven", "k1=on", Some("closed"))
    );
    let second = log.page(first.next, 3, Filter::default()).await.unwrap();
    assert_eq!((second.entries.len(), second.next), (2, None));
    assert!(second.entries.iter().all(|entry| entry.end.is_some()));
    let known: Vec<String> = service.audit().into_iter().map(|entry| entry.id).collect();
    let mut told: Vec<String> = [first.entries, second.entries]
        .concat()
        .into_iter()
        .map(|entry| entry.id)
        .collect();
    told.reverse();
    assert_eq!(told, known);
    let filter = |label: &str| Filter {
        module: Some("oven".to_owned()),
        label: Some(label.to_owned()),
    };
    let of_k1 = log.page(None, 50, filter("k1")).await.unwrap();
    assert_eq!(of_k1.entries.len(), 5);
    let of_k2 = log.page(None, 50, filter("k2")).await.unwrap();
    assert_eq!(of_k2.entries.len(), 0);
    let verified = log.verify().await.unwrap();
    assert_eq!((verified.entries, verified.broken_at), (5, None));
    let piece = log.export(None).await.unwrap();
    assert_eq!(piece.records.len() as u64, verified.records);
}

#[tokio::test]
async fn many_pages_are_whole() {
    let folder = Folder::new("audit-pages");
    let service = site(&folder.0).await;
    // Twenty at a time: more would be refused, for too much waits.
    for _ in 0..30 {
        let writes: Vec<_> = (0..20)
            .map(|_| {
                let service = service.clone();
                tokio::spawn(async move { switch(&service).await })
            })
            .collect();
        for write in writes {
            write.await.unwrap();
        }
    }
    let log = service.audit_log().unwrap();
    let (mut next, mut seen) = (None, std::collections::BTreeSet::new());
    loop {
        let page = log.page(next, 37, Filter::default()).await.unwrap();
        for entry in page.entries {
            assert_eq!(entry.end.as_deref(), Some("closed"));
            assert!(seen.insert(entry.id), "twice");
        }
        next = page.next;
        if next.is_none() {
            break;
        }
    }
    assert_eq!(seen.len(), 600);
}

#[tokio::test]
async fn every_byte_counts() {
    let folder = Folder::new("audit-bytes");
    let service = site(&folder.0).await;
    switch(&service).await;
    switch(&service).await;
    // What is being written would look broken.
    let held = verify_folder(&folder.0).unwrap_err();
    assert_eq!(held.kind(), ErrorKind::WouldBlock);
    drop(service);
    let whole = checked(&folder.0);
    assert_eq!((whole.entries, whole.broken_at), (2, None));
    for name in ["audit.log", "audit.head"] {
        let path = folder.0.join(name);
        let good = std::fs::read(&path).unwrap();
        for at in 0..good.len() {
            for flip in [0x01, 0x20, 0x80] {
                let mut bad = good.clone();
                bad[at] ^= flip;
                std::fs::write(&path, &bad).unwrap();
                let found = checked(&folder.0);
                assert!(found.broken_at.is_some(), "{name}: byte {at} ^ {flip:#x}");
            }
        }
        std::fs::write(&path, &good).unwrap();
    }
    let good = std::fs::read_to_string(folder.log()).unwrap();
    let lines: Vec<&str> = good.split_inclusive('\n').collect();
    // The last line but one is the last that the head is sure to know of.
    for gone in 0..lines.len() - 1 {
        let mut left = lines.clone();
        left.remove(gone);
        std::fs::write(folder.log(), left.concat()).unwrap();
        let found = checked(&folder.0);
        assert!(found.broken_at.is_some(), "line {gone} is missing");
    }
    std::fs::write(folder.log(), lines[..lines.len() - 2].concat()).unwrap();
    assert!(checked(&folder.0).broken_at.is_some(), "cut off");
}

#[tokio::test]
async fn a_torn_end_is_taken_away_and_a_broken_log_put_aside() {
    let folder = Folder::new("audit-torn");
    let service = site(&folder.0).await;
    switch(&service).await;
    drop(service);
    let (log, _) = reopened(&folder.0).await;
    let verified = log.verify().await.unwrap();
    assert_eq!((verified.entries, verified.broken_at), (1, None));
    drop(log);
    drop(reopened(&folder.0).await);
    let mut good = std::fs::read(folder.log()).unwrap();
    good.extend(b"0123 {\"seq\"");
    std::fs::write(folder.log(), &good).unwrap();
    let (log, found) = reopened(&folder.0).await;
    assert_eq!((found.torn, found.cut, found.put_aside), (11, false, None));
    assert_eq!(log.verify().await.unwrap().broken_at, None);
    drop(log);
    drop(reopened(&folder.0).await);
    let mut bad = std::fs::read(folder.log()).unwrap();
    let middle = bad.len() / 2;
    bad[middle] ^= 1;
    std::fs::write(folder.log(), &bad).unwrap();
    let (log, found) = reopened(&folder.0).await;
    let aside = found.put_aside.unwrap();
    assert_eq!(std::fs::read(aside).unwrap(), bad, "what was there is kept");
    // The new log says that an older one is gone.
    assert!(log.verify().await.unwrap().broken_at.is_some());
}

#[tokio::test]
async fn an_end_that_was_cut_off_is_remembered() {
    let folder = Folder::new("audit-cut");
    let service = site(&folder.0).await;
    let short = std::fs::read(folder.log()).unwrap();
    switch(&service).await;
    switch(&service).await;
    drop(service);
    drop(reopened(&folder.0).await);
    let (log, found) = reopened(&folder.0).await;
    assert!(!found.cut);
    drop(log);
    std::fs::write(folder.log(), short).unwrap();
    let (log, found) = reopened(&folder.0).await;
    assert!(found.cut);
    assert!(log.verify().await.unwrap().broken_at.is_some());
}

#[tokio::test]
async fn a_command_whose_end_nobody_knows_is_told() {
    let folder = Folder::new("audit-unknown");
    let service = site(&folder.0).await;
    switch(&service).await;
    drop(service);
    drop(reopened(&folder.0).await);
    // As if the program had been killed between the action and its record.
    let text = std::fs::read_to_string(folder.log()).unwrap();
    let begin = text
        .lines()
        .position(|line| line.contains("\"begin\""))
        .unwrap();
    let head: Vec<&str> = text.split_inclusive('\n').take(begin + 1).collect();
    std::fs::write(folder.log(), head.concat()).unwrap();
    std::fs::remove_file(folder.0.join("audit.head")).unwrap();
    let (log, found) = reopened(&folder.0).await;
    assert_eq!(found.unfinished.len(), 1);
    let page = log.page(None, 5, Filter::default()).await.unwrap();
    assert_eq!(page.entries[0].end.as_deref(), Some("unknown"));
    assert_eq!(page.entries[0].id, found.unfinished[0]);
    assert_eq!(log.verify().await.unwrap().broken_at, None);
}

#[tokio::test]
async fn what_cannot_be_written_down_is_not_done_where_that_is_wanted() {
    let folder = Folder::new("audit-full");
    // A disk without room.
    std::os::unix::fs::symlink("/dev/full", folder.log()).unwrap();
    let service = site(&folder.0).await;
    let log = service.audit_log().unwrap();
    let mut followed = service.follow_events();
    let terms = WriteTerms::default();
    log.require(true);
    let end = service.write("oven", &[(K1, true)], terms).await;
    assert_eq!(end, Err(CommandError::NotAudited));
    let event = followed.next().await.unwrap().unwrap();
    assert_eq!(event.code.as_deref(), Some("audit_fails"));
    log.require(false);
    let end = service.write("oven", &[(K1, true)], terms).await;
    assert_eq!(
        end,
        Err(CommandError::Line(Fault::Closed)),
        "control goes on"
    );
    let event = followed.next().await.unwrap().unwrap();
    assert_eq!(
        event.code.as_deref(),
        Some("write"),
        "the failure is told once"
    );
    assert!(AuditLog::open(&folder.0).is_err(), "one writer only");
}

/// How often a process is killed.
const KILLS: usize = 100;

/// The process that is killed, and nothing in any other: it writes the numbers of entries to its
/// standard output once they are acknowledged.
#[tokio::test(flavor = "current_thread")]
async fn child_that_is_killed() {
    use std::io::Write;
    let Some(folder) = std::env::var_os("AUDIT_FOLDER").map(PathBuf::from) else {
        return;
    };
    let service = site(&folder).await;
    let mut followed = service.follow_events();
    for _ in 0..8 {
        let service = service.clone();
        tokio::spawn(async move {
            loop {
                switch(&service).await;
            }
        });
    }
    let mut out = std::io::stdout();
    while let Some(event) = followed.next().await {
        let event = event.unwrap();
        if event.end.is_some() {
            writeln!(out, "ACK {}", event.id).unwrap();
            out.flush().unwrap();
        }
    }
}

#[test]
fn kill_loses_nothing_that_was_acknowledged() {
    let folder = Folder::new("audit-kills");
    let acknowledged = kill(&folder, KILLS, u64::MAX);
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .unwrap();
    runtime.block_on(all_are_there(&folder, &acknowledged));
}

/// Kills the process so often, which keeps so many bytes; gives back what it acknowledged.
fn kill(folder: &Folder, times: usize, keep: u64) -> Vec<String> {
    use std::io::{BufRead, BufReader};
    let mut acknowledged = Vec::new();
    for round in 0..times {
        let mut child = Command::new(std::env::current_exe().unwrap())
            .args(["child_that_is_killed", "--exact", "--nocapture"])
            .env("AUDIT_FOLDER", &folder.0)
            .env("AUDIT_KEEP", keep.to_string())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
        let mut wanted = 3 + round % 17;
        while let Some(Ok(line)) = lines.next() {
            let Some((_, id)) = line.split_once("ACK ") else {
                continue;
            };
            acknowledged.push(id.to_owned());
            wanted -= 1;
            if wanted == 0 {
                break;
            }
        }
        assert_eq!(wanted, 0, "it ended by itself");
        child.kill().unwrap();
        child.wait().unwrap();
        let rest = lines.map_while(Result::ok);
        // A last line may be cut short.
        let rest = rest.filter_map(|line| Some(line.split_once("ACK ")?.1.to_owned()));
        acknowledged.extend(rest.filter(|id| id.len() == 26));
    }
    acknowledged
}

/// How every entry of a log ended, by its number.
async fn all_ends(log: &AuditLog) -> BTreeMap<String, Option<String>> {
    let mut ends = BTreeMap::new();
    let mut next = None;
    loop {
        let page = log.page(next, 500, Filter::default()).await.unwrap();
        ends.extend(page.entries.into_iter().map(|entry| (entry.id, entry.end)));
        next = page.next;
        if next.is_none() {
            return ends;
        }
    }
}

async fn all_are_there(folder: &Folder, acknowledged: &[String]) {
    let (log, found) = reopened(&folder.0).await;
    assert!(found.put_aside.is_none() && !found.cut, "{found:?}");
    let verified = log.verify().await.unwrap();
    assert_eq!(verified.broken_at, None);
    let ends = all_ends(&log).await;
    assert!(acknowledged.len() >= KILLS * 3, "{}", acknowledged.len());
    for id in acknowledged {
        let end = ends.get(id).expect("it was acknowledged");
        assert_eq!(end.as_deref(), Some("closed"), "{id}");
    }
    assert!(
        ends.values().all(Option::is_some),
        "ends are told, if only as unknown"
    );
}

//! The thread of an outbox, at a site whose line is not there.

use super::*;
use crate::northbound::supervisor::RunId;
use railbus_site::{Config, Service};
use railbus_store::outbox::EntryKind;
use std::sync::Weak;
use std::sync::atomic::AtomicU32;

const OVEN: &str = "[line.main]\nport = \"/dev/railbus-nothing\"\n[module.oven]\nline = \"main\"\n\
    model = \"erc8\"\naddress = 3\n";
const PUMP: &str = "[module.pump]\nline = \"main\"\nmodel = \"erc8\"\naddress = 4\n";
/// Only guards against hanging.
const PATIENCE: Duration = Duration::from_secs(60);

/// A folder of its own, removed at the end.
struct Folder(PathBuf);

impl Folder {
    fn new() -> Folder {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let name = format!(
            "railbus-kept-{}-{}",
            std::process::id(),
            COUNT.fetch_add(1, Relaxed)
        );
        Folder(std::env::temp_dir().join(name))
    }

    fn start(&self, site: &Service) -> (OutboxHandle, Report) {
        self.start_with(site, false)
    }

    fn start_for_again(&self, site: &Service) -> (OutboxHandle, Report) {
        self.start_with(site, true)
    }

    fn start_with(&self, site: &Service, is_for_again: bool) -> (OutboxHandle, Report) {
        let report = Report {
            run: RunId(1),
            counts: Arc::default(),
            to: Weak::new(),
        };
        let setup = OutboxSetup {
            file: self.0.join("plant.outbox.db"),
            days: 1,
            is_for_again,
            has: Box::new(|_| true),
            site: site.follow(),
            report: report.clone(),
        };
        (OutboxHandle::start(setup).unwrap(), report)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
        let _ = std::fs::remove_file(&self.0);
    }
}

/// Waits until so much is on the disk.
async fn stored(outbox: &mut OutboxHandle, newest: u64) -> OutboxState {
    let stored = async {
        loop {
            let state = outbox.changed().await;
            if state.newest >= newest {
                return state;
            }
        }
    };
    tokio::time::timeout(PATIENCE, stored).await.unwrap()
}

fn gaps(piece: &Piece) -> Vec<usize> {
    let is_gap = |(_, entry): &(usize, &_)| {
        let entry: &OutboxEntry = entry;
        matches!(entry.what, EntryKind::Gap { .. })
    };
    let entries = piece.entries.iter().enumerate().filter(is_gap);
    entries.map(|(nth, _)| nth).collect()
}

#[tokio::test]
async fn what_is_not_delivered_is_there_after_a_restart_and_then_a_gap() {
    let folder = Folder::new();
    let site = Service::start(Config::parse(OVEN).unwrap()).unwrap();
    let (mut outbox, _) = folder.start(&site);
    let state = stored(&mut outbox, 8).await;
    assert_eq!((state.newest, state.delivered), (8, 0));
    site.reload(&format!("{OVEN}{PUMP}")).await.unwrap();
    let state = stored(&mut outbox, 16).await;
    let (epoch, piece) = outbox.read(0, 5).await.unwrap();
    assert_eq!(
        (&epoch, piece.first, piece.entries.len()),
        (&state.epoch, 1, 5)
    );
    outbox.delivered(&epoch, 5);
    outbox.end(PATIENCE).await;

    let (mut outbox, _) = folder.start(&site);
    let state = stored(&mut outbox, 33).await;
    assert_eq!(
        (&state.epoch, state.newest, state.delivered),
        (&epoch, 33, 5)
    );
    // Numbers of another file.
    outbox.delivered(&Arc::from("another"), 30);
    let (_, piece) = outbox.read(0, 100).await.unwrap();
    assert_eq!((piece.first, piece.entries.len()), (6, 28));
    assert_eq!((gaps(&piece), piece.missing), (vec![11], None));
    outbox.end(PATIENCE).await;

    let (mut outbox, _) = folder.start(&site);
    assert_eq!(stored(&mut outbox, 33 + 17).await.delivered, 5);
    outbox.end(PATIENCE).await;
    remove(&folder.0.join("plant.outbox.db"));
    assert_eq!(std::fs::read_dir(&folder.0).unwrap().count(), 0);
}

#[tokio::test]
async fn how_all_is_is_said_with_the_entry_after_which_it_is_so() {
    let folder = Folder::new();
    let site = Service::start(Config::parse(OVEN).unwrap()).unwrap();
    let (mut outbox, _) = folder.start(&site);
    let state = stored(&mut outbox, 8).await;
    let (epoch, newest, points) = outbox.state().await.unwrap();
    assert_eq!((&epoch, newest, points.len()), (&state.epoch, 8, 8));
    let (_, piece) = outbox.read(0, 100).await.unwrap();
    assert_eq!(piece.entries, points, "each point has had one entry");
    // What is new is written first.
    site.reload(&format!("{OVEN}{PUMP}")).await.unwrap();
    let all = async {
        loop {
            let (_, newest, points) = outbox.state().await.unwrap();
            if points.len() == 16 {
                return newest;
            }
        }
    };
    let newest = tokio::time::timeout(PATIENCE, all).await.unwrap();
    assert_eq!(newest, 16);
    outbox.end(PATIENCE).await;
}

#[tokio::test]
async fn what_is_delivered_can_be_asked_for_again() {
    let folder = Folder::new();
    let site = Service::start(Config::parse(OVEN).unwrap()).unwrap();
    let (mut outbox, _) = folder.start_for_again(&site);
    let state = stored(&mut outbox, 8).await;
    outbox.delivered(&state.epoch, 8);
    outbox.end(PATIENCE).await;
    let (mut outbox, _) = folder.start_for_again(&site);
    assert_eq!(stored(&mut outbox, 9).await.delivered, 8);
    let (epoch, piece) = outbox.read_again((2, 4), 100).await.unwrap();
    assert_eq!(
        (epoch, piece.first, piece.entries.len()),
        (state.epoch, 2, 3)
    );
    let (_, none) = outbox.read_again((900, 901), 100).await.unwrap();
    assert!(none.entries.is_empty());
    outbox.end(PATIENCE).await;
}

#[tokio::test]
async fn a_disk_that_fails_is_tried_again() {
    let folder = Folder::new();
    // No folder can be there.
    std::fs::write(&folder.0, "in its way").unwrap();
    let site = Service::start(Config::parse(OVEN).unwrap()).unwrap();
    let (mut outbox, _) = folder.start(&site);
    assert_eq!(outbox.read(0, 5).await, None);
    let state = tokio::time::timeout(PATIENCE, outbox.changed())
        .await
        .unwrap();
    assert_eq!((state.is_failing, state.newest), (true, 0));
    assert_eq!(outbox.state().await, None, "of no number");
    std::fs::remove_file(&folder.0).unwrap();
    let state = stored(&mut outbox, 8).await;
    assert_eq!((state.is_failing, state.newest), (false, 8));
    outbox.end(PATIENCE).await;
}

#[tokio::test]
async fn it_ends_although_a_read_was_begun() {
    let folder = Folder::new();
    let site = Service::start(Config::parse(OVEN).unwrap()).unwrap();
    let (mut outbox, _) = folder.start(&site);
    stored(&mut outbox, 8).await;
    let read = outbox.read(0, 5);
    let begun = std::time::Instant::now();
    outbox.end(Duration::from_secs(10)).await;
    assert!(begun.elapsed() < Duration::from_secs(10));
    assert_eq!(read.await, None);
}

#[tokio::test]
async fn a_page_that_cannot_be_read_does_not_stop_it_for_good() {
    let folder = Folder::new();
    let site = Service::start(Config::parse(OVEN).unwrap()).unwrap();
    let (mut outbox, _) = folder.start(&site);
    let state = stored(&mut outbox, 8).await;
    outbox.end(PATIENCE).await;
    let file = folder.0.join("plant.outbox.db");
    let mut kept = Outbox::open(&file).unwrap();
    let first = kept.read(0, 1).unwrap().unwrap().entries;
    kept.append(&vec![first[0].clone(); 5_000]).unwrap();
    kept.tidy().unwrap();
    drop(kept);
    let mut bytes = std::fs::read(&file).unwrap();
    let leaves = (1..bytes.len() / 4096).filter(|page| bytes[page * 4096] == 13);
    let leaf = leaves.collect::<Vec<_>>()[10];
    bytes[leaf * 4096..][..4096].fill(0xFF);
    std::fs::write(&file, bytes).unwrap();
    let (mut outbox, _) = folder.start(&site);
    let mut now = stored(&mut outbox, 5_000).await;
    let mut after = 0;
    let mut nones = 0;
    while nones < 20 {
        match outbox.read(after, 256).await {
            Some((_, piece)) => after = piece.first + piece.entries.len() as u64 - 1,
            None if after >= now.newest => break,
            None => {
                nones += 1;
                if let Ok(changed) = tokio::time::timeout(FLUSH, outbox.changed()).await {
                    (now, after) = (changed, 0);
                }
            }
        }
    }
    assert!(nones < 20, "stands still at {after} of {}", now.newest);
    assert_ne!(now.epoch, state.epoch);
    outbox.end(PATIENCE).await;
}

#[tokio::test]
async fn after_what_was_dropped_every_point_is_told_once_more() {
    let folder = Folder::new();
    let site = Service::start(Config::parse(OVEN).unwrap()).unwrap();
    let (mut outbox, _) = folder.start(&site);
    stored(&mut outbox, 8).await;
    outbox.end(PATIENCE).await;
    let file = folder.0.join("plant.outbox.db");
    let mut kept = Outbox::open(&file).unwrap();
    let keep = OutboxKeep {
        age_ms: 0,
        bytes: 0,
        is_for_again: false,
    };
    kept.prune(keep, i64::MAX).unwrap();
    drop(kept);
    let (mut outbox, _) = folder.start(&site);
    // A gap, and every point after it.
    stored(&mut outbox, 8 + 9).await;
    for _ in 0..3 {
        let (_, piece) = outbox.read(0, 100).await.unwrap();
        assert_eq!((piece.first, piece.missing.unwrap().count), (8, 7));
        stored_or_known(&mut outbox, 8 + 9 + 8).await;
    }
    tokio::time::sleep(2 * FLUSH).await;
    let (_, piece) = outbox.read(0, 100).await.unwrap();
    assert_eq!(piece.entries.len(), 1 + 9 + 8, "once");
    outbox.end(PATIENCE).await;
}

/// The same as [`stored`], also if it was told before.
async fn stored_or_known(outbox: &mut OutboxHandle, newest: u64) {
    if outbox.state.borrow().newest < newest {
        stored(outbox, newest).await;
    }
}

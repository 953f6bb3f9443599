//! The log goes on in another file where one is full, and its oldest files go.

use super::*;

/// So much is kept: files of 4 kB.
const KEEP: u64 = 16_000;

/// The full files, the oldest first.
fn full(folder: &Folder) -> Vec<PathBuf> {
    let files = std::fs::read_dir(&folder.0).unwrap();
    let mut found: Vec<_> = files.map(|file| file.unwrap().path()).collect();
    let is_full = |path: &PathBuf| path.to_string_lossy().contains("audit-0");
    found.retain(is_full);
    found.sort();
    found
}

/// A log of three files, closed; gives back the numbers of its entries.
async fn three_files(folder: &Folder) -> Vec<String> {
    let service = site(&folder.0).await;
    service.audit_log().unwrap().keep(Some(KEEP));
    while full(folder).len() < 2 {
        switch(&service).await;
    }
    switch(&service).await;
    let ids = service.audit().into_iter().map(|entry| entry.id).collect();
    drop(service);
    drop(reopened(&folder.0).await);
    ids
}

#[tokio::test]
async fn one_chain_goes_through_all_files() {
    let folder = Folder::new("audit-files");
    let ids = three_files(&folder).await;
    let (log, found) = reopened(&folder.0).await;
    assert_eq!(found, OpenReport::default());
    let verified = log.verify().await.unwrap();
    assert_eq!((verified.first, verified.broken_at), (1, None));
    assert_eq!(verified.entries, ids.len() as u64);
    for (limit, filter) in [(3, Filter::default()), (500, Filter::default())] {
        let (mut seen, mut next) = (Vec::new(), None);
        loop {
            let page = log.page(next, limit, filter.clone()).await.unwrap();
            assert!(page.entries.iter().all(|entry| entry.end.is_some()));
            seen.extend(page.entries.into_iter().map(|entry| entry.id));
            next = page.next;
            if next.is_none() {
                break;
            }
        }
        seen.reverse();
        assert_eq!(seen, ids, "{limit} at a time");
    }
    let (mut records, mut from) = (Vec::new(), None);
    loop {
        let piece = log.export(from).await.unwrap();
        from = Some(piece.next);
        if piece.records.is_empty() {
            break;
        }
        records.extend(piece.records);
    }
    let numbers = records.iter().map(|(_, record)| record.seq);
    assert!(numbers.eq(1..=verified.records), "all, and once");
}

#[tokio::test]
async fn what_is_taken_out_of_any_file_shows() {
    let folder = Folder::new("audit-out");
    three_files(&folder).await;
    assert_eq!(checked(&folder.0).broken_at, None);
    let mut files = full(&folder);
    files.push(folder.log());
    for path in &files {
        let good = std::fs::read(path).unwrap();
        for at in (0..good.len()).step_by(97) {
            let mut bad = good.clone();
            bad[at] ^= 1;
            std::fs::write(path, &bad).unwrap();
            let found = checked(&folder.0);
            assert!(found.broken_at.is_some(), "{path:?}: byte {at}");
        }
        std::fs::write(path, &good).unwrap();
        let aside = folder.0.join("aside");
        std::fs::rename(path, &aside).unwrap();
        let found = checked(&folder.0);
        assert!(found.broken_at.is_some(), "{path:?} is missing");
        std::fs::rename(&aside, path).unwrap();
    }
    assert_eq!(checked(&folder.0).broken_at, None);
}

#[tokio::test]
async fn the_oldest_go_and_the_rest_is_checked_from_there() {
    let folder = Folder::new("audit-oldest");
    let service = site(&folder.0).await;
    let log = service.audit_log().unwrap();
    log.keep(Some(KEEP));
    let mut place = None;
    while !folder.0.join("audit.anchor").exists() {
        switch(&service).await;
        place = place.or(log.page(None, 1, Filter::default()).await.unwrap().next);
    }
    for _ in 0..50 {
        switch(&service).await;
    }
    let all = std::fs::read_dir(&folder.0).unwrap();
    let sum: u64 = all
        .map(|file| file.unwrap().metadata().unwrap().len())
        .sum();
    assert!(sum < KEEP + 2_000, "{sum} bytes");
    let verified = log.verify().await.unwrap();
    assert!(
        verified.first > 1 && verified.broken_at.is_none(),
        "{verified:?}"
    );
    // Whoever was reading where nothing is any more is at the beginning.
    let page = log.page(place, 5, Filter::default()).await.unwrap();
    assert_eq!((page.entries.len(), page.next), (0, None));
    drop(service);
    drop(reopened(&folder.0).await);
    assert_eq!(checked(&folder.0).first, verified.first);
    let anchor = folder.0.join("audit.anchor");
    let good = std::fs::read(&anchor).unwrap();
    for at in 0..good.len() {
        let mut bad = good.clone();
        bad[at] ^= 1;
        std::fs::write(&anchor, &bad).unwrap();
        let found = checked(&folder.0);
        assert!(found.broken_at.is_some(), "byte {at} of the anchor");
    }
}

/// Between any two of its steps the program may be killed: the next start goes on.
#[tokio::test]
async fn cut_off_between_two_files_it_goes_on() {
    let folder = Folder::new("audit-between");
    let ids = three_files(&folder).await;
    let first = u64::try_from(std::fs::read(folder.log()).unwrap().len()).unwrap();
    assert!(first > 0);
    // The file has its new name, and there is no other yet; then an empty one.
    let newest = std::fs::read_to_string(folder.log()).unwrap();
    let seq = newest.split("\"seq\":").nth(1).unwrap();
    let seq: u64 = seq.split(',').next().unwrap().parse().unwrap();
    std::fs::rename(folder.log(), folder.0.join(format!("audit-{seq:020}.log"))).unwrap();
    for is_begun in [false, true] {
        if is_begun {
            std::fs::write(folder.log(), "").unwrap();
        }
        assert_eq!(checked(&folder.0).broken_at, None);
        let (log, found) = reopened(&folder.0).await;
        assert_eq!(found, OpenReport::default());
        assert_eq!(log.verify().await.unwrap().broken_at, None);
        assert_eq!(all_ends(&log).await.len(), ids.len());
        drop(log);
        drop(reopened(&folder.0).await);
        std::fs::remove_file(folder.log()).unwrap();
        std::fs::remove_file(folder.0.join("audit.head")).unwrap();
        let last = newest.lines().last().unwrap();
        let hash = last.split(' ').next().unwrap();
        let seq = seq + newest.lines().count() as u64 - 1;
        let head = format!("{seq:020} {hash}\n");
        std::fs::write(folder.0.join("audit.head"), head).unwrap();
    }
    // The anchor is written, and the file before it still there.
    let oldest = std::fs::read_to_string(&full(&folder)[0]).unwrap();
    let hash = oldest.lines().last().unwrap().split(' ').next().unwrap();
    let anchor = format!("{:020} {hash}\n", oldest.lines().count());
    std::fs::write(folder.0.join("audit.anchor"), anchor).unwrap();
    let found = checked(&folder.0);
    assert_eq!(found.broken_at, None);
    assert_eq!(found.first, oldest.lines().count() as u64 + 1);
}

/// What was begun in one file and not ended in the next is told as unknown.
#[tokio::test]
async fn what_was_under_way_over_the_end_of_a_file_is_told() {
    let folder = Folder::new("audit-over");
    three_files(&folder).await;
    let last = full(&folder).pop().unwrap();
    let text = std::fs::read_to_string(&last).unwrap();
    let begin = text.rfind("\"begin\"").unwrap();
    let end = begin + text[begin..].find('\n').unwrap() + 1;
    std::fs::write(&last, &text[..end]).unwrap();
    std::fs::write(folder.log(), "").unwrap();
    std::fs::remove_file(folder.0.join("audit.head")).unwrap();
    let (log, found) = reopened(&folder.0).await;
    assert_eq!(found.unfinished.len(), 1);
    assert_eq!(
        all_ends(&log).await[&found.unfinished[0]].as_deref(),
        Some("unknown")
    );
    assert_eq!(log.verify().await.unwrap().broken_at, None);
}

#[test]
fn kill_loses_nothing_while_files_come_and_go() {
    let folder = Folder::new("audit-file-kills");
    let acknowledged = kill(&folder, 40, KEEP);
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .unwrap();
    runtime.block_on(async {
        let (log, found) = reopened(&folder.0).await;
        assert!(found.put_aside.is_none() && !found.cut, "{found:?}");
        let verified = log.verify().await.unwrap();
        assert!(
            verified.first > 1 && verified.broken_at.is_none(),
            "{verified:?}"
        );
        let ends = all_ends(&log).await;
        let oldest = ends.keys().next().unwrap();
        let mut later = acknowledged.iter().filter(|id| *id >= oldest);
        assert!(later.all(|id| {
            ends.get(id)
                .is_some_and(|end| end.as_deref() == Some("closed"))
        }));
    });
}

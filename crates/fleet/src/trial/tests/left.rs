//! Trials that are left, interrupted, or can't be judged yet.

use super::*;

/// What drove it has ended, or the disk refused at the start of the site.
#[test]
fn a_trial_that_was_left_is_taken_back() {
    let trial = left();
    let begin = |text: &str| {
        let managed = ManagedRecord::default();
        Site(
            ConfigTrial::new(managed, file(text), Some(trial.clone())),
            S(100),
        )
    };
    let why = "the site was restarted while it was tried";
    assert_eq!(begin("new").takes_back(), why);
    // What only the site says was changed meanwhile: the rest is what it was.
    let other = ConfigText {
        text: "own and new".to_owned(),
        hash: part_hash("new"),
    };
    let mut site = Site(
        ConfigTrial::new(ManagedRecord::default(), other, Some(trial.clone())),
        S(100),
    );
    assert_eq!(site.takes_back(), why);
    // It was not written.
    let mut site = begin("old");
    assert_eq!(site.ends(), ManagedRecord::default());
    assert_eq!(site.0.phase(), ConfigPhase::Unmanaged);
    // It was changed by hand, and has its end: it is not found to be so already.
    let mut site = begin("by hand");
    let verdict = site.ends().verdict.expect("there is one");
    assert_eq!(
        (verdict.version, verdict.kind()),
        (3, TrialEndKind::Interrupted)
    );
    site.wants(3, "by hand");
    assert_eq!(site.next(), None);
}

/// It is neither kept nor said to be taken back.
#[test]
fn what_is_changed_at_the_site_during_a_trial_ends_it() {
    let mut site = Site::new();
    site.tries(3, "new");
    site.1 += S(10);
    // Its other part may change.
    let other = ConfigText {
        text: "own and new".to_owned(),
        hash: part_hash("new"),
    };
    site.0.handle(site.1, TrialInput::File(other));
    site.says(well());
    assert_eq!(site.next(), None);
    site.0.handle(site.1, TrialInput::File(file("old")));
    let record = site.ends();
    let verdict = record.verdict.expect("there is one");
    assert_eq!(
        (record.kept, verdict.kind()),
        (0, TrialEndKind::Interrupted)
    );
    assert_eq!(site.0.report().phase(), ConfigPhaseKind::Interrupted);
}

/// A text that was written although that was said to have failed is not kept untried.
#[test]
fn what_may_have_been_written_comes_back_first() {
    let mut site = Site::new();
    site.wants(3, "new");
    site.checks("new");
    site.does(TrialDone::Ok);
    site.does(TrialDone::Failed("stopping".to_owned()));
    let output = TrialOutput::TakeBack("new".to_owned(), "old".to_owned());
    assert_eq!(site.does(back("old")), output);
    assert_eq!(site.does(TrialDone::Ok), TrialOutput::RemoveTrial);
    assert_eq!(site.next(), None);
    site.1 += AGAIN;
    site.checks("new");
}

/// While the end is recorded, however long that takes, it is not said to be kept: a restart takes
/// it back. Nor is the end of the one before said.
#[test]
fn one_is_said_to_be_kept_once_that_is_recorded() {
    let mut site = Site::new();
    site.tries(3, "new");
    let one = TrialHealth {
        lines_up: names(&["hall"]),
        ..well()
    };
    site.after_trial(one);
    site.takes_back();
    site.says(well());
    site.tries(4, "new");
    site.after_trial(well());
    assert!(matches!(
        site.does(TrialDone::Failed("disk full".to_owned())),
        TrialOutput::StoreManaged(_)
    ));
    let told = |site: &Site| {
        let report = site.0.report();
        let ConfigReport { version, kept, .. } = report;
        (report.phase(), version, kept, report.is_local)
    };
    assert_eq!(told(&site), (ConfigPhaseKind::Trying, 4, 0, false));
    site.1 += AGAIN;
    site.ends();
    assert_eq!(told(&site), (ConfigPhaseKind::Current, 4, 4, false));
}

/// Nobody would judge it, and its record would take something else back long afterwards.
#[test]
fn what_is_tried_is_taken_back_where_what_drives_it_ends() {
    let mut site = Site::new();
    site.0.handle(site.1, TrialInput::Leave);
    assert_eq!(site.next(), None);
    site.tries(3, "new");
    site.wants(4, "newer");
    site.0.handle(site.1, TrialInput::Leave);
    let why = site.takes_back();
    assert_eq!(why, "the integration was ended while it was tried");
}

/// The site is not whole yet after the one before was taken back, or while a line is lent.
#[test]
fn the_next_one_waits_until_the_site_works_again() {
    let dead = || TrialHealth {
        lines_up: names(&[]),
        modules_online: names(&[]),
        ..well()
    };
    let mut site = Site::new();
    site.tries(3, "new");
    site.wants(4, "newer");
    site.after_trial(dead());
    site.takes_back_then_waits();
    site.says(dead());
    assert_eq!(site.next(), None);
    site.says(well());
    assert!(matches!(site.next(), Some(TrialOutput::Check(..))));
    // One that failed waits for it, too.
    let mut site = Site::new();
    site.wants(3, "new");
    site.does(TrialDone::Failed("disk full".to_owned()));
    site.0.handle(site.1, TrialInput::File(file("older")));
    site.1 += AGAIN;
    site.says(dead());
    assert_eq!(site.next(), None);
    site.1 += SETTLES;
    site.says(dead());
    assert!(matches!(site.next(), Some(TrialOutput::Check(..))));
    // A line that is lent can't be seen, however long.
    let lent = || TrialHealth {
        lines_lent: names(&["hall"]),
        ..dead()
    };
    let mut site = Site::new();
    site.1 += S(1_000);
    site.says(lent());
    site.wants(3, "new");
    assert_eq!(site.next(), None);
    site.says(well());
    site.checks("new");
    site.does(TrialDone::Ok);
    site.does(TrialDone::Ok);
    site.after_trial(lent());
    assert_eq!(site.next(), None);
    site.1 += S(300);
    site.says(well());
    assert_eq!(site.ends().kept, 3);
}

impl Site {
    /// What was tried is taken back, and another one waits.
    fn takes_back_then_waits(&mut self) {
        let output = TrialOutput::TakeBack("new".to_owned(), "old".to_owned());
        assert_eq!(self.does(back("old")), output);
        self.ends();
    }
}

/// It is tried again after 5 s, then twice as long each time, up to five minutes; a later version
/// at once.
#[test]
fn what_fails_is_tried_again_less_and_less_often() {
    let full = || TrialDone::Failed("disk full".to_owned());
    let mut site = Site::new();
    site.wants(3, "new");
    let mut waits = Vec::new();
    for _ in 0..9 {
        assert_eq!(site.does(full()), check("new"));
        assert_eq!((site.next(), site.0.user()), (None, "li"));
        let due = site.0.deadline().expect("it is tried again");
        waits.push((due - site.1).as_secs());
        // How the site works counts by then.
        assert!(site.0.needs_health());
        site.1 = due;
    }
    assert_eq!(waits, [5, 10, 20, 40, 80, 160, 320, 320, 320]);
    site.does(full());
    site.wants(4, "newer");
    assert_eq!(site.does(full()), check("newer"));
    assert_eq!(site.next(), None);
    let due = site.0.deadline().expect("it is tried again");
    assert_eq!(due - site.1, AGAIN, "another one begins anew");
}

#[test]
fn who_wants_it_is_known_until_it_is_in_force() {
    let mut site = Site::new();
    assert_eq!(site.0.user(), "");
    site.wants(3, "new");
    for done in [
        TrialDone::Checked(file("new")),
        TrialDone::Ok,
        TrialDone::Failed("stopping".to_owned()),
    ] {
        let output = site.next();
        assert!(output.is_some());
        assert_eq!(site.0.user(), "li", "{output:?}");
        site.0.handle(site.1, TrialInput::Done(done));
    }
    assert_eq!(site.0.user(), "li", "while it is undone");
}

/// What waits is not lost where the record of its trial can't be deleted, and is not wanted twice.
#[test]
fn what_waits_is_not_lost() {
    let mut site = Site::new();
    site.wants(3, "new");
    site.checks("new");
    site.does(TrialDone::Ok);
    site.does(TrialDone::Changed(file("by hand")));
    site.does(TrialDone::Failed("disk full".to_owned()));
    let waits = ConfigPhase::Pending(3, String::new());
    assert_eq!(site.0.phase(), waits);
    site.wants(3, "new");
    site.1 += AGAIN;
    assert_eq!(site.does(TrialDone::Ok), TrialOutput::RemoveTrial);
    assert_eq!((site.next(), site.0.phase()), (None, waits));
    assert_eq!(site.0.file().text, "by hand");
}

/// Panics of before do not end a trial, and how the site works is looked at while it lasts.
#[test]
fn only_panics_during_a_trial_end_it() {
    let panicked = |panics| TrialHealth { panics, ..well() };
    let mut site = Site::new();
    site.says(panicked(7));
    site.tries(3, "new");
    assert!(site.0.needs_health());
    site.1 += S(1);
    site.says(panicked(7));
    assert_eq!(site.next(), None);
    site.says(panicked(8));
    assert_eq!(site.takes_back(), "a part of the program panicked");
    assert!(!site.0.needs_health());
}

/// What comes back already has no other end, and what is undone is as it is found.
#[test]
fn what_is_back_already_is_said_to_be() {
    let mut site = Site::new();
    site.tries(3, "new");
    site.after_trial(TrialHealth {
        has_session: false,
        ..well()
    });
    assert!(!site.0.report().is_local, "it is the centre's until then");
    assert!(site.next().is_some());
    assert_eq!(site.0.report().phase(), ConfigPhaseKind::Trying);
    site.0
        .handle(site.1, TrialInput::Done(TrialDone::Changed(file("old"))));
    let verdict = site.ends().verdict.expect("there is one");
    assert_eq!(verdict.kind(), TrialEndKind::RolledBack);
    // Written, and said to have failed.
    let mut site = Site::new();
    site.wants(3, "new");
    site.checks("new");
    site.does(TrialDone::Ok);
    site.does(TrialDone::Failed("stopping".to_owned()));
    site.0.handle(site.1, TrialInput::File(file("new")));
    assert!(!site.0.report().is_local);
    assert_eq!(site.0.report().phase(), ConfigPhaseKind::Pending);
    site.does(back("old"));
    assert_eq!(site.0.file().text, "old");
}

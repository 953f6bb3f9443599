mod cuts;
mod left;

use super::*;

const S: fn(u64) -> Duration = Duration::from_secs;

fn names(of: &[&str]) -> BTreeSet<String> {
    of.iter().map(ToString::to_string).collect()
}

/// All that is configured works.
fn well() -> TrialHealth {
    TrialHealth {
        lines: names(&["hall", "yard"]),
        lines_up: names(&["hall", "yard"]),
        lines_lent: names(&[]),
        modules: names(&["oven", "tank"]),
        modules_online: names(&["oven", "tank"]),
        has_session: true,
        panics: 0,
    }
}

fn wanted(version: u64, text: &str) -> WantedConfig {
    WantedConfig {
        version,
        text: text.to_owned(),
        replaces: part_hash("old"),
        user: "li".to_owned(),
    }
}

/// The text before is back.
fn back(text: &str) -> TrialDone {
    TrialDone::Back(file(text))
}

/// A file of which the centre may say all.
fn file(text: &str) -> ConfigText {
    ConfigText {
        text: text.to_owned(),
        hash: part_hash(text),
    }
}

fn check(text: &str) -> TrialOutput {
    TrialOutput::Check("old".to_owned(), text.to_owned())
}

fn refusal(why: &str) -> TrialDone {
    TrialDone::Refused(TrialRefusal {
        reason: why.to_owned(),
        problem: b"{}".to_vec(),
    })
}

/// A site whose file says "old".
struct Site(ConfigTrial, Duration);

impl Site {
    fn new() -> Site {
        let mut site = Site(
            ConfigTrial::new(ManagedRecord::default(), file("old"), None),
            S(100),
        );
        site.says(well());
        site
    }

    fn says(&mut self, health: TrialHealth) {
        self.0.handle(self.1, TrialInput::Health(health));
    }

    fn wants(&mut self, version: u64, text: &str) {
        self.0
            .handle(self.1, TrialInput::Wanted(wanted(version, text)));
    }

    fn next(&mut self) -> Option<TrialOutput> {
        self.0.poll(self.1)
    }

    /// The only output, and its result.
    fn does(&mut self, done: TrialDone) -> TrialOutput {
        let output = self.next().expect("something is to be done");
        assert_eq!(self.next(), None);
        self.0.handle(self.1, TrialInput::Done(done));
        output
    }

    /// It is checked, recorded, and applied.
    fn tries(&mut self, version: u64, text: &str) {
        self.wants(version, text);
        self.checks(text);
        assert!(matches!(
            self.does(TrialDone::Ok),
            TrialOutput::StoreTrial(_)
        ));
        assert_eq!(self.0.phase(), ConfigPhase::Pending(version, String::new()));
        let applied = self.does(TrialDone::Ok);
        assert_eq!(
            applied,
            TrialOutput::Apply("old".to_owned(), text.to_owned())
        );
        assert_eq!(self.next(), None);
        assert_eq!(self.0.phase(), ConfigPhase::Trying(version));
    }

    /// This text is checked, and would stand in the file as it is.
    fn checks(&mut self, text: &str) {
        let output = self.does(TrialDone::Checked(file(text)));
        let TrialOutput::Check(_, checked) = output else {
            panic!("{output:?}");
        };
        assert_eq!(checked, text);
    }

    /// After the time of a trial the site works so.
    fn after_trial(&mut self, health: TrialHealth) {
        self.1 += TRIAL;
        self.says(health);
    }

    /// What is recorded at the end, and the record of the trial is deleted.
    fn ends(&mut self) -> ManagedRecord {
        let output = self.does(TrialDone::Ok);
        let TrialOutput::StoreManaged(record) = output else {
            panic!("{output:?}");
        };
        assert_eq!(self.does(TrialDone::Ok), TrialOutput::RemoveTrial);
        assert_eq!(self.next(), None);
        record
    }

    /// It is taken back; why.
    fn takes_back(&mut self) -> String {
        let output = TrialOutput::TakeBack("new".to_owned(), "old".to_owned());
        assert_eq!(self.does(back("old")), output);
        let verdict = self.ends().verdict.expect("there is one");
        assert_eq!(verdict.kind(), TrialEndKind::RolledBack);
        assert_eq!(self.0.phase(), ConfigPhase::Ended(verdict.clone()));
        assert_eq!(self.0.file().text, "old");
        verdict.reason
    }
}

#[test]
fn one_with_which_the_site_works_is_kept() {
    let mut site = Site::new();
    assert_eq!(site.0.phase(), ConfigPhase::Unmanaged);
    assert!(site.0.report().is_local);
    site.tries(3, "new");
    assert!(!site.0.report().is_local);
    site.1 += TRIAL - S(1);
    site.says(well());
    assert_eq!(site.next(), None);
    site.1 += S(1);
    // What was said before does not count: the machine may have slept.
    site.wants(2, "older");
    assert_eq!(site.next(), None);
    site.says(well());
    let record = site.ends();
    assert_eq!((record.kept, record.verdict), (3, None));
    assert_eq!(site.0.phase(), ConfigPhase::Current(3));
    // It is not wanted twice, and nothing older is.
    site.wants(3, "new");
    site.wants(2, "older");
    assert_eq!(site.next(), None);
    assert!(!site.0.report().is_local);
    site.0.handle(site.1, TrialInput::File(file("by hand")));
    assert_eq!(site.0.phase(), ConfigPhase::LocalChange(3));
    let report = site.0.report();
    assert_eq!(report.phase(), ConfigPhaseKind::LocalChange);
    assert_eq!((report.version, report.kept), (3, 3));
    assert_eq!(report.hash, part_hash("by hand"));
    assert!(report.is_local);
}

#[test]
fn one_with_which_something_is_missing_is_taken_back() {
    let less = |change: fn(&mut TrialHealth)| {
        let mut health = well();
        change(&mut health);
        let mut site = Site::new();
        site.tries(3, "new");
        site.after_trial(health);
        site.takes_back()
    };
    let no_line = less(|health| health.lines_up = names(&["hall"]));
    assert_eq!(no_line, "line yard is not open any more");
    let no_module = less(|health| health.modules_online = names(&["tank"]));
    assert_eq!(no_module, "module oven does not answer any more");
    let no_session = less(|health| health.has_session = false);
    assert_eq!(no_session, "there is no session with the centre");
    // At once.
    let mut site = Site::new();
    site.tries(3, "new");
    let panics = 1;
    site.says(TrialHealth { panics, ..well() });
    assert_eq!(site.takes_back(), "a part of the program panicked");
    // Nor is it tried again, except as another version.
    site.wants(3, "new");
    assert_eq!(site.next(), None);
    site.wants(4, "new");
    assert_eq!(site.next(), Some(check("new")));
}

#[test]
fn what_did_not_work_before_or_is_not_wanted_any_more_is_not_missing() {
    let mut site = Site::new();
    let mut before = well();
    before.modules_online = names(&["tank"]);
    before.lines_up = names(&["hall"]);
    site.says(before.clone());
    site.1 += SETTLES;
    site.says(before.clone());
    site.tries(3, "new");
    before.modules = names(&["oven"]);
    before.modules_online = names(&[]);
    site.after_trial(before);
    assert_eq!(site.ends().kept, 3);
}

/// What is not there before a trial is not missing afterwards: a site that has just started has
/// nothing.
#[test]
fn a_trial_waits_until_the_site_works_again() {
    let none = || TrialHealth {
        lines_up: names(&[]),
        modules_online: names(&[]),
        ..well()
    };
    let begun = || {
        let mut site = Site(
            ConfigTrial::new(ManagedRecord::default(), file("old"), None),
            S(100),
        );
        site.wants(3, "new");
        assert_eq!(site.next(), None);
        site.says(none());
        assert_eq!(site.next(), None);
        assert!(site.0.needs_health());
        let waits = ConfigPhase::Pending(3, String::new());
        assert_eq!(site.0.phase(), waits);
        site
    };
    // As soon as all of it is there.
    let mut site = begun();
    site.1 += S(5);
    let all_but_one = TrialHealth {
        modules_online: names(&["tank"]),
        ..well()
    };
    site.says(all_but_one);
    assert_eq!(site.next(), None);
    site.says(well());
    assert_eq!(site.next(), Some(check("new")));
    // A module may be dead.
    let mut site = begun();
    site.1 += SETTLES - S(1);
    site.says(none());
    assert_eq!((site.next(), site.0.deadline()), (None, Some(S(160))));
    site.1 += S(1);
    assert_eq!(site.next(), Some(check("new")));
    // The same after a change at the site.
    let mut site = Site::new();
    site.1 += S(1_000);
    site.0.handle(site.1, TrialInput::File(file("")));
    site.says(none());
    site.wants(4, "new");
    assert_eq!(site.next(), None);
    site.1 += SETTLES;
    site.says(none());
    assert!(matches!(site.next(), Some(TrialOutput::Check(..))));
}

#[test]
fn one_that_is_refused_changes_nothing() {
    let mut site = Site::new();
    site.wants(3, "bad");
    let why = "line 2, column 5: what is this";
    site.does(refusal(why));
    let verdict = site.ends().verdict.expect("there is one");
    assert_eq!(
        (verdict.kind(), verdict.reason.as_str()),
        (TrialEndKind::Refused, why)
    );
    let report = site.0.report();
    assert_eq!(report.phase(), ConfigPhaseKind::Refused);
    assert_eq!((report.version, report.kept), (3, 0));
    assert_eq!(
        (report.reason.as_str(), &*report.problem),
        (why, &b"{}"[..])
    );
    assert_eq!(site.0.file().text, "old");
    // Also where that is known only once it is applied.
    site.wants(4, "new");
    site.checks("new");
    site.does(TrialDone::Ok);
    site.does(refusal(why));
    assert_eq!(site.ends().verdict.expect("there is one").version, 4);
    assert_eq!(site.0.file().text, "old");
}

#[test]
fn a_later_one_takes_its_turn_after_a_trial() {
    let mut site = Site::new();
    site.tries(3, "new");
    site.wants(4, "newer");
    site.wants(5, "newest");
    site.wants(4, "newer");
    assert_eq!(site.next(), None);
    site.after_trial(well());
    site.ends_and_checks("newest");
}

impl Site {
    /// The end of a trial, after which this one is checked.
    fn ends_and_checks(&mut self, text: &str) {
        assert!(matches!(
            self.does(TrialDone::Ok),
            TrialOutput::StoreManaged(_)
        ));
        assert_eq!(self.does(TrialDone::Ok), TrialOutput::RemoveTrial);
        let next = TrialOutput::Check("new".to_owned(), text.to_owned());
        assert_eq!(self.next(), Some(next));
    }
}

#[test]
fn a_disk_that_refuses_is_tried_again() {
    let full = || TrialDone::Failed("disk full".to_owned());
    let mut site = Site::new();
    site.wants(3, "new");
    site.checks("new");
    site.does(full());
    assert_eq!(site.next(), None);
    assert_eq!(
        site.0.phase(),
        ConfigPhase::Pending(3, "disk full".to_owned())
    );
    site.1 += AGAIN;
    site.checks("new");
    site.does(TrialDone::Ok);
    // The file itself: it may have been written, and the record of the trial must not stay.
    site.does(full());
    let output = TrialOutput::TakeBack("new".to_owned(), "old".to_owned());
    assert_eq!(site.does(full()), output);
    site.1 += AGAIN;
    assert_eq!(site.does(TrialDone::Changed(file("old"))), output);
    assert_eq!(site.does(TrialDone::Ok), TrialOutput::RemoveTrial);
    assert_eq!((site.next(), site.0.file().text.as_str()), (None, "old"));
    assert_eq!(
        site.0.phase(),
        ConfigPhase::Pending(3, "disk full".to_owned())
    );
    // Twice as long as before.
    site.1 += AGAIN;
    assert_eq!(site.next(), None);
    site.1 += AGAIN;
    site.checks("new");
    site.does(TrialDone::Ok);
    site.does(TrialDone::Ok);
    // The text before must come back, however long that takes.
    let mut dead = well();
    dead.lines_up = names(&[]);
    site.after_trial(dead);
    for _ in 0..3 {
        site.does(full());
        assert_eq!(
            (site.next(), site.0.phase()),
            (None, ConfigPhase::Trying(3))
        );
        site.1 += AGAIN;
    }
    assert_eq!(site.does(back("old")), output);
    assert!(matches!(site.does(full()), TrialOutput::StoreManaged(_)));
    site.1 += AGAIN;
    assert!(matches!(
        site.does(TrialDone::Ok),
        TrialOutput::StoreManaged(_)
    ));
    assert_eq!(site.does(full()), TrialOutput::RemoveTrial);
    site.1 += AGAIN;
    assert_eq!(site.does(TrialDone::Ok), TrialOutput::RemoveTrial);
    assert_eq!((site.next(), site.0.deadline()), (None, None));
}

#[test]
fn what_is_changed_here_is_not_overwritten_unseen() {
    let mut site = Site::new();
    site.wants(3, "new");
    site.checks("new");
    site.does(TrialDone::Ok);
    site.does(TrialDone::Changed(file("by hand")));
    assert_eq!(site.does(TrialDone::Ok), TrialOutput::RemoveTrial);
    site.1 += AGAIN;
    site.checks("new");
    let verdict = site.ends().verdict.expect("it is another text");
    assert_eq!(verdict.kind(), TrialEndKind::Refused);
    assert_eq!(verdict.reason, "the configuration was changed at the site");
    // Nor while it is checked.
    let over = |version, text: &str, seen: &str| {
        TrialInput::Wanted(WantedConfig {
            replaces: part_hash(seen),
            ..wanted(version, text)
        })
    };
    site.0.handle(site.1, over(4, "new", "by hand"));
    site.does(TrialDone::Changed(file("by two hands")));
    site.checks("new");
    let verdict = site.ends().verdict.expect("it is another text");
    assert_eq!(
        (verdict.version, site.0.file().text.as_str()),
        (4, "by two hands")
    );
    // Its author has seen that text.
    site.0.handle(site.1, over(5, "new", "by two hands"));
    site.checks("new");
    site.does(TrialDone::Ok);
    site.does(TrialDone::Ok);
    site.after_trial(TrialHealth {
        has_session: false,
        ..well()
    });
    // A change during the trial stays, and is not said to be what was before.
    site.does(TrialDone::Changed(file("by hand again")));
    let verdict = site.ends().verdict.expect("there is one");
    assert_eq!(verdict.kind(), TrialEndKind::Interrupted);
    assert_eq!(site.0.file().text, "by hand again");
}

#[test]
fn a_text_of_the_centre_and_an_empty_one_are_replaced_by_the_next() {
    let unseen = |version, text: &str| {
        TrialInput::Wanted(WantedConfig {
            replaces: Vec::new(),
            ..wanted(version, text)
        })
    };
    let mut site = Site::new();
    site.0.handle(site.1, unseen(1, "new"));
    site.checks("new");
    assert_eq!(site.ends().verdict.expect("it is not empty").version, 1);
    // With what only the site says.
    let own = ConfigText {
        text: "own".to_owned(),
        hash: part_hash(""),
    };
    site.0.handle(site.1, TrialInput::File(own));
    site.0.handle(site.1, unseen(2, "new"));
    site.checks("new");
    site.does(TrialDone::Ok);
    site.does(TrialDone::Ok);
    site.after_trial(well());
    assert_eq!(site.ends().kept, 2);
    site.0.handle(site.1, unseen(3, "newer"));
    site.checks("newer");
}

fn left() -> TrialRecord {
    TrialRecord {
        version: 3,
        before: "old".to_owned(),
        after: "new".to_owned(),
        before_hash: part_hash("old"),
        after_hash: part_hash("new"),
    }
}

#[test]
fn one_that_is_there_already_needs_no_trial() {
    let mut site = Site::new();
    // Also without consent to replace it, as on a machine that was set up anew.
    let same = WantedConfig {
        replaces: Vec::new(),
        ..wanted(3, "old")
    };
    site.0.handle(site.1, TrialInput::Wanted(same));
    site.checks("old");
    assert_eq!(site.ends().kept, 3);
    assert_eq!(site.0.phase(), ConfigPhase::Current(3));
}

#[test]
fn a_start_leaves_what_was_changed_here() {
    let trial = left();
    let managed = ManagedRecord::default();
    let found = |text: &str| {
        let found = recover(&file(text), Some(&trial), &managed);
        let Recovery { is_back, managed } = found.expect("there was a trial");
        let verdict = managed.verdict.map(|verdict| verdict.kind());
        (is_back, verdict)
    };
    assert_eq!(found("by hand"), (false, Some(TrialEndKind::Interrupted)));
    // It was not written yet: the centre may want it again.
    assert_eq!(found("old"), (false, None));
    assert_eq!(found("new"), (true, Some(TrialEndKind::RolledBack)));
    assert_eq!(recover(&file("new"), None, &managed), None);
    // Its end is recorded.
    let ended = ManagedRecord::default().kept(3, part_hash("new"));
    let left_over = recover(&file("new"), Some(&trial), &ended);
    assert_eq!(
        left_over,
        Some(Recovery {
            is_back: false,
            managed: ended
        })
    );
}

#[test]
fn what_another_centre_wanted_counts_no_more() {
    let of_one = ManagedRecord::default().of("V1").kept(3, part_hash("new"));
    assert_eq!(of_one.clone().of("V1"), of_one);
    // A start takes back the first one before anybody says whose it is.
    let left = left();
    let found = recover(&file("new"), Some(&left), &ManagedRecord::default());
    let first = found.expect("there was a trial").managed.of("V1");
    assert_eq!((first.newest(), first.key.as_str()), (3, "V1"));
    let of_other = of_one.of("V2");
    assert_eq!((of_other.kept, of_other.key.as_str()), (0, "V2"));
}

use super::*;
use crate::dice::Dice;

fn names(count: usize) -> BTreeSet<String> {
    (0..count).map(|at| format!("site{at:05}")).collect()
}

fn of(names: &[&str]) -> BTreeSet<String> {
    names.iter().map(ToString::to_string).collect()
}

/// All sites are online.
fn online(sites: &BTreeSet<String>, canaries: &BTreeSet<String>) -> Rollout {
    let mut rollout = Rollout::new("r1", sites, canaries);
    for site in sites {
        rollout.handle(RolloutInput::Online(site, true));
    }
    rollout
}

fn given(rollout: &mut Rollout) -> Vec<String> {
    std::iter::from_fn(|| rollout.poll()).collect()
}

fn end(rollout: &mut Rollout, sites: &[String], end: RolloutEnd) {
    for site in sites {
        rollout.handle(RolloutInput::Ended(site, end));
    }
}

use RolloutEnd::{Failed, Kept};

#[test]
fn a_few_get_it_first_then_more() {
    let sites = names(1_000);
    let canaries = of(&["site00007", "site00500", "unknown"]);
    let mut rollout = online(&sites, &canaries);
    let first = given(&mut rollout);
    let canaries: BTreeSet<String> = first.iter().cloned().collect();
    assert_eq!(canaries, of(&["site00007", "site00500"]));
    assert_eq!(given(&mut rollout), Vec::<String>::new());
    end(&mut rollout, &first[..1], Kept);
    assert_eq!(given(&mut rollout), Vec::<String>::new());
    end(&mut rollout, &first[1..], Kept);
    let mut all = first;
    for (wave, until) in [(1, 10), (2, 100)] {
        let now = given(&mut rollout);
        assert_eq!((all.len() + now.len(), rollout.wave()), (until, wave));
        end(&mut rollout, &now, Kept);
        all.extend(now);
    }
    // Not more at a time than is good for anybody.
    while all.len() < 1_000 {
        let now = given(&mut rollout);
        assert_eq!(now.len(), TRYING_MAX.min(1_000 - all.len()));
        end(&mut rollout, &now, Kept);
        all.extend(now);
    }
    assert_eq!(rollout.state(), RolloutState::Done);
    let each: BTreeSet<String> = all.into_iter().collect();
    assert_eq!(each, sites);
}

#[test]
fn one_that_is_bad_for_all_halts_in_its_first_wave() {
    for (count, next) in [(1, 0), (2, 1), (30, 2), (300, 2), (10_000, 99)] {
        let sites = names(count);
        let mut rollout = online(&sites, &BTreeSet::new());
        let first = given(&mut rollout);
        assert_eq!(first.len(), 1);
        end(&mut rollout, &first, Failed);
        assert_eq!(given(&mut rollout), Vec::<String>::new());
        let halted = match count {
            1 => RolloutState::Done,
            _ => RolloutState::Halted,
        };
        assert_eq!(rollout.state(), halted);
        // Somebody knows better.
        rollout.handle(RolloutInput::GoOn);
        let second = given(&mut rollout);
        assert_eq!(second.len(), next, "{count}");
        end(&mut rollout, &second, Failed);
        assert_eq!(given(&mut rollout), Vec::<String>::new());
    }
}

/// 3 of 100 do not keep it: it halts before all have it, and nobody gets it afterwards.
#[test]
fn it_halts_where_more_than_two_of_a_hundred_fail() {
    let sites = names(300);
    let mut touched = 0;
    for seed in 1..=200 {
        let mut dice = Dice(seed);
        let bad: BTreeSet<String> = {
            let mut bad = BTreeSet::new();
            while bad.len() < 9 {
                bad.insert(format!("site{:05}", dice.roll(300)));
            }
            bad
        };
        let mut rollout = Rollout::new(&format!("r{seed}"), &sites, &BTreeSet::new());
        for site in &sites {
            rollout.handle(RolloutInput::Online(site, true));
        }
        let (mut trying, mut all) = (Vec::new(), 0);
        loop {
            let now = given(&mut rollout);
            all += now.len();
            trying.extend(now);
            assert!(trying.len() <= TRYING_MAX);
            let counts = rollout.counts();
            let is_bad = counts.failed * FAILED_OF > counts.kept + counts.failed;
            assert!(!is_bad || rollout.is_halted, "seed {seed}");
            if trying.is_empty() {
                break;
            }
            // They end in any order.
            let at = dice.roll(u64::try_from(trying.len()).unwrap());
            let site: String = trying.swap_remove(usize::try_from(at).unwrap());
            let how = if bad.contains(&site) { Failed } else { Kept };
            end(&mut rollout, &[site], how);
            if rollout.is_halted {
                assert_eq!(given(&mut rollout), Vec::<String>::new(), "seed {seed}");
            }
        }
        assert!(rollout.is_halted, "seed {seed}");
        touched += all;
    }
    // Most sites never got it.
    assert!(touched < 200 * 150, "{touched}");
}

#[test]
fn who_is_away_takes_part_when_he_comes() {
    let sites = names(200);
    let canaries = of(&["site00001", "site00002"]);
    let mut rollout = online(&sites, &canaries);
    rollout.handle(RolloutInput::Online("site00001", false));
    rollout.handle(RolloutInput::Online("site00002", false));
    // Without one of its canaries it does not begin.
    assert_eq!(given(&mut rollout), Vec::<String>::new());
    rollout.handle(RolloutInput::Online("site00002", true));
    assert_eq!(given(&mut rollout), ["site00002"]);
    // It is there no longer, without a word: others wait for it, or for the other one.
    rollout.handle(RolloutInput::Online("site00002", false));
    assert_eq!(given(&mut rollout), Vec::<String>::new());
    rollout.handle(RolloutInput::Online("site00002", true));
    rollout.handle(RolloutInput::Ended("site00002", Kept));
    let mut count = 1;
    loop {
        let now = given(&mut rollout);
        if now.is_empty() {
            break;
        }
        count += now.len();
        end(&mut rollout, &now, Kept);
    }
    assert_eq!((count, rollout.state()), (199, RolloutState::Running));
    rollout.handle(RolloutInput::Online("site00001", true));
    assert_eq!(given(&mut rollout), ["site00001"]);
    rollout.handle(RolloutInput::Ended("site00001", Kept));
    assert_eq!(rollout.state(), RolloutState::Done);
}

#[test]
fn another_process_goes_on_with_it() {
    let sites = names(1_000);
    let mut first = online(&sites, &BTreeSet::new());
    let mut said = Vec::new();
    for _ in 0..3 {
        let now = given(&mut first);
        end(&mut first, &now, Kept);
        said.extend(now);
    }
    let trying = first.poll().expect("one more");
    let mut second = online(&sites, &BTreeSet::new());
    end(&mut second, &said, Kept);
    second.handle(RolloutInput::Given(&trying));
    // Nobody gets it twice, and nobody is left out.
    let (rest, other) = (given(&mut first), given(&mut second));
    assert_eq!(rest, other);
    assert_eq!(first.wave(), second.wave());
    assert_eq!(first.counts(), second.counts());
}

#[test]
fn somebody_stops_it_and_lets_it_go_on() {
    let sites = names(500);
    let mut rollout = online(&sites, &BTreeSet::new());
    let first = given(&mut rollout);
    rollout.handle(RolloutInput::Stop);
    end(&mut rollout, &first, Kept);
    assert_eq!(given(&mut rollout), Vec::<String>::new());
    assert_eq!(rollout.state(), RolloutState::Stopped);
    rollout.handle(RolloutInput::GoOn);
    assert_eq!(given(&mut rollout).len(), 4);
    // A site that is none of it changes nothing.
    rollout.handle(RolloutInput::Ended("other", Failed));
    assert_eq!(rollout.state(), RolloutState::Running);
    let none = Rollout::new("r", &BTreeSet::new(), &BTreeSet::new());
    assert_eq!(none.state(), RolloutState::Done);
}

#[test]
fn what_failed_before_somebody_let_it_go_on_does_not_count() {
    let sites = names(300);
    let mut rollout = online(&sites, &BTreeSet::new());
    let first = given(&mut rollout);
    end(&mut rollout, &first, Failed);
    rollout.handle(RolloutInput::GoOn);
    let second = given(&mut rollout);
    end(&mut rollout, &second, Kept);
    assert_eq!(rollout.state(), RolloutState::Running);
    let third = given(&mut rollout);
    assert_eq!(third.len(), 27);
    end(&mut rollout, &third[..1], Failed);
    assert_eq!(rollout.state(), RolloutState::Halted);
}

/// Sites with like names are alike: those that get it first are not all of one kind.
#[test]
fn the_order_has_nothing_to_do_with_names() {
    let sites = names(1_000);
    let first = |id: &str| {
        let mut rollout = Rollout::new(id, &sites, &BTreeSet::new());
        for site in &sites {
            rollout.handle(RolloutInput::Online(site, true));
        }
        let canary = given(&mut rollout);
        end(&mut rollout, &canary, Kept);
        given(&mut rollout)
    };
    let (one, other) = (first("a"), first("b"));
    let is_late = |site: &&String| site.as_str() >= "site00500";
    let late = one.iter().filter(is_late).count();
    assert!((1..9).contains(&late), "{one:?}");
    assert_ne!(one, other);
    assert_eq!(one, first("a"));
}

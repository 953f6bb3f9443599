//! Modules are removed and others installed at their addresses, at any moment, from a seed; a judge
//! that knows none of the line's rules checks whether what is reported is true
//! (docs/decisions/0031).
//!
//! The judge knows which module is at each address, which engine received and answered what, and
//! the true state of its outputs. With losses, of frames and of letters of a name, it checks only
//! what always holds: each command ends once, none whose frame was received ends as not sent, what
//! is read back was so, and the right module is not reported as another for long after the last
//! loss. Known limits without losses are stated where they are accepted, in `judge.rs`.
//!
//! - `SWAPS_SEED=7 cargo test -p railbus-bus --test swaps -- --nocapture` does one line again and
//!   shows what happens on it.
//! - `SWAPS_COUNT=3000` plays so many lines; with `--nocapture` it says how near each limit came.

#![allow(
    clippy::print_stdout,
    reason = "a line that is done again is shown, and how near its limits came"
)]

#[path = "../support/mod.rs"]
mod support;

mod dice;
mod judge;
mod line;
mod place;
mod tally;
mod wire;

use judge::Judge;
use std::fmt::Write;
use tally::Tally;

/// The number of lines played by default.
const LINES: u64 = 150;
/// Seeds further on that, among the first thousands, showed a broken rule.
const KEPT: [u64; 3] = [444, 779, 2450];

/// A number from the environment.
fn number(name: &str) -> Option<u64> {
    let value = std::env::var(name).ok()?;
    Some(value.parse().expect("a number"))
}

fn play(test: &str, lossy: bool) -> Tally {
    let count = number("SWAPS_COUNT").unwrap_or(LINES);
    let one = number("SWAPS_SEED");
    let seeds = one.map_or(0..count, |seed| seed..seed + 1);
    let kept = KEPT
        .into_iter()
        .filter(|seed| one.is_none() && *seed >= count);
    let (mut tally, mut wrong) = (Tally::default(), String::new());
    let mut lines = 0;
    for seed in seeds.chain(kept) {
        let mut judge = Judge::new(seed, lossy, one.is_some());
        judge.play();
        tally.add(&judge.tally);
        lines += 1;
        for fault in &judge.faults {
            let _ = writeln!(wrong, "SWAPS_SEED={seed} ({}): {fault}", judge.about);
        }
    }
    tally.show(lines);
    assert!(
        wrong.is_empty(),
        "{wrong}each again: SWAPS_SEED=… cargo test -p railbus-bus --test swaps {test} -- \
         --nocapture"
    );
    tally
}

#[test]
fn whatever_is_swapped_is_told_as_it_is() {
    let tally = play("whatever_is_swapped", false);
    // If these do not happen, nothing was shown.
    if number("SWAPS_SEED").is_none() {
        assert!(tally.strangers > LINES && tally.done > 10 * LINES && tally.not_done > LINES);
        // If these are frequent, too much is accepted.
        assert!(
            tally.unnoticed_values * 20 < tally.values
                && tally.unnoticed_commands * 50 < tally.done
        );
        assert!(
            tally.foreign_values * 500 < tally.values && tally.foreign_commands * 500 < tally.done
        );
    }
}

#[test]
fn whatever_is_lost_as_well_nothing_is_denied_that_may_be() {
    play("whatever_is_lost", true);
}

//! Whether everything `railbus serve` reports of five boards is true, while they lose power and the
//! line garbles characters: what their chips show from outside is compared with it by the judge of
//! the soak, and by checks that are possible only here.
//!
//! The plan comes from a seed, which `TRIAL_SEED` reproduces; the timing is not reproduced.

mod order;
mod plant;

use crate::World;
use crate::dice::Dice;
use crate::site::{Site, said};
use plant::{Plant, Reading, Seat};
use std::collections::BTreeMap;
use std::time::{Duration, Instant};

/// How often modules lose power.
const OUTAGES: usize = 6;

/// This many commands of each other module must succeed in each outage.
const OTHERS: usize = 2;

/// The time limit for anything expected.
const PATIENCE: Duration = Duration::from_secs(90);

/// The percentage of the commands for powered modules that must succeed. Garbled characters and a
/// busy machine take their share.
const WELL: usize = 70;

/// Commands, power cuts and good readings of them that have to be judged at the least.
const COMMANDS_MIN: usize = 100;
const READINGS_MIN: u64 = 2_000;

/// As above.
pub(crate) fn what_is_told_is_so(world: &World) -> Result<String, String> {
    let seed = match std::env::var("TRIAL_SEED") {
        Ok(seed) => seed.parse().map_err(|_| "TRIAL_SEED is no number")?,
        Err(_) => std::time::UNIX_EPOCH.elapsed().map_err(said)?.as_secs(),
    };
    let told = told(world, seed);
    told.map(|seen| format!("TRIAL_SEED={seed}: {seen}"))
        .map_err(|why| format!("TRIAL_SEED={seed}: {why}"))
}

fn told(world: &World, seed: u64) -> Result<String, String> {
    let mut site = Site::new(world)?;
    let _daemon = site.daemon()?;
    site.all_good()?;
    let plant = Plant::new(&mut site, seed);
    let mut dice = Dice::new(!seed);
    let cuts = std::thread::scope(|scope| {
        for seat in &plant.seats {
            scope.spawn(|| plant.drive(seat));
        }
        let mut outage = |cuts, _| plant.outage(&mut dice).map(|more| cuts + more);
        let cuts = (0..OUTAGES).try_fold(0, &mut outage);
        plant.stop();
        cuts
    })?;
    // Nothing moves any more: now every value must be what the boards show.
    let quiet = plant.now();
    plant.until("every point is good", &mut dice, |readings| {
        readings
            .iter()
            .all(|reading| reading.good && reading.from >= quiet)
    })?;
    plant.every_command_ended_once()?;
    plant.verdict(cuts)
}

impl Plant {
    /// Some modules lose their power at the same time and get it back; how many.
    fn outage(&self, dice: &mut Dice) -> Result<usize, String> {
        let count = dice.between(1, 3) as usize;
        let mut order: Vec<&Seat> = self.seats.iter().collect();
        order.sort_by_cached_key(|_| dice.next());
        let (dark, lit) = order.split_at(count);
        std::thread::sleep(Duration::from_millis(dice.between(0, 400)));
        for seat in dark {
            self.cut(seat)?;
        }
        let cut = self.now();
        self.until("the others are served, the dead ones told", dice, |told| {
            let ends = self.ends();
            let count = |seat: &Seat, well: bool| {
                let of = ends
                    .iter()
                    .filter(|end| self.seats[end.seat].name == seat.name);
                of.filter(|end| end.began >= cut && end.done == well)
                    .count()
            };
            let good = |seat: &&Seat| told.iter().any(|one| one.good && one.seat == seat.index);
            lit.iter().all(|seat| count(seat, true) >= OTHERS)
                && dark.iter().all(|seat| count(seat, false) > 0)
                && !dark.iter().any(good)
        })?;
        let back = self.now();
        for seat in dark {
            self.restore(seat)?;
        }
        self.until("what has power again is good again", dice, |told| {
            let mut of_dark = told
                .iter()
                .filter(|one| dark.iter().any(|seat| seat.index == one.seat));
            of_dark.all(|reading| reading.good && reading.from >= back)
        })?;
        Ok(count)
    }

    /// Compares again and again until what was read is as wanted; the inputs move meanwhile.
    fn until(
        &self,
        what: &str,
        dice: &mut Dice,
        mut wanted: impl FnMut(&[Reading]) -> bool,
    ) -> Result<(), String> {
        let until = Instant::now() + PATIENCE;
        loop {
            self.move_inputs(dice)?;
            let readings = self.compare()?;
            self.check()?;
            if wanted(&readings) {
                return Ok(());
            }
            if Instant::now() > until {
                return Err(format!("{what}: that did not come to be; {}", self.tally()));
            }
            std::thread::sleep(Duration::from_millis(dice.between(50, 200)));
        }
    }

    /// The audit log has a beginning and one end of every command.
    fn every_command_ended_once(&self) -> Result<(), String> {
        let mut records: BTreeMap<String, [usize; 2]> = BTreeMap::new();
        for record in self.audit()? {
            let id = record["id"].as_str().unwrap_or_default().to_owned();
            match record["kind"].as_str() {
                Some("begin") => records.entry(id).or_default()[0] += 1,
                Some("end") => records.entry(id).or_default()[1] += 1,
                _ => {}
            }
        }
        let given = self.ends().len();
        let odd = records.iter().find(|(_, counts)| **counts != [1, 1]);
        match odd {
            Some((id, [begun, ended])) => {
                Err(format!("audit: {id} began {begun} times, ended {ended}"))
            }
            None if records.len() != given => Err(format!(
                "audit: {} commands, but {given} were given",
                records.len()
            )),
            None => Ok(()),
        }
    }

    fn verdict(&self, cuts: usize) -> Result<String, String> {
        let ends = self.ends();
        self.judge().close();
        self.check()?;
        let verdicts = self.judge().verdicts;
        let lit: Vec<_> = ends.iter().filter(|end| end.lit).collect();
        let well = lit.iter().filter(|end| end.done).count();
        let seen = format!(
            "{} commands ({}), {cuts} power cuts in {OUTAGES} outages; {well} of {} with power \
             ended well; {} values true; {} characters spoilt, {} of what came of it unnoticed",
            ends.len(),
            self.tally(),
            lit.len(),
            verdicts.readings - verdicts.undetected,
            self.spoilt(),
            verdicts.undetected + verdicts.confirmed_undetected + verdicts.acted_undetected,
        );
        let enough = ends.len() >= COMMANDS_MIN && verdicts.readings >= READINGS_MIN;
        if enough && well * 100 >= lit.len() * WELL {
            Ok(seen)
        } else {
            Err(format!("that is too little: {seen}"))
        }
    }

    /// How many commands ended how.
    fn tally(&self) -> String {
        let mut kinds: BTreeMap<String, usize> = BTreeMap::new();
        for end in self.ends() {
            *kinds.entry(end.how).or_default() += 1;
        }
        let kinds = kinds.iter().map(|(how, count)| format!("{count} {how}"));
        kinds.collect::<Vec<_>>().join(", ")
    }
}

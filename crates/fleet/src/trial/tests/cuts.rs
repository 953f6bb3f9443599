//! A site whose power is cut before or after any of its writes, from a seed. The judge knows which
//! texts work.

use super::*;
use crate::dice::Dice;

/// What is on the disk. Each write is whole, or did not happen.
#[derive(Clone, Debug, Default)]
struct Disk {
    file: String,
    trial: Option<TrialRecord>,
    managed: ManagedRecord,
}

/// Some that are good, one that loses a module, one that is refused, and one that ends the process
/// at once.
const TEXTS: [&str; 6] = ["good a", "good b", "loses", "bad", "kills", "good c"];

fn health(text: &str) -> TrialHealth {
    let mut health = well();
    if text == "loses" {
        health.modules_online = names(&["tank"]);
    }
    health
}

struct World {
    dice: Dice,
    disk: Disk,
    /// How many writes there are left until the power is cut.
    left: Option<u64>,
    /// The texts of versions, from 1 on.
    versions: Vec<&'static str>,
    /// Texts with which the site worked at the end of a whole trial in one run.
    proven: BTreeSet<String>,
    now: Duration,
}

/// The power was cut.
#[derive(Debug)]
struct Cut;

impl World {
    fn new(seed: u64) -> World {
        let mut dice = Dice(seed);
        let mut text = || TEXTS[usize::try_from(dice.roll(6)).unwrap()];
        World {
            versions: vec![text(), text(), text(), text(), text()],
            dice,
            disk: Disk {
                file: "first".to_owned(),
                ..Disk::default()
            },
            left: None,
            proven: BTreeSet::from(["first".to_owned()]),
            now: S(100),
        }
    }

    fn write(&mut self, write: impl FnOnce(&mut Disk)) -> Result<(), Cut> {
        match &mut self.left {
            Some(0) => {
                if self.dice.roll(2) == 0 {
                    write(&mut self.disk);
                }
                return Err(Cut);
            }
            Some(left) => *left -= 1,
            None => {}
        }
        write(&mut self.disk);
        Ok(())
    }

    /// What the start of a site does, before it uses the file.
    fn recovers(&mut self) -> Result<(), Cut> {
        let Disk {
            file,
            trial,
            managed,
        } = &self.disk;
        let Some(recovery) = recover(file, trial.as_ref(), managed) else {
            return Ok(());
        };
        if let Some(text) = recovery.file {
            self.write(|disk| disk.file = text)?;
        }
        self.write(|disk| disk.managed = recovery.managed)?;
        self.write(|disk| disk.trial = None)
    }

    /// A run of the site, until nothing is left to do.
    fn runs(&mut self) -> Result<(), Cut> {
        self.recovers()?;
        assert!(self.proven.contains(&self.disk.file), "{}", self.disk.file);
        let mut site = ConfigTrial::new(self.disk.managed.clone(), file(&self.disk.file), None);
        site.handle(self.now, TrialInput::Health(health(&self.disk.file)));
        for (version, text) in (1..).zip(self.versions.clone()) {
            if version == 5 || self.dice.roll(2) == 0 {
                let wanted = WantedConfig {
                    replaces: part_hash("first"),
                    ..wanted(version, text)
                };
                site.handle(self.now, TrialInput::Wanted(wanted));
            }
        }
        let mut since = self.now;
        for _ in 0..1_000 {
            while let Some(output) = site.poll(self.now) {
                let done = self.does(output, &mut since)?;
                site.handle(self.now, TrialInput::Done(done));
            }
            self.now += S(1);
            // It may be cut at any time.
            if self.left.is_some() && self.dice.roll(400) == 0 {
                return Err(Cut);
            }
            let works = health(&self.disk.file);
            if self.now >= since + TRIAL && works == well() {
                self.proven.insert(self.disk.file.clone());
            }
            site.handle(self.now, TrialInput::Health(works));
        }
        assert_eq!(site.file().text, self.disk.file);
        let phase = site.phase();
        let is_open = matches!(phase, ConfigPhase::Trying(_) | ConfigPhase::Pending(..));
        assert!(!is_open, "{phase:?}");
        Ok(())
    }

    fn does(&mut self, output: TrialOutput, since: &mut Duration) -> Result<TrialDone, Cut> {
        let fails = self.dice.roll(20) == 0;
        match output {
            TrialOutput::Check(_, text) if text == "bad" => return Ok(refusal("bad")),
            TrialOutput::Check(from, text) => {
                assert_eq!(self.disk.file, from);
                return Ok(TrialDone::Checked(file(&text)));
            }
            _ if fails => return Ok(TrialDone::Failed("disk full".to_owned())),
            TrialOutput::StoreTrial(record) => self.write(|disk| disk.trial = Some(record))?,
            TrialOutput::Apply(from, to) | TrialOutput::TakeBack(from, to) => {
                assert_eq!(self.disk.file, from);
                let trial = self.disk.trial.clone().expect("it is recorded first");
                assert!([&trial.before, &trial.after].contains(&&to));
                self.write(|disk| disk.file.clone_from(&to))?;
                *since = self.now;
                if to == "kills" {
                    return Err(Cut);
                }
            }
            TrialOutput::StoreManaged(record) => self.write(|disk| disk.managed = record)?,
            TrialOutput::RemoveTrial => self.write(|disk| disk.trial = None)?,
        }
        Ok(TrialDone::Ok)
    }
}

/// The file has the old text or the new one, and one that was not proven is neither used by another
/// run nor left at the end.
#[test]
fn an_unproven_text_never_stays_wherever_the_power_is_cut() {
    let (mut kept, mut back, mut cuts) = (0, 0, 0);
    for seed in 1..=1_000 {
        let mut world = World::new(seed);
        for _ in 0..world.dice.roll(6) {
            world.left = Some(world.dice.roll(14));
            cuts += u64::from(world.runs().is_err());
        }
        world.left = None;
        // One that ends the process does so once.
        let ends = (0..5).find_map(|_| world.runs().ok());
        assert!(ends.is_some(), "seed {seed}: it never runs");
        let Disk {
            file,
            trial,
            managed,
        } = &world.disk;
        assert_eq!(*trial, None, "seed {seed}");
        assert!(world.proven.contains(file), "seed {seed}: {file}");
        assert_eq!(managed.newest(), 5, "seed {seed}: each has its end");
        // One that is good may be taken back, where the power was cut during its trial.
        let is_kept = managed.kept == 5;
        assert!(!is_kept || file == world.versions[4], "seed {seed}");
        assert!(
            !is_kept || file.starts_with("good"),
            "seed {seed}: {file} was kept"
        );
        kept += u64::from(is_kept);
        back += u64::from(!is_kept);
    }
    assert!(
        kept > 200 && back > 200 && cuts > 500,
        "{kept} {back} {cuts}"
    );
}

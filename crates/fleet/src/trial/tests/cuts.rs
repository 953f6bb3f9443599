//! A site whose power is cut before or after any of its writes, from a seed, whose disk may write
//! and say that it did not, and where people change the file. The judge knows which texts work.

use super::*;
use crate::dice::Dice;

/// What is on the disk. Each write is whole, or did not happen.
#[derive(Clone, Debug, Default)]
struct Disk {
    /// What only the site says, and what the centre may say.
    own: String,
    part: String,
    trial: Option<TrialRecord>,
    managed: ManagedRecord,
}

impl Disk {
    fn file(&self) -> ConfigText {
        whole(&self.own, &self.part)
    }
}

fn whole(own: &str, part: &str) -> ConfigText {
    ConfigText {
        text: format!("{own};{part}"),
        hash: part_hash(part),
    }
}

/// The part of a text that the centre may say.
fn part_of(text: &str) -> String {
    let (_, part) = text.split_once(';').unwrap();
    part.to_owned()
}

/// Some that are good, one that loses a module, one that is refused, and one that ends the process
/// at once.
const TEXTS: [&str; 6] = ["good a", "good b", "loses", "bad", "kills", "good c"];
const BY_HAND: &str = "by hand";

fn health(part: &str, since: Duration) -> TrialHealth {
    let mut health = well();
    // Modules are not there at once.
    match (part, since < S(3)) {
        (_, true) => health.modules_online = names(&[]),
        ("loses", false) => health.modules_online = names(&["tank"]),
        _ => {}
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
    /// Parts with which the site worked at the end of a whole trial in one run, and those of
    /// people.
    proven: BTreeSet<String>,
    now: Duration,
    /// Since when the part is as it is, in this run.
    since: Duration,
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
                own: "own".to_owned(),
                part: "first".to_owned(),
                ..Disk::default()
            },
            left: None,
            proven: BTreeSet::from(["first".to_owned(), BY_HAND.to_owned()]),
            now: S(100),
            since: S(100),
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
        let Disk { trial, managed, .. } = &self.disk;
        let Some(recovery) = recover(&self.disk.file(), trial.as_ref(), managed) else {
            return Ok(());
        };
        if recovery.is_back {
            let before = part_of(&trial.as_ref().unwrap().before);
            self.write(|disk| disk.part = before)?;
        }
        self.write(|disk| disk.managed = recovery.managed)?;
        self.write(|disk| disk.trial = None)
    }

    /// The integration starts, with what is on the disk.
    fn begins(&mut self) -> ConfigTrial {
        let Disk { trial, managed, .. } = self.disk.clone();
        let mut site = ConfigTrial::new(managed, self.disk.file(), trial);
        for (version, text) in (1..).zip(self.versions.clone()) {
            if version == 5 || self.dice.roll(2) == 0 {
                self.wants(&mut site, version, text);
            }
        }
        site
    }

    fn wants(&self, site: &mut ConfigTrial, version: u64, text: &str) {
        let wanted = WantedConfig {
            // Whoever wants it has seen what is there.
            replaces: part_hash(&self.disk.part),
            ..wanted(version, text)
        };
        site.handle(self.now, TrialInput::Wanted(wanted));
    }

    /// A run of the site, until nothing is left to do.
    fn runs(&mut self) -> Result<(), Cut> {
        self.recovers()?;
        assert!(self.proven.contains(&self.disk.part), "{}", self.disk.part);
        self.since = self.now;
        let mut site = self.begins();
        for second in 0..1_500 {
            while let Some(output) = site.poll(self.now) {
                let done = self.does(output)?;
                site.handle(self.now, TrialInput::Done(done));
            }
            self.now += S(1);
            // It may be cut at any time, people may change either part, and what drives it may end.
            if second < 900 {
                match self.dice.roll(1_200) {
                    0 if self.left.is_some() => return Err(Cut),
                    1 => self.disk.own = format!("own {second}"),
                    2 if self.dice.roll(3) == 0 => {
                        self.disk.part = BY_HAND.to_owned();
                        self.since = self.now;
                    }
                    3 => site = self.begins(),
                    _ => {}
                }
                site.handle(self.now, TrialInput::File(self.disk.file()));
            }
            let works = health(&self.disk.part, self.now.saturating_sub(self.since));
            if self.now >= self.since + TRIAL && works == well() {
                self.proven.insert(self.disk.part.clone());
            }
            site.handle(self.now, TrialInput::Health(works));
        }
        assert_eq!(site.file(), &self.disk.file());
        let phase = site.phase();
        let is_open = matches!(phase, ConfigPhase::Trying(_) | ConfigPhase::Pending(..));
        assert!(!is_open, "{phase:?}");
        self.is_told_as_it_is(&site);
        Ok(())
    }

    fn is_told_as_it_is(&self, site: &ConfigTrial) {
        let report = site.report();
        let version = usize::try_from(report.kept).unwrap();
        let kept = version.checked_sub(1).map(|at| self.versions[at]);
        assert_eq!(
            report.is_local,
            kept != Some(self.disk.part.as_str()),
            "{report:?}"
        );
        if report.phase() == ConfigPhaseKind::RolledBack {
            let at = usize::try_from(report.version).unwrap() - 1;
            let is_there = self.versions[at] == self.disk.part;
            let is_proven = self.proven.contains(&self.disk.part);
            assert!(!is_there || is_proven, "it is not back: {report:?}");
        }
    }

    fn does(&mut self, output: TrialOutput) -> Result<TrialDone, Cut> {
        let fails = self.dice.roll(20) == 0;
        match output {
            TrialOutput::Check(_, part) if part == "bad" => return Ok(refusal("bad")),
            TrialOutput::Check(from, part) => {
                return Ok(match self.disk.file() {
                    file if file.text == from => TrialDone::Checked(whole(&self.disk.own, &part)),
                    other => TrialDone::Changed(other),
                });
            }
            TrialOutput::Apply(from, to) => {
                if self.disk.file().text != from {
                    return Ok(TrialDone::Changed(self.disk.file()));
                }
                let trial = self.disk.trial.clone().expect("it is recorded first");
                assert_eq!((&trial.before, &trial.after), (&from, &to));
                let part = part_of(&to);
                let kills = part == "kills";
                if !fails || self.dice.roll(2) == 0 {
                    self.write(|disk| disk.part = part)?;
                    self.since = self.now;
                }
                if kills && self.disk.part == "kills" {
                    return Err(Cut);
                }
            }
            TrialOutput::TakeBack(from, to) => {
                assert!(self.disk.trial.is_some(), "it is recorded first");
                if self.disk.part != part_of(&from) {
                    return Ok(TrialDone::Changed(self.disk.file()));
                }
                if !fails || self.dice.roll(2) == 0 {
                    let part = part_of(&to);
                    self.write(|disk| disk.part = part)?;
                    self.since = self.now;
                }
                if !fails {
                    return Ok(TrialDone::Back(self.disk.file()));
                }
            }
            _ if fails => {}
            TrialOutput::StoreTrial(record) => self.write(|disk| disk.trial = Some(record))?,
            TrialOutput::StoreManaged(record) => self.write(|disk| disk.managed = record)?,
            TrialOutput::RemoveTrial => self.write(|disk| disk.trial = None)?,
        }
        Ok(match fails {
            true => TrialDone::Failed("disk full".to_owned()),
            false => TrialDone::Ok,
        })
    }
}

/// The file has the old part or the new one, and one that was not proven is neither used by another
/// run nor left at the end; what is said of it is so.
#[test]
fn an_unproven_text_never_stays_wherever_the_power_is_cut() {
    let (mut kept, mut back, mut cuts) = (0, 0, 0);
    for seed in 1..=300 {
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
            part,
            trial,
            managed,
            ..
        } = &world.disk;
        assert_eq!(*trial, None, "seed {seed}");
        assert!(world.proven.contains(part), "seed {seed}: {part}");
        assert_eq!(managed.newest(), 5, "seed {seed}: each has its end");
        // One that is good may be taken back, where the power was cut during its trial.
        let is_kept = managed.kept == 5;
        let wanted = world.versions[4];
        assert!(
            !is_kept || wanted.starts_with("good"),
            "seed {seed}: {wanted} was kept"
        );
        kept += u64::from(is_kept);
        back += u64::from(!is_kept);
    }
    assert!(kept > 45 && back > 60 && cuts > 150, "{kept} {back} {cuts}");
}

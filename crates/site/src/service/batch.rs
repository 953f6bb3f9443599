//! Several outputs at once: in as few frames as can be, all or nothing where that is asked for.

use super::command::TTL;
use super::timer::to_its_end;
use super::turn::Turn;
use super::{Service, lock};
use crate::config::Place;
use crate::{Failure, WriteDone, WriteTerms};
use railbus_device::{Bank, Module, Point};
use railbus_host::{Confirmed, Fault};
use railbus_wire::Micros;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use tokio::time::Instant;

/// On what terms several outputs are switched.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BatchTerms {
    /// Read the outputs back and compare, where the module can.
    pub verify: bool,
    /// Who asks means it, also for outputs that want that to be said.
    pub confirm: bool,
    /// Where one fails, what was done is taken back.
    pub all_or_nothing: bool,
}

impl Default for BatchTerms {
    fn default() -> BatchTerms {
        BatchTerms {
            verify: true,
            confirm: false,
            all_or_nothing: false,
        }
    }
}

/// One output of several, and what came of it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Part {
    /// Which output.
    pub place: Place,
    /// What it was to become.
    pub wanted: bool,
    /// How it ended.
    pub end: Result<PartDone, Failure>,
}

/// How one output of several was switched.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PartDone {
    /// What it is now; none where nobody can know.
    pub value: Option<bool>,
    /// What it was before, where that was known.
    pub before: Option<bool>,
    /// How far that is certain.
    pub confirmed: Confirmed,
    /// From handing the command in to the last byte of its own reply.
    pub took: Micros,
    /// The number of its audit entry.
    pub audit: String,
}

/// What came of several outputs.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct BatchDone {
    /// Each of them, in the order asked.
    pub parts: Vec<Part>,
    /// One failed, and all that was done was taken back.
    pub undone: bool,
}

impl BatchDone {
    fn has_failed(&self) -> bool {
        self.parts.iter().any(|part| part.end.is_err())
    }
}

/// What a group is brought into.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GroupState {
    /// All of it on, or all of it off.
    Set(bool),
    /// Off where any of it is on or may be, else on.
    Toggle,
}

/// What outputs are; those of which nothing is known are not in it.
type States = BTreeMap<Place, bool>;

/// An output of a batch and its number there.
type Item = (usize, Place, bool);

/// Whose turn it is while several outputs are switched.
#[derive(Clone, Debug)]
enum Held {
    /// Each command waits for a turn of its own.
    Not,
    /// What was decided holds for all of them. The outputs of a command are given back with its
    /// end.
    Each(Arc<Turn>),
    /// Until all of it has ended: what was done may have to be taken back.
    All(Arc<Turn>),
}

impl Service {
    /// Switches outputs of any modules. Those of one module go together; where some of them
    /// exclude each other, what goes off goes before what goes on. Where it is all or nothing,
    /// nobody else commands the outputs meanwhile.
    pub async fn batch(&self, set: &[(Place, bool)], terms: BatchTerms) -> BatchDone {
        let (service, asked) = (self.clone(), set.to_vec());
        // It goes on to its end, where it may be taken back, whether or not somebody waits.
        let done = tokio::spawn(async move { service.batch_asked(&asked, terms).await }).await;
        done.unwrap_or_else(|_| BatchDone {
            parts: parts(set, |_, _| Err(Fault::Unknown.into())),
            undone: false,
        })
    }

    async fn batch_asked(&self, set: &[(Place, bool)], terms: BatchTerms) -> BatchDone {
        let (mut done, items) = self.checked(set, terms);
        if !terms.all_or_nothing || items.is_empty() {
            self.switch_in_turn(&mut done, &items, terms, &Held::Not)
                .await;
            return done;
        }
        let places: Vec<Place> = items.iter().map(|item| item.1.clone()).collect();
        // Before the turn: nobody has to wait while a silent module is asked.
        self.ask_unknown(&places).await;
        match self.inner.turn(places, Instant::now() + TTL).await {
            Ok(turn) => {
                // Meanwhile the configuration may have changed, or the site begun to end.
                let (done, items) = self.checked(set, terms);
                if items.is_empty() {
                    return done;
                }
                let places: Vec<Place> = items.iter().map(|item| item.1.clone()).collect();
                let before = self.read_in_turn(&places).await;
                self.all_or_nothing(done, &items, terms, (turn, before))
                    .await
            }
            Err(fault) => BatchDone {
                parts: parts(set, |_, _| Err(fault.into())),
                undone: false,
            },
        }
    }

    /// Outputs with why each of them is not tried yet, and those that can be. Where it is all or
    /// nothing and one can't be, none is.
    fn checked(&self, set: &[(Place, bool)], terms: BatchTerms) -> (BatchDone, Vec<Item>) {
        let may = |place: &Place, on| self.may_switch(place, on, terms.confirm);
        let checked = |place: &Place, on| Err(may(place, on).err().unwrap_or(Failure::NotTried));
        let done = BatchDone {
            parts: parts(set, checked),
            undone: false,
        };
        let refused = |part: &Part| part.end != Err(Failure::NotTried);
        if terms.all_or_nothing && done.parts.iter().any(refused) {
            return (done, Vec::new());
        }
        let numbered = done.parts.iter().enumerate();
        let items = numbered
            .filter(|(_, part)| !refused(part))
            .map(|(number, part)| (number, part.place.clone(), part.wanted));
        let items = items.collect();
        (done, items)
    }

    async fn all_or_nothing(
        &self,
        mut done: BatchDone,
        items: &[Item],
        terms: BatchTerms,
        (turn, before): (Turn, States),
    ) -> BatchDone {
        let held = Held::All(Arc::new(turn));
        self.switch_in_turn(&mut done, items, terms, &held).await;
        if done.has_failed() {
            // Taken back, the outputs are as they were found, in their pulses and leases.
            self.undo(&mut done, items, &before, &held).await;
            return done;
        }
        let places: Vec<Place> = items.iter().map(|item| item.1.clone()).collect();
        if let Err(why) = self.inner.schedule.take_over(&places, None).await {
            for part in &mut done.parts {
                part.end = Err(Failure::NotTakenOver(why.kind()));
            }
        }
        done
    }

    /// Brings a group into a state.
    ///
    /// # Errors
    /// [`Failure::NoSuchGroup`]; where it is to be toggled, also as [`Service::write`] while
    /// others command it.
    pub async fn set_group(
        &self,
        group: &str,
        to: GroupState,
        terms: BatchTerms,
    ) -> Result<BatchDone, Failure> {
        let members = {
            let state = lock(&self.inner.state);
            let group = state.site.config().groups.get(group);
            group.ok_or(Failure::NoSuchGroup)?.members.clone()
        };
        match to {
            GroupState::Set(on) => {
                let set: Vec<_> = members.into_iter().map(|member| (member, on)).collect();
                Ok(self.batch(&set, terms).await)
            }
            GroupState::Toggle => {
                let service = self.clone();
                to_its_end(async move { service.toggle_group(members, terms).await }).await
            }
        }
    }

    /// What it becomes is decided in the turn with all of it: of two at once, the later one sees
    /// what the first has done.
    async fn toggle_group(
        &self,
        members: Vec<Place>,
        terms: BatchTerms,
    ) -> Result<BatchDone, Failure> {
        // Before the turn: nobody has to wait while a silent module is asked.
        self.ask_unknown(&members).await;
        let turn = self.inner.turn(members.clone(), Instant::now() + TTL);
        let turn = turn.await?;
        let before = self.read_in_turn(&members).await;
        // Where nothing is known, any of it may be on.
        let are_off = members.iter().all(|at| before.get(at) == Some(&false));
        let set: Vec<_> = members.into_iter().map(|at| (at, are_off)).collect();
        let (mut done, items) = self.checked(&set, terms);
        if terms.all_or_nothing && !items.is_empty() {
            let all = self.all_or_nothing(done, &items, terms, (turn, before));
            return Ok(all.await);
        }
        turn.give_back(|place| !items.iter().any(|item| item.1 == *place));
        let held = Held::Each(Arc::new(turn));
        self.switch_in_turn(&mut done, &items, terms, &held).await;
        Ok(done)
    }

    /// In how many frames these outputs can be brought into one state.
    #[must_use]
    pub fn frames_of(&self, outputs: &[Place]) -> usize {
        let mut masks: BTreeMap<&str, u32> = BTreeMap::new();
        for place in outputs {
            if let Some(bit) = 1_u32.checked_shl(u32::from(place.point.index)) {
                *masks.entry(&place.module).or_default() |= bit;
            }
        }
        let frames = masks.into_iter().map(|(module, mask)| {
            let described = self.inner.described(module).ok();
            let module = described.and_then(|described| Module::new(described.setup).ok());
            module.map_or(0, |module| frames_of(&module, mask))
        });
        frames.sum()
    }

    fn may_switch(&self, place: &Place, on: bool, confirm: bool) -> Result<(), Failure> {
        let points = [place.point];
        self.inner.may_command(&place.module, &points, confirm)?;
        let rising = points.into_iter().filter(|_| on);
        self.inner.watched(&place.module, rising)
    }

    /// Asks the modules of outputs of which nothing is known now.
    async fn ask_unknown(&self, places: &[Place]) {
        let unknown = places
            .iter()
            .filter(|place| self.inner.known(place).is_none());
        let modules: BTreeSet<_> = unknown.map(|place| place.module.clone()).collect();
        for module in modules {
            // What could not be read stays unknown.
            let _ = self.inner.read_all(&module).await;
        }
    }

    /// What outputs are, read in their turn: what was known before may have been acknowledged and
    /// not read, or moved by hand since. Nobody waits for a module of which nothing is known.
    async fn read_in_turn(&self, places: &[Place]) -> States {
        let mut modules: BTreeMap<&str, bool> = BTreeMap::new();
        for place in places {
            *modules.entry(&place.module).or_insert(true) &= self.inner.known(place).is_some();
        }
        let known = modules.into_iter().filter(|(_, is_known)| *is_known);
        let reading = known.map(|(module, _)| {
            let (inner, module) = (Arc::clone(&self.inner), module.to_owned());
            tokio::spawn(async move { inner.read_all(&module).await.is_ok().then_some(module) })
        });
        let mut read = BTreeSet::new();
        for module in reading.collect::<Vec<_>>() {
            // Fails only where the runtime itself ends.
            read.extend(module.await.ok().flatten());
        }
        let of_read = places.iter().filter(|place| read.contains(&place.module));
        of_read
            .filter_map(|place| Some((place.clone(), self.inner.known(place)?)))
            .collect()
    }

    /// Switches them, in two turns where they exclude each other. After a failure in the first
    /// turn, the second is not begun where it is all or nothing.
    async fn switch_in_turn(
        &self,
        done: &mut BatchDone,
        items: &[Item],
        terms: BatchTerms,
        held: &Held,
    ) {
        if !self.exclude_each_other(items) {
            return self.switch_at_once(done, items, terms, held).await;
        }
        for wanted in [false, true] {
            let turn: Vec<Item> = items.iter().filter(|i| i.2 == wanted).cloned().collect();
            self.switch_at_once(done, &turn, terms, held).await;
            let failed = turn.iter().filter_map(|item| done.parts.get(item.0));
            if terms.all_or_nothing && failed.into_iter().any(|part| part.end.is_err()) {
                return;
            }
        }
    }

    fn exclude_each_other(&self, items: &[Item]) -> bool {
        let state = lock(&self.inner.state);
        let config = state.site.config();
        let excluded = items.iter().filter_map(|item| config.safety(&item.1));
        let mut excluded = excluded.flat_map(|safety| &safety.interlock);
        excluded.any(|other| items.iter().any(|item| item.1 == *other))
    }

    /// Switches the outputs of all modules side by side.
    async fn switch_at_once(
        &self,
        done: &mut BatchDone,
        items: &[Item],
        terms: BatchTerms,
        held: &Held,
    ) {
        let mut by_module: BTreeMap<String, Vec<Item>> = BTreeMap::new();
        for item in items {
            let of_module = by_module.entry(item.1.module.clone()).or_default();
            of_module.push(item.clone());
        }
        let each = by_module.into_iter().map(|(module, items)| {
            let service = self.clone();
            let numbers: Vec<usize> = items.iter().map(|item| item.0).collect();
            let held = held.clone();
            let switching =
                async move { service.switch_module(&module, &items, terms, &held).await };
            (numbers, tokio::spawn(switching))
        });
        for (numbers, task) in each.collect::<Vec<_>>() {
            // Fails only where the task was broken off: how far it had come is not known.
            let lost = || vec![Err(Fault::Unknown.into()); numbers.len()];
            let ends = task.await.unwrap_or_else(|_| lost());
            for (number, end) in numbers.into_iter().zip(ends) {
                if let Some(part) = done.parts.get_mut(number) {
                    part.end = end;
                }
            }
        }
    }

    /// Switches outputs of one module with one command. Where one of them must not be, the
    /// others still are, unless it is all or nothing.
    async fn switch_module(
        &self,
        module: &str,
        items: &[Item],
        terms: BatchTerms,
        held: &Held,
    ) -> Vec<Result<PartDone, Failure>> {
        let set: Vec<(Point, bool)> = items.iter().map(|(_, at, on)| (at.point, *on)).collect();
        let mut ends = self.switch_points(module, &set, terms, held).await;
        let one_must_not = matches!(
            ends.first(),
            Some(Err(Failure::Interlock { .. } | Failure::MinOff { .. }))
        );
        if one_must_not && !terms.all_or_nothing && set.len() > 1 {
            ends.clear();
            for one in set {
                ends.extend(self.switch_points(module, &[one], terms, held).await);
            }
        }
        if let Held::Each(turn) = held {
            turn.give_back(|place| items.iter().any(|item| item.1 == *place));
        }
        ends
    }

    /// With one command, in the turn that is held already or in one of its own.
    async fn switch_points(
        &self,
        module: &str,
        set: &[(Point, bool)],
        terms: BatchTerms,
        held: &Held,
    ) -> Vec<Result<PartDone, Failure>> {
        let terms = WriteTerms {
            verify: terms.verify,
            confirm: terms.confirm,
            ..WriteTerms::default()
        };
        // The site may have begun to end since: its own policies have the last word.
        let ends = self.inner.schedule.are_stopping();
        let expires = Instant::now() + TTL;
        let done = match held {
            _ if ends => Err(Fault::Closed.into()),
            Held::Not => self.write(module, set, terms).await,
            Held::Each(turn) => {
                let points: Vec<Point> = set.iter().map(|(point, _)| *point).collect();
                match self.write_in_turn(turn, module, set, terms, expires).await {
                    Ok(done) => self.inner.take_over(module, &points, done).await,
                    refused => refused,
                }
            }
            Held::All(turn) => self.write_in_turn(turn, module, set, terms, expires).await,
        };
        match done {
            Ok(done) => parts_of(&done).into_iter().map(Ok).collect(),
            Err(failure) => set.iter().map(|_| Err(failure.clone())).collect(),
        }
    }

    /// Takes back what was done, and what may have been.
    async fn undo(&self, done: &mut BatchDone, items: &[Item], before: &States, held: &Held) {
        let touched = |end: &Result<PartDone, Failure>| match end {
            Ok(_) => true,
            Err(failure) => failure.may_have_acted(),
        };
        let mut back = Vec::new();
        let mut lost = Vec::new();
        for (number, place, _) in items {
            let part = done.parts.get(*number);
            match (
                part.is_some_and(|part| touched(&part.end)),
                before.get(place),
            ) {
                (false, _) => {}
                // What gives pulses by itself can't be brought back into one: that begins another.
                (true, Some(true)) if self.gives_pulses(place).await => lost.push(*number),
                (true, Some(before)) => back.push((back.len(), place.clone(), *before, *number)),
                (true, None) => lost.push(*number),
            }
        }
        let parts = back.iter().map(|(_, place, wanted, _)| Part {
            place: place.clone(),
            wanted: *wanted,
            end: Err(Failure::NotTried),
        });
        let mut undone = BatchDone {
            parts: parts.collect(),
            undone: false,
        };
        let again: Vec<Item> = back.iter().map(|b| (b.0, b.1.clone(), b.2)).collect();
        let terms = BatchTerms::default();
        self.switch_in_turn(&mut undone, &again, terms, held).await;
        done.undone = lost.is_empty() && !undone.has_failed();
        let ends = undone.parts.iter().zip(&back);
        let failed = ends.map(|(part, back)| (back.3, part.end.is_err()));
        for (number, failed) in failed.chain(lost.iter().map(|number| (*number, true))) {
            if let Some(part) = done.parts.get_mut(number)
                && part.end.is_ok()
            {
                part.end = Err(if failed {
                    Failure::NotUndone
                } else {
                    Failure::Undone
                });
            }
        }
    }
}

/// Outputs with the end of each.
fn parts(
    set: &[(Place, bool)],
    end: impl Fn(&Place, bool) -> Result<PartDone, Failure>,
) -> Vec<Part> {
    let parts = set.iter().map(|(place, on)| Part {
        place: place.clone(),
        wanted: *on,
        end: end(place, *on),
    });
    parts.collect()
}

/// Each output that a command has switched.
pub(super) fn parts_of(done: &WriteDone) -> Vec<PartDone> {
    let each = done.outputs.iter().map(|(_, value, before)| PartDone {
        value: *value,
        before: *before,
        confirmed: done.confirmed,
        took: done.took,
        audit: done.audit.clone(),
    });
    each.collect()
}

fn frames_of(module: &Module, mask: u32) -> usize {
    let mut left = Bank::new(mask, mask);
    let mut frames = 0;
    while left.mask != 0 {
        let carried = module.group(left).mask & left.mask;
        if carried == 0 {
            break;
        }
        left = Bank::new(left.mask & !carried, left.on & !carried);
        frames += 1;
    }
    frames
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Config;
    use railbus_device::PointKind;

    #[tokio::test]
    async fn a_batch_goes_no_further_once_the_site_ends() {
        let text = "[line.main]\nport = \"/dev/railbus-test-nothing-here\"\n\
                    [module.oven]\nline = \"main\"\nmodel = \"erc8\"\naddress = 3\n";
        let service = Service::start(Config::parse(text).unwrap()).unwrap();
        service.inner.schedule.stop_all().await;
        let kind = PointKind::Output;
        let place = Place::new("oven", Point { kind, index: 0 });
        let mut done = BatchDone {
            parts: vec![Part {
                place: place.clone(),
                wanted: true,
                end: Err(Failure::NotTried),
            }],
            undone: false,
        };
        // It was checked before the end began.
        let items = [(0, place, true)];
        service
            .switch_in_turn(&mut done, &items, BatchTerms::default(), &Held::Not)
            .await;
        assert_eq!(done.parts[0].end, Err(Fault::Closed.into()));
        assert!(service.audit().is_empty(), "nothing was tried");
        service.close().await;
    }
}

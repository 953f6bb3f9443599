//! Outputs have one command at a time: who comes first goes first, from the questions that it
//! asks until what it took over is written down. So nothing overtakes a command between the
//! decision whose the output is and its frame, and of two commands the later one is the owner.
//!
//! A turn with several outputs comes with all of them at once: who waits has none. So the end of a
//! pulse waits for commands that have begun, and for nobody who waits himself for another output.

use super::{Inner, lock};
use crate::config::Place;
use railbus_host::Fault;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Mutex, MutexGuard};
use tokio::sync::oneshot;
use tokio::time::{Instant, timeout_at};

/// How many commands may wait for one output.
pub(super) const WAITING_MAX: usize = 64;

/// Whose turn it is, output by output.
#[derive(Debug, Default)]
pub(super) struct Turns(Arc<Mutex<Queue>>);

/// Who has a turn or waits for one, by the order in which they came.
#[derive(Debug, Default)]
struct Queue {
    newest: u64,
    each: BTreeMap<u64, Asked>,
}

/// A turn that was asked for.
#[derive(Debug)]
struct Asked {
    places: BTreeSet<Place>,
    /// It is for an end that was promised, which goes before commands that can't begin yet.
    is_end: bool,
    /// Told when the turn comes; none once it has come.
    waits: Option<oneshot::Sender<()>>,
}

/// A turn with outputs, or a place in the queue for one, until it is dropped.
#[derive(Debug)]
pub(super) struct Turn {
    queue: Arc<Mutex<Queue>>,
    number: u64,
}

impl Turn {
    /// Gives some of its outputs back before it ends.
    pub(super) fn give_back(&self, of: impl Fn(&Place) -> bool) {
        let mut queue = lock(&self.queue);
        if let Some(own) = queue.each.get_mut(&self.number) {
            own.places.retain(|place| !of(place));
        }
        queue.call();
    }
}

impl Drop for Turn {
    fn drop(&mut self) {
        let mut queue = lock(&self.queue);
        queue.each.remove(&self.number);
        queue.call();
    }
}

impl Queue {
    /// Calls everybody whose turn has come.
    fn call(&mut self) {
        let has = |asked: &&Asked| asked.waits.is_none();
        let had = self.each.values().filter(has);
        let mut taken: BTreeSet<Place> = had.flat_map(|asked| asked.places.clone()).collect();
        // Of those who came before and wait yet.
        let mut awaited: BTreeSet<Place> = BTreeSet::new();
        for asked in self.each.values_mut().filter(|asked| !has(&&**asked)) {
            let is_free = |place: &Place| {
                !taken.contains(place) && (asked.is_end || !awaited.contains(place))
            };
            let places = asked.places.iter().cloned();
            if !asked.places.iter().all(is_free) {
                awaited.extend(places);
                continue;
            }
            taken.extend(places);
            if let Some(waits) = asked.waits.take() {
                // Who does not wait any more drops the turn at once.
                let _ = waits.send(());
            }
        }
    }

    fn waiting_for(&self, place: &Place) -> usize {
        let each = self.each.values();
        let waiting = each.filter(|asked| asked.waits.is_some() && asked.places.contains(place));
        waiting.count()
    }
}

impl Turns {
    /// A place in the queue for an end, and what says when the turn has come.
    fn ask(&self, places: BTreeSet<Place>) -> (Turn, oneshot::Receiver<()>) {
        self.take(lock(&self.0), places, true)
    }

    /// The same for a command, of which only so many may wait.
    fn ask_of_many(&self, places: BTreeSet<Place>) -> Result<(Turn, oneshot::Receiver<()>), Fault> {
        let queue = lock(&self.0);
        let is_full = |place| queue.waiting_for(place) >= WAITING_MAX;
        match places.iter().any(is_full) {
            true => Err(Fault::Overloaded),
            false => Ok(self.take(queue, places, false)),
        }
    }

    fn take(
        &self,
        mut queue: MutexGuard<'_, Queue>,
        places: BTreeSet<Place>,
        is_end: bool,
    ) -> (Turn, oneshot::Receiver<()>) {
        let (tell, told) = oneshot::channel();
        queue.newest += 1;
        let number = queue.newest;
        let waits = Some(tell);
        let asked = Asked {
            places,
            is_end,
            waits,
        };
        queue.each.insert(number, asked);
        queue.call();
        let queue = Arc::clone(&self.0);
        (Turn { queue, number }, told)
    }
}

impl Inner {
    /// Waits for the turn with these outputs, at most until then.
    ///
    /// # Errors
    /// [`Fault::Overloaded`] where too many wait already; [`Fault::Expired`]. Nothing was sent.
    pub(super) async fn turn(
        &self,
        places: impl IntoIterator<Item = Place>,
        until: Instant,
    ) -> Result<Turn, Fault> {
        let places: BTreeSet<Place> = places.into_iter().collect();
        let (turn, comes) = self.turns.ask_of_many(places)?;
        match timeout_at(until, comes).await {
            Ok(Ok(())) => Ok(turn),
            _ => Err(Fault::Expired),
        }
    }

    /// Waits for the turn with these outputs however long that takes: for an end that was
    /// promised, or a policy.
    pub(super) async fn turn_to_end(&self, places: impl IntoIterator<Item = Place>) -> Turn {
        let (turn, comes) = self.turns.ask(places.into_iter().collect());
        // Nobody but this turn's own drop ends the wait before it comes.
        let _ = comes.await;
        turn
    }
}

#[cfg(test)]
mod tests {
    use super::super::Service;
    use super::super::command::TTL;
    use super::*;
    use crate::Config;
    use railbus_device::{Point, PointKind};
    use std::time::Duration;

    fn k(number: u8) -> Place {
        let kind = PointKind::Output;
        let index = number - 1;
        Place::new("oven", Point { kind, index })
    }

    /// A site whose port is not there.
    fn site() -> Service {
        let text = "[line.main]\nport = \"/dev/railbus-test-nothing-here\"\n\
                    [module.oven]\nline = \"main\"\nmodel = \"erc8\"\naddress = 3\n";
        Service::start(Config::parse(text).unwrap()).unwrap()
    }

    fn soon() -> Instant {
        Instant::now() + TTL
    }

    #[tokio::test(start_paused = true)]
    async fn an_end_waits_for_nobody_who_waits_himself() {
        let service = site();
        let inner = &service.inner;
        let busy = inner.turn([k(2)], soon()).await.unwrap();
        let waits = Arc::clone(inner);
        let both = tokio::spawn(async move { waits.turn([k(1), k(2)], soon()).await });
        tokio::task::yield_now().await;
        let asked = Instant::now();
        drop(inner.turn_to_end([k(1)]).await);
        assert_eq!(asked.elapsed(), Duration::ZERO, "nobody commands it");
        // Another command comes after the one that waits.
        let late = inner.turn([k(1)], Instant::now() + Duration::from_millis(1));
        assert_eq!(late.await.err(), Some(Fault::Expired));
        drop(busy);
        let both = both.await.unwrap().unwrap();
        let late = inner.turn([k(1)], Instant::now() + Duration::from_millis(1));
        assert_eq!(late.await.err(), Some(Fault::Expired));
        drop(both);
        inner.turn([k(1), k(2)], soon()).await.unwrap();
        service.close().await;
    }

    #[tokio::test(start_paused = true)]
    async fn who_comes_first_goes_first_and_an_end_keeps_its_place() {
        let service = site();
        let inner = &service.inner;
        let first = inner.turn([k(1)], soon()).await.unwrap();
        let order = Arc::new(Mutex::new(Vec::new()));
        let mut waiting = Vec::new();
        for number in 0..6 {
            let (inner, order) = (Arc::clone(inner), Arc::clone(&order));
            waiting.push(tokio::spawn(async move {
                let _turn = match number {
                    2 => inner.turn_to_end([k(1)]).await,
                    _ => inner.turn([k(1)], soon()).await.unwrap(),
                };
                lock(&order).push(number);
            }));
            tokio::task::yield_now().await;
        }
        // One that does not wait any more holds nobody up.
        waiting.remove(1).abort();
        drop(first);
        for one in waiting {
            one.await.unwrap();
        }
        assert_eq!(*lock(&order), [0, 2, 3, 4, 5]);
        service.close().await;
    }

    /// Asked on all processors at the same moment.
    #[test]
    fn never_more_may_wait_for_an_output() {
        for _ in 0..200 {
            let turns = Turns::default();
            let _first = turns.ask(BTreeSet::from([k(1)]));
            let ask = || {
                let asked = (0..40).map(|_| turns.ask_of_many(BTreeSet::from([k(1)])));
                asked.filter_map(Result::ok).collect::<Vec<_>>()
            };
            let waiting: usize = std::thread::scope(|scope| {
                let asked = [(); 4].map(|()| scope.spawn(ask));
                let asked = asked.map(|asked| asked.join().unwrap());
                asked.iter().map(Vec::len).sum()
            });
            assert_eq!(waiting, WAITING_MAX);
        }
    }

    #[tokio::test(start_paused = true)]
    async fn so_many_may_wait_for_an_output() {
        let service = site();
        let inner = &service.inner;
        let _first = inner.turn([k(1)], soon()).await.unwrap();
        let each = |_| {
            let inner = Arc::clone(inner);
            tokio::spawn(async move { inner.turn([k(1)], soon()).await.err() })
        };
        let waiting: Vec<_> = (0..=WAITING_MAX).map(each).collect();
        let mut ends = Vec::new();
        for one in waiting {
            ends.extend(one.await.unwrap());
        }
        let count = |fault| ends.iter().filter(|end| **end == fault).count();
        assert_eq!(count(Fault::Overloaded), 1);
        assert_eq!(count(Fault::Expired), WAITING_MAX);
        service.close().await;
    }
}

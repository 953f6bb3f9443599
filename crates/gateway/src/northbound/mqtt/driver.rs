//! Connects a [`Node`] to a broker and to the site, again and again.

use super::ends;
use super::kept::Kept;
use super::node::{Input, Node, Output, Reply, Setup};
use super::replay::{self, Packed};
use super::settings;
use super::told::OFFLINE;
use super::topics::Topics;
use super::turns::Turns;
use crate::northbound::broker::link::{self, Filter, Heard, Login, Receiver, Sender, Step};
use crate::northbound::broker::message::{Message, Verdict};
use crate::northbound::broker::session::{Tries, connected, pump};
use crate::northbound::broker::settings::Broker;
use crate::northbound::broker::{Alive, Dial, WINDOW, session};
use crate::northbound::outbox::{self, OutboxHandle, Reading};
use crate::northbound::outlet::Outlet;
use railbus_api::problem::{Problem, codes};
use railbus_site::{Events, Follower, News};
use railbus_store::outbox::Piece;
use serde_json::Value;
use std::collections::BTreeMap;
use std::pin::{Pin, pin};
use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;
use std::time::{Duration, SystemTime};
use tokio::sync::mpsc;
use tokio::task::JoinSet;
use tokio::time::Instant;

/// At the end, the broker has this time to take what is left.
const LINGER: Duration = Duration::from_millis(900);
/// The outbox has this time to write what waits.
const CLOSE_MAX: Duration = Duration::from_secs(3);

/// When it begins.
const ZERO: Duration = Duration::ZERO;

/// Why a connection has ended.
enum Ended {
    /// It is to stop.
    Stopped,
    Broken(Problem),
}

/// An outlet at work.
struct Driver {
    outlet: Outlet,
    topics: Topics,
    node: Node,
    site: Follower,
    events: Events,
    /// Commands under way.
    jobs: JoinSet<(Reply, Value)>,
    turns: Turns,
    kept: Kept,
    outbox: Option<OutboxHandle>,
    /// What is being read of it.
    reading: Option<Reading>,
    /// How large a message may be on the present connection.
    limit: Option<usize>,
    /// The outlet's own topics of what is with the broker, or on its way to it.
    flying: BTreeMap<u64, String>,
    began: Instant,
    /// The configuration has it no longer.
    is_gone: bool,
}

/// Publishes until it is to stop.
pub(super) async fn run(outlet: Outlet, events: Events) -> Result<(), Problem> {
    let mut kept = Kept::open(outlet.kept());
    let (topics, kinds) = {
        let keys = outlet.settings.borrow();
        (
            settings::topics(&keys, &outlet.site),
            settings::events(&keys),
        )
    };
    let (left, outboxes) = outlet.left_behind();
    outboxes.iter().for_each(|file| outbox::remove(file));
    // A disk that fails now fails again where it matters.
    let takes_over = kept.take_over(&left, |topic| topics.is_own(topic));
    if takes_over.unwrap_or(false) {
        // The outlet of the earlier name may still have to say that it is gone.
        tokio::select! {
            () = outlet.stopped() => return Ok(()),
            () = tokio::time::sleep(LINGER + LINGER / 4) => {}
        }
    }
    let days = outlet.number("replay_days");
    let has = topics.clone();
    let outbox = outbox::start(&outlet, days, move |module| has.has(module))?;
    let node = Node::new(Setup {
        site: outlet.site.to_string(),
        topics: topics.clone(),
        events: kinds,
        old: kept.topics().clone(),
        has_outbox: days > 0,
    });
    let mut driver = Driver {
        topics,
        node,
        site: outlet.service.follow(),
        events,
        jobs: JoinSet::new(),
        turns: Turns::default(),
        kept,
        outbox,
        reading: None,
        limit: None,
        flying: BTreeMap::new(),
        began: Instant::now(),
        is_gone: false,
        outlet,
    };
    driver.work().await;
    driver.end().await;
    Ok(())
}

impl Driver {
    async fn work(&mut self) {
        // Nothing is told before it is known.
        let Some(news) = self.site.next().await else {
            return;
        };
        self.node.handle(ZERO, Input::News(&news));
        self.drive(None);
        let stopped = self.outlet.stopped();
        let mut stopped = pin!(stopped);
        let mut tries = Tries::default();
        loop {
            let begun = Instant::now();
            let login = self.login();
            let connecting = pin!(connected(self.broker(), || login.clone()));
            let connection = tokio::select! {
                () = &mut stopped => return,
                end = self.meanwhile(connecting) => end,
            };
            let problem = match connection {
                None => return,
                Some(Err(problem)) => problem,
                Some(Ok((_, sender, receiver, limit))) => {
                    let end = self
                        .serve((sender, receiver, limit), stopped.as_mut())
                        .await;
                    self.node.handle(self.began.elapsed(), Input::Lost);
                    self.drive(None);
                    tries.connected_since(begun);
                    match end {
                        Ended::Stopped => return,
                        Ended::Broken(problem) => problem,
                    }
                }
            };
            let (tries, wait) = tries.failed();
            self.outlet.report.failed(problem, tries, Some(wait));
            let waiting = pin!(tokio::time::sleep(wait));
            let end = tokio::select! {
                () = &mut stopped => None,
                end = self.meanwhile(waiting) => end,
            };
            if end.is_none() {
                return;
            }
        }
    }

    /// The outbox is closed, and removed with its outlet.
    async fn end(self) {
        if let Some(outbox) = self.outbox {
            outbox.end(CLOSE_MAX).await;
        }
        if self.outlet.is_gone() {
            outbox::remove(&self.outlet.outbox_file());
        }
    }

    fn broker(&self) -> Broker {
        broker(&self.outlet)
    }

    fn login(&self) -> Login {
        let will = Message {
            topic: self.topics.bridge_state(),
            payload: OFFLINE.into(),
            is_retained: true,
            is_sure: true,
            correlation: None,
        };
        session::login(&self.outlet, &self.broker(), Some(will))
    }

    /// Keeps up with the site until something has ended; none if the site has gone.
    async fn meanwhile<T>(&mut self, mut what: impl Future<Output = T> + Unpin) -> Option<T> {
        loop {
            tokio::select! {
                biased;
                end = &mut what => return Some(end),
                is_there = self.follow() => if !is_there {
                    return None;
                },
            }
            self.drive(None);
        }
    }

    /// Takes what happens next at the site, or which command ends; false if the site has gone. Can
    /// be dropped.
    async fn follow(&mut self) -> bool {
        let input = tokio::select! {
            news = self.site.next() => match news {
                Some(news) => Happened::News(news),
                None => return false,
            },
            event = self.events.next() => match event {
                Some(Ok(event)) => Happened::Input(Input::Event(Box::new(event))),
                Some(Err(count)) => Happened::Input(Input::Missed(count)),
                None => return false,
            },
            Some(end) = self.jobs.join_next() => match end {
                Ok((reply, result)) => {
                    self.turns.ended(reply.id.as_deref());
                    Happened::Input(Input::Ended(reply, result))
                }
                // The command is on a task of its own: this one only waits for it.
                Err(_) => return true,
            },
            state = outbox::changed(self.outbox.as_mut()) => Happened::Input(Input::Stored(state)),
            read = outbox::read(&mut self.reading) => {
                let packed = read.and_then(|read| self.packed(read));
                Happened::Input(Input::Read(packed))
            }
        };
        let now = self.began.elapsed();
        match input {
            Happened::News(news) => self.node.handle(now, Input::News(&news)),
            Happened::Input(input) => {
                // What a command has done is told with its end, not after it.
                if matches!(input, Input::Ended(..)) {
                    while let Some(news) = self.site.next_now() {
                        self.node.handle(now, Input::News(&news));
                    }
                }
                self.node.handle(now, input);
            }
        }
        true
    }

    /// What was read of the outbox as a message.
    fn packed(&self, (epoch, piece): (Arc<str>, Piece)) -> Option<Packed> {
        let site = (&*self.outlet.site, self.topics.batch());
        replay::pack(site, (epoch, &piece), self.limit)
    }

    /// Does what is to be done. What is larger than the broker takes is left out.
    fn drive(&mut self, mut link: Option<(&mut Sender, Option<usize>)>) -> Option<Problem> {
        let now = self.began.elapsed();
        let mut broken = None;
        while let Some(output) = self.node.poll(now) {
            match output {
                // The other one keeps them from now on.
                Output::Keep(_) if self.is_taken_over() => {}
                Output::Keep(topics) => {
                    // It is written again with the next configuration; until then names that are
                    // given up may stay at the broker.
                    let _ = self.kept.keep(topics);
                }
                Output::Carry(job) => {
                    let service = self.outlet.service.clone();
                    let turn = self.turns.next(job.key.as_deref());
                    self.jobs.spawn(async move {
                        let done = ends::carry_out(service, job.order, job.key, job.within, turn);
                        let end = tokio::spawn(done).await;
                        let result = end.unwrap_or_else(|error| ends::broken(&error));
                        (job.reply, result)
                    });
                }
                Output::Online => self.outlet.report.worked(),
                Output::Read(after) => {
                    if let Some(outbox) = &self.outbox {
                        self.reading = Some(Box::pin(outbox.read(after, replay::READ_MAX)));
                    }
                }
                Output::Delivered(epoch, to) => {
                    if let Some(outbox) = &self.outbox {
                        outbox.delivered(&epoch, to);
                    }
                }
                Output::Subscribe(filters) => {
                    if let Some((sender, _)) = &mut link {
                        broken = broken.or(sender.subscribe(&unkept(filters)).err());
                    }
                }
                Output::Publish(number, message) => {
                    let is_long = |limit: usize| link::size(&message) > limit;
                    match &mut link {
                        Some((_, Some(limit))) if is_long(*limit) => {
                            self.node
                                .handle(now, Input::Taken(number, Verdict::Refused));
                        }
                        Some((sender, _)) => {
                            // Where a sender wants its answer is not for people here to mend.
                            if self.topics.is_own(&message.topic) {
                                self.flying.insert(number, message.topic.clone());
                            }
                            broken = broken.or(sender.publish(number, message).err());
                        }
                        None => {}
                    }
                }
            }
        }
        self.count();
        broken.map(|reason| Problem::new(codes::INTERNAL).with("reason", reason))
    }

    fn count(&mut self) {
        let counted = self.node.counted();
        let counts = self.outlet.report.counts();
        for (count, more) in [
            (&counts.sent, counted.sent),
            (&counts.refused, counted.refused),
            (&counts.dropped, counted.dropped),
        ] {
            if more > 0 {
                count.fetch_add(more, Relaxed);
            }
        }
        counts.queue.store(self.node.waiting(), Relaxed);
    }

    /// Uses a connection until it ends.
    async fn serve(
        &mut self,
        (mut sender, mut receiver, limit): (Sender, Receiver, Option<usize>),
        mut stopped: Pin<&mut impl Future<Output = ()>>,
    ) -> Ended {
        let (steps, mut heard) = mpsc::channel(WINDOW);
        // One future that is never dropped before its end: what is half sent is sent to its end.
        let dial = receiver.dial();
        let mut pump = pin!(pump(&mut receiver, steps));
        self.flying.clear();
        self.limit = limit;
        self.node.handle(self.began.elapsed(), Input::Connected);
        let clocks = || (Instant::now(), SystemTime::now());
        let (mut ends_by, mut is_refused) = (None, false);
        let mut alive = Alive::since(clocks());
        loop {
            if let Some(problem) = self.drive(Some((&mut sender, limit))) {
                return match ends_by {
                    Some(_) => Ended::Stopped,
                    None => Ended::Broken(problem),
                };
            }
            if self.node.is_done() {
                if self.is_gone {
                    self.forget();
                }
                drop(heard);
                sender.disconnect();
                let by = ends_by.unwrap_or_else(Instant::now);
                let _ = tokio::time::timeout_at(by, pump).await;
                return Ended::Stopped;
            }
            if ends_by.is_none() && self.node.is_stuck(self.began.elapsed()) {
                // Without a good-bye, so that the will of this client is published.
                return Ended::Broken(dial.refused(&"no acknowledgement within 10 s"));
            }
            let deadline = match ends_by {
                Some(by) => Some(by),
                None => self.node.deadline().map(|at| self.began + at),
            };
            let due = async {
                match deadline {
                    Some(at) => tokio::time::sleep_until(at).await,
                    None => std::future::pending().await,
                }
            };
            tokio::select! {
                Some(step) = heard.recv() => {
                    let is_late = alive.is_late(clocks());
                    let mut next = Some(step);
                    while let Some(step) = next {
                        let step = step.expired_if(is_late);
                        self.hear(&mut sender, step, &dial, &mut is_refused);
                        next = match is_late {
                            true => heard.try_recv().ok(),
                            false => None,
                        };
                    }
                    if is_late {
                        // It is to stop once only.
                        return match ends_by {
                            Some(_) => Ended::Stopped,
                            None => Ended::Broken(dial.refused(&"railbus stood still for 5 s")),
                        };
                    }
                }
                broken = &mut pump => {
                    let is_late = alive.is_late(clocks());
                    // The broker has delivered these, and does not again.
                    while let Ok(step) = heard.try_recv() {
                        let step = step.expired_if(is_late);
                        self.hear(&mut sender, step, &dial, &mut is_refused);
                    }
                    return match ends_by {
                        Some(_) => Ended::Stopped,
                        None => Ended::Broken(broken.problem),
                    };
                }
                () = &mut stopped, if ends_by.is_none() => {
                    ends_by = Some(Instant::now() + LINGER);
                    self.stop();
                }
                is_there = self.follow(), if ends_by.is_none() => if !is_there {
                    ends_by = Some(Instant::now() + LINGER);
                    self.node.handle(self.began.elapsed(), Input::Stop { is_gone: false });
                },
                () = due => if ends_by.is_some() {
                    return Ended::Stopped;
                },
            }
        }
    }

    /// Nothing is kept of what is not at the broker any more. What it refused to clear is cleared
    /// by the next outlet of this name.
    fn forget(&mut self) {
        let left = self.node.left();
        match left.is_empty() {
            true => self.kept.forget(),
            false => _ = self.kept.keep(left),
        }
    }

    /// Whether another outlet has its topics from now on: it was renamed.
    fn is_taken_over(&self) -> bool {
        let config = self.outlet.service.config();
        let settings = self.outlet.settings.borrow();
        let is_there = config.outlets.contains_key(&self.outlet.name);
        !is_there && settings::same(&settings, &config).next().is_some()
    }

    /// It is to end, maybe for good.
    fn stop(&mut self) {
        // What is at these topics is the other's if there is one. That one may not reach the
        // broker, so `bridge/state` does not stay as if it had.
        self.is_gone = self.outlet.is_gone() && !self.is_taken_over();
        let stop = Input::Stop {
            is_gone: self.is_gone,
        };
        self.node.handle(self.began.elapsed(), stop);
    }

    fn hear(&mut self, sender: &mut Sender, step: Step, dial: &Dial, is_refused: &mut bool) {
        let now = self.began.elapsed();
        let refused = match sender.heard(step) {
            None => None,
            Some(Heard::Message(message)) => {
                self.node.handle(now, Input::Received(message));
                None
            }
            Some(Heard::Taken(number, verdict)) => {
                self.node.handle(now, Input::Taken(number, verdict));
                let topic = self.flying.remove(&number);
                topic.filter(|_| verdict == Verdict::Refused)
            }
            // Every message that matters is acknowledged.
            Some(Heard::Subscribed | Heard::Arrived(_)) => None,
            Some(Heard::NotSubscribed) => Some(self.topics.commands().join(", ")),
        };
        // Once for each connection: it goes on with what is allowed.
        if let Some(topic) = refused
            && !std::mem::replace(is_refused, true)
        {
            self.outlet.report.failed(dial.forbidden(&topic), 1, None);
        }
    }
}

/// Commands that the broker kept are of another time.
fn unkept(topics: Vec<String>) -> Vec<Filter> {
    let filter = |topic| Filter {
        topic,
        with_kept: false,
    };
    topics.into_iter().map(filter).collect()
}

/// What happened at the site.
enum Happened {
    News(News),
    Input(Input<'static>),
}

fn broker(outlet: &Outlet) -> Broker {
    settings::broker(&outlet.settings.borrow(), &outlet.site, &outlet.name)
}

/// Connects once beside the run, and says what the broker is.
pub(super) async fn test(outlet: Outlet) -> Result<String, Problem> {
    let broker = broker(&outlet);
    session::test(outlet, broker).await
}

//! Connects a [`Node`] to a broker and to the site, again and again.

use super::kept::NodeFile;
use super::node::{Input, Job, JobEnd, Node, Now, Output, Setup, death};
use super::settings;
use super::topics::Topics;
use super::{KIND, backlog};
use crate::northbound::broker::link::{self, Heard, Login, Receiver, Sender, Step};
use crate::northbound::broker::session::{self, Tries, connected, pump};
use crate::northbound::broker::settings::Broker;
use crate::northbound::broker::{Alive, Dial, WINDOW};
use crate::northbound::command_end::CommandEnd;
use crate::northbound::outbox::{self, OutboxHandle, Reading};
use crate::northbound::outlet::{self, Outlet};
use railbus_api::problem::{Problem, codes};
use railbus_app::api::failures;
use railbus_site::{Follower, News, Service, WriteTerms};
use std::cell::RefCell;
use std::pin::{Pin, pin};
use std::rc::Rc;
use std::sync::atomic::Ordering::Relaxed;
use std::time::{Duration, SystemTime};
use tokio::sync::mpsc;
use tokio::task::JoinSet;
use tokio::time::Instant;

/// At the end, the broker has this time to take the death of the node.
const LINGER: Duration = Duration::from_millis(900);
/// The outbox has this time to write what waits.
const CLOSE_MAX: Duration = Duration::from_secs(3);

/// Why a connection has ended.
enum Ended {
    /// It is to stop.
    Stopped,
    /// The primary host is gone: it is waited for on another connection.
    HostGone,
    Broken(Problem),
}

/// An outlet at work.
struct Driver {
    outlet: Outlet,
    topics: Topics,
    node: Node,
    site: Follower,
    /// Commands under way.
    jobs: JoinSet<JobEnd>,
    file: Rc<RefCell<NodeFile>>,
    outbox: Option<OutboxHandle>,
    /// What is being read of it.
    reading: Option<Reading>,
    began: Instant,
    /// The broker lets no commands come on the present connection.
    is_forbidden: bool,
    /// How often what came was wrong.
    wrong: u32,
}

/// Publishes until it is to stop.
pub(super) async fn run(outlet: Outlet) -> Result<(), Problem> {
    let (topics, rights) = {
        let keys = outlet.settings.borrow();
        let topics = settings::topics(&keys, &outlet.site);
        (topics, outlet::rights(&keys))
    };
    // A number of an earlier name says nothing about this one.
    let (left, outboxes) = outlet.left_behind();
    outboxes.iter().for_each(|file| outbox::remove(file));
    for file in left {
        let _ = std::fs::remove_file(file);
    }
    let days = outlet.number("replay_days");
    let has = topics.clone();
    let outbox = outbox::start(&outlet, days, move |module| has.has(module))?;
    let file = NodeFile::open(outlet.kept());
    let node = Node::new(Setup {
        site: outlet.site.to_string(),
        topics: topics.clone(),
        rights,
        has_outbox: days > 0,
        lost: file.held(),
    });
    let mut driver = Driver {
        topics,
        node,
        site: outlet.service.follow(),
        jobs: JoinSet::new(),
        file: Rc::new(RefCell::new(file)),
        outbox,
        reading: None,
        began: Instant::now(),
        is_forbidden: false,
        wrong: 0,
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
        self.handle(Input::News(&news));
        self.drive(None);
        let stopped = self.outlet.stopped();
        let mut stopped = pin!(stopped);
        let mut tries = Tries::default();
        loop {
            let begun = Instant::now();
            let (broker, login) = self.login();
            let (topics, file) = (self.topics.clone(), Rc::clone(&self.file));
            let mut taken = None;
            let end = {
                let connecting = pin!(connected(broker, || {
                    // Each try has a will of its own: the broker may have the one before.
                    let bd_seq = file.borrow_mut().next();
                    taken = Some(bd_seq);
                    Login {
                        will: Some(death(&topics, bd_seq)),
                        ..login.clone()
                    }
                }));
                tokio::select! {
                    () = &mut stopped => return,
                    end = self.meanwhile(connecting) => end,
                }
            };
            let problem = match end {
                None => return,
                Some(Err(problem)) => {
                    // Where TLS failed, a CONNECT may have gone out.
                    if taken.is_some() && problem.code == codes::BROKER_UNREACHED.code {
                        self.file.borrow_mut().unused();
                    }
                    problem
                }
                Some(Ok((_, sender, receiver, limit))) => {
                    self.handle(Input::Connected(taken.unwrap_or_default()));
                    let connection = (sender, receiver, limit);
                    let end = self.serve(connection, stopped.as_mut()).await;
                    self.handle(Input::Lost);
                    self.drive(None);
                    tries.connected_since(begun);
                    match end {
                        Ended::Stopped => return,
                        Ended::HostGone => continue,
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

    /// The outbox is closed, and removed with its outlet.
    async fn end(self) {
        if let Some(outbox) = self.outbox {
            outbox.end(CLOSE_MAX).await;
        }
        let config = self.outlet.service.config();
        let now = config.outlets.get(&self.outlet.name);
        if now.is_none_or(|now| now.kind != KIND.name) {
            outbox::remove(&self.outlet.outbox_file());
            self.file.borrow().forget();
        }
    }

    /// Which broker, and as whom.
    fn login(&self) -> (Broker, Login) {
        let outlet = &self.outlet;
        let broker = settings::broker(&outlet.settings.borrow(), &outlet.site, &outlet.name);
        let login = session::login(outlet, &broker, None);
        (broker, login)
    }

    fn now(&self) -> Now {
        now(self.began)
    }

    fn handle(&mut self, input: Input<'_>) {
        let now = self.now();
        self.node.handle(now, input);
    }

    /// Takes what happens next at the site, or which command ends; false if the site has gone. Can
    /// be dropped.
    async fn follow(&mut self) -> bool {
        let happened = tokio::select! {
            news = self.site.next() => match news {
                Some(news) => Happened::News(news),
                None => return false,
            },
            Some(end) = self.jobs.join_next() => match end {
                Ok(end) => Happened::Input(Input::Ended(end)),
                // The command is on a task of its own: this one only waits for it.
                Err(_) => return true,
            },
            state = outbox::changed(self.outbox.as_mut()) => Happened::Input(Input::Stored(state)),
            read = outbox::read(&mut self.reading) => Happened::Input(Input::Read(read)),
        };
        match happened {
            Happened::News(news) => self.handle(Input::News(&news)),
            Happened::Input(input) => {
                // What a command has done is told with its end, not after it.
                if matches!(input, Input::Ended(..)) {
                    while let Some(news) = self.site.next_now() {
                        self.handle(Input::News(&news));
                    }
                }
                self.handle(input);
            }
        }
        true
    }

    /// Does what is to be done. What is larger than the broker takes is left out.
    fn drive(&mut self, mut link: Option<(&mut Sender, Option<usize>)>) -> Option<Problem> {
        let now = self.now();
        let mut broken = None;
        while let Some(output) = self.node.poll(now) {
            match output {
                Output::Carry(job) => {
                    let service = self.outlet.service.clone();
                    self.jobs.spawn(carry_out(service, job));
                }
                // That of forbidden commands stays the last word.
                Output::Online if self.is_forbidden => {}
                Output::Online => self.outlet.report.worked(),
                Output::Hold(held) => self.file.borrow_mut().hold(held),
                Output::HostAway => {
                    let host = self.topics.host.clone().unwrap_or_default();
                    let problem = Problem::new(codes::HOST_AWAY).with("reason", host);
                    self.outlet.report.failed(problem, 1, None);
                }
                Output::Wrong(reason) => {
                    self.wrong = self.wrong.saturating_add(1);
                    let problem = Problem::new(codes::BAD_REQUEST).with("reason", reason);
                    self.outlet.report.noted(problem, self.wrong);
                }
                Output::Read(after) => {
                    if let Some(outbox) = &self.outbox {
                        self.reading = Some(Box::pin(outbox.read(after, backlog::READ_MAX)));
                    }
                }
                Output::Delivered(epoch, to) => {
                    // Else it would be nowhere. The next one comes with it.
                    let is_written = self.file.borrow_mut().is_written();
                    if let Some(outbox) = self.outbox.as_ref().filter(|_| is_written) {
                        outbox.delivered(&epoch, to);
                    }
                }
                Output::Subscribe(filters) => {
                    if let Some((sender, _)) = &mut link {
                        broken = broken.or(sender.subscribe(&filters).err());
                    }
                }
                Output::Ask => {
                    if let Some((sender, _)) = &mut link {
                        broken = broken.or(sender.ask().err());
                    }
                }
                Output::Publish(number, message) => {
                    let Some((sender, limit)) = &mut link else {
                        continue;
                    };
                    if let Some(most) = limit.filter(|limit| link::size(&message) > *limit) {
                        // Its sequence number is given, so that the rest can't be told either.
                        let (broker, _) = self.login();
                        let reason = format!("{} has more than {most} bytes", message.topic);
                        let problem = Problem::new(codes::BROKER_REFUSED)
                            .with("broker", format!("{}:{}", broker.host, broker.port))
                            .with("reason", reason);
                        return Some(problem);
                    }
                    broken = broken.or(sender.publish(number, message).err());
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
        let clocks = || (Instant::now(), SystemTime::now());
        let mut ends_by = None;
        self.is_forbidden = false;
        let mut alive = Alive::since(clocks());
        loop {
            if let Some(problem) = self.drive(Some((&mut sender, limit))) {
                return match ends_by {
                    Some(_) => Ended::Stopped,
                    None => Ended::Broken(problem),
                };
            }
            if self.node.is_dead() {
                drop(heard);
                sender.disconnect_with_will();
                let by = ends_by.unwrap_or_else(|| Instant::now() + LINGER);
                let _ = tokio::time::timeout_at(by, pump).await;
                return match ends_by {
                    Some(_) => Ended::Stopped,
                    None => Ended::HostGone,
                };
            }
            if ends_by.is_none() && self.node.is_stuck(self.now()) {
                return Ended::Broken(dial.refused(&"no answer within 10 s"));
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
                    if alive.is_late(clocks()) {
                        // What has waited was meant for a moment that is over; hosts ask anew.
                        return match ends_by {
                            Some(_) => Ended::Stopped,
                            None => Ended::Broken(dial.refused(&"railbus stood still for 5 s")),
                        };
                    }
                    self.hear(&mut sender, step, &dial);
                }
                broken = &mut pump => {
                    // What the broker said last, such as that it has everything.
                    while let Ok(step) = heard.try_recv() {
                        self.hear(&mut sender, step, &dial);
                    }
                    return match ends_by {
                        Some(_) => Ended::Stopped,
                        None => Ended::Broken(broken.problem),
                    };
                }
                () = &mut stopped, if ends_by.is_none() => {
                    ends_by = Some(Instant::now() + LINGER);
                    self.handle(Input::Stop);
                }
                is_there = self.follow(), if ends_by.is_none() => if !is_there {
                    ends_by = Some(Instant::now() + LINGER);
                    self.handle(Input::Stop);
                },
                () = due => if ends_by.is_some() {
                    return Ended::Stopped;
                },
            }
        }
    }

    fn hear(&mut self, sender: &mut Sender, step: Step, dial: &Dial) {
        match sender.heard(step) {
            None => {}
            Some(Heard::Message(message)) => self.handle(Input::Received(message)),
            Some(Heard::Taken(number, _)) => self.handle(Input::Went(number)),
            Some(Heard::Arrived(number)) => self.handle(Input::Arrived(number)),
            Some(Heard::Subscribed) => self.handle(Input::Subscribed),
            // Once for each connection: it goes on with what is allowed.
            Some(Heard::NotSubscribed) => {
                if !std::mem::replace(&mut self.is_forbidden, true) {
                    let filters = self.topics.filters().into_iter();
                    let topics: Vec<String> = filters.map(|filter| filter.topic).collect();
                    let problem = dial.forbidden(&topics.join(", "));
                    self.outlet.report.failed(problem, 1, None);
                }
                self.handle(Input::Subscribed);
            }
        }
    }
}

/// The time now, for a node that began then.
fn now(began: Instant) -> Now {
    Now {
        steady: began.elapsed(),
        wall: super::device::wall(SystemTime::now()),
    }
}

/// What happened at the site.
enum Happened {
    News(News),
    Input(Input<'static>),
}

/// Carries a command out, on a task of its own.
async fn carry_out(service: Service, job: Job) -> JobEnd {
    let of = |end: CommandEnd, code: String| JobEnd {
        device: job.device.clone(),
        label: job.label.clone(),
        end: end.name(),
        code,
    };
    let (device, label) = (job.device.clone(), job.label.clone());
    let done = tokio::spawn(async move {
        let terms = WriteTerms {
            within: job.within,
            ..WriteTerms::default()
        };
        let done = service
            .write_labelled((&device, &label), job.on, terms)
            .await;
        done.map_err(|failure| {
            let problem = failures::problem(&service, &device, None, &failure);
            (CommandEnd::of(&failure), problem.code)
        })
    });
    match done.await {
        Ok(Ok(done)) => of(CommandEnd::confirmed(done.confirmed), String::new()),
        Ok(Err((end, code))) => of(end, code),
        Err(_) => of(CommandEnd::Unknown, codes::INTERNAL.code.to_owned()),
    }
}

/// Connects once beside the run, and says what the broker is.
pub(super) async fn test(outlet: Outlet) -> Result<String, Problem> {
    let broker = settings::broker(&outlet.settings.borrow(), &outlet.site, &outlet.name);
    session::test(outlet, broker).await
}

#[cfg(test)]
mod tests;

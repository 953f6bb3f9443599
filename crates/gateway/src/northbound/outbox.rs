//! The outbox of an outlet: every change of its points, on the disk until the other side has it.
//!
//! It has a thread of its own that follows the site: neither a slow disk nor a slow receiver holds
//! up the outlet, a command, or another outlet. What is written and when is decided by
//! [`Recording`], which has no disk and no clock.

mod recording;

use super::outlet::{Outlet, Report};
use railbus_api::problem::{Problem, codes};
use railbus_site::{Follower, News};
use railbus_store::history::millis;
use railbus_store::outbox::{Outbox, OutboxEntry, OutboxError, OutboxKeep, Piece};
use recording::Recording;
use std::path::{Path, PathBuf};
use std::pin::Pin;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, SystemTime};
use tokio::runtime::Builder;
use tokio::sync::{mpsc, oneshot, watch};
use tokio::time::Instant;

/// How long a change waits before it is written, at most, together with others. What is delivered
/// waits as long before it is deleted.
const FLUSH: Duration = Duration::from_secs(1);
/// How often the limits are enforced, and it is written down that all is well.
const TIDY: Duration = Duration::from_secs(60);
/// The same if there is more to drop.
const TIDY_MORE: Duration = Duration::from_secs(2);
/// The most that an outbox takes on the disk.
const BYTES_MAX: u64 = 512 << 20;
/// A change that is not here after this time has been missed, which is told: longer than the stream
/// of the site keeps any.
const ON_ITS_WAY_MAX: Duration = Duration::from_secs(15);
/// After the disk failed, so long until the next try.
const AGAIN: Duration = Duration::from_secs(5);
/// A disk that takes so long for anything hangs.
const STUCK: Duration = Duration::from_secs(5);
/// A day, in milliseconds.
const DAY_MS: i64 = 86_400_000;

/// What the outlet is told.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct OutboxState {
    /// Whose numbers these are; empty until it is open.
    pub(super) epoch: Arc<str>,
    /// The number of the newest entry on the disk.
    pub(super) newest: u64,
    /// The newest one when it was opened.
    pub(super) before: u64,
    /// Up to which number the receiver had everything when it was opened.
    pub(super) delivered: u64,
    /// Changes can't be written since then.
    pub(super) is_failing: bool,
}

/// What an outbox is for.
pub(super) struct OutboxSetup {
    pub(super) file: PathBuf,
    /// How many days a change is kept for the receiver.
    pub(super) days: i64,
    /// Also one that it has, since it may ask for it again.
    pub(super) is_for_again: bool,
    /// Whether the outlet tells of a module.
    pub(super) has: Box<dyn Fn(&str) -> bool + Send>,
    pub(super) site: Follower,
    pub(super) report: Report,
}

/// The outlet's end of its outbox. When it is dropped, the thread writes what waits and ends.
#[derive(Debug)]
pub(super) struct OutboxHandle {
    orders: mpsc::Sender<OutboxOrder>,
    delivered: watch::Sender<(Arc<str>, u64)>,
    state: watch::Receiver<OutboxState>,
    busy: Busy,
    ended: Option<oneshot::Receiver<()>>,
}

/// How every point is after the entry with this number, and whose number that is.
pub(super) type StateAt = (Arc<str>, u64, Vec<OutboxEntry>);

#[derive(Debug)]
enum OutboxOrder {
    Read {
        after: u64,
        count: usize,
        reply: oneshot::Sender<Option<(Arc<str>, Piece)>>,
    },
    ReadAgain {
        span: (u64, u64),
        count: usize,
        reply: oneshot::Sender<Option<(Arc<str>, Piece)>>,
    },
    State(oneshot::Sender<Option<StateAt>>),
}

impl OutboxHandle {
    /// Starts the thread of an outbox.
    ///
    /// # Errors
    /// The system's error if there can be no other thread.
    pub(super) fn start(setup: OutboxSetup) -> std::io::Result<OutboxHandle> {
        let (sender, orders) = mpsc::channel(1);
        let (delivered, to_delete) = watch::channel((Arc::default(), 0));
        let (told, state) = watch::channel(OutboxState::default());
        let (end, ended) = oneshot::channel();
        let busy = Busy::default();
        let its = busy.clone();
        let runtime = Builder::new_current_thread().enable_time().build()?;
        let thread = std::thread::Builder::new().name("outbox".to_owned());
        thread.spawn(move || {
            let keeper = Keeper {
                outbox: None,
                recording: Recording::new(setup.has),
                file: setup.file,
                keep: OutboxKeep {
                    age_ms: setup.days.saturating_mul(DAY_MS),
                    bytes: BYTES_MAX,
                    is_for_again: setup.is_for_again,
                },
                told,
                report: setup.report,
                busy: its,
                failures: 0,
                told_dropped: 0,
            };
            runtime.block_on(keeper.run(setup.site, orders, to_delete));
            // Nobody waits where the outlet has ended.
            let _ = end.send(());
        })?;
        Ok(OutboxHandle {
            orders: sender,
            delivered,
            state,
            busy,
            ended: Some(ended),
        })
    }

    /// Waits until there is something new. Can be dropped.
    pub(super) async fn changed(&mut self) -> OutboxState {
        match self.news().await {
            Some(state) => state,
            None => std::future::pending().await,
        }
    }

    /// The same; none once the site has gone, or the thread has broken down.
    pub(super) async fn news(&mut self) -> Option<OutboxState> {
        self.state.changed().await.ok()?;
        Some(self.state.borrow_and_update().clone())
    }

    /// Whether the disk has hung for so long that what is recorded may lack what happened.
    #[cfg_attr(
        not(feature = "fleet"),
        expect(dead_code, reason = "the other kinds say nothing of it")
    )]
    pub(super) fn is_stuck(&self) -> bool {
        let since = *self.busy.since();
        since.is_some_and(|since| since.elapsed() >= STUCK)
    }

    /// Reads the oldest entries after this number, so many at most, and whose numbers they are;
    /// none if there are none, or they can't be read now.
    pub(super) fn read(
        &self,
        after: u64,
        count: usize,
    ) -> impl Future<Output = Option<(Arc<str>, Piece)>> + Send + use<> {
        // One that nobody waits for does not keep the thread from ending.
        let orders = self.orders.downgrade();
        async move {
            let (reply, piece) = oneshot::channel();
            let order = OutboxOrder::Read {
                after,
                count,
                reply,
            };
            orders.upgrade()?.send(order).await.ok()?;
            piece.await.ok().flatten()
        }
    }

    /// Reads the oldest entries of these numbers, so many at most, also of those that are
    /// delivered, and whose numbers they are; a piece without entries if there are none, and none
    /// if they can't be read now.
    #[cfg_attr(
        not(feature = "fleet"),
        expect(dead_code, reason = "nobody else asks for what he has")
    )]
    pub(super) fn read_again(
        &self,
        span: (u64, u64),
        count: usize,
    ) -> impl Future<Output = Option<(Arc<str>, Piece)>> + Send + use<> {
        let orders = self.orders.downgrade();
        async move {
            let (reply, piece) = oneshot::channel();
            let order = OutboxOrder::ReadAgain { span, count, reply };
            orders.upgrade()?.send(order).await.ok()?;
            piece.await.ok().flatten()
        }
    }

    /// How every point is after the newest entry; none if that can't be said now.
    #[cfg_attr(
        not(feature = "fleet"),
        expect(dead_code, reason = "the other kinds follow the site themselves")
    )]
    pub(super) fn state(&self) -> impl Future<Output = Option<StateAt>> + Send + use<> {
        let orders = self.orders.downgrade();
        async move {
            let (reply, state) = oneshot::channel();
            orders
                .upgrade()?
                .send(OutboxOrder::State(reply))
                .await
                .ok()?;
            state.await.ok().flatten()
        }
    }

    /// The receiver has everything up to this number of this epoch.
    pub(super) fn delivered(&self, epoch: &Arc<str>, newest: u64) {
        let _ = self.delivered.send((Arc::clone(epoch), newest));
    }

    /// Waits until all is written and the file is closed, but not longer than this.
    pub(super) async fn end(mut self, patience: Duration) {
        let ended = self.ended.take();
        drop(self);
        if let Some(ended) = ended {
            let _ = tokio::time::timeout(patience, ended).await;
        }
    }
}

/// A piece of the outbox that is being read, and whose numbers it has.
pub(super) type Reading = Pin<Box<dyn Future<Output = Option<(Arc<str>, Piece)>>>>;

/// The outbox of an outlet that keeps changes of these modules for so many days until they are
/// delivered; none if it keeps none, and then nothing is left of an earlier one.
///
/// # Errors
/// There can be no other thread.
pub(super) fn start(
    outlet: &Outlet,
    days: i64,
    has: impl Fn(&str) -> bool + Send + 'static,
) -> Result<Option<OutboxHandle>, Problem> {
    if days == 0 {
        remove(&outlet.outbox_file());
        return Ok(None);
    }
    let setup = OutboxSetup {
        file: outlet.outbox_file(),
        days,
        is_for_again: false,
        has: Box::new(has),
        site: outlet.service.follow(),
        report: outlet.report.clone(),
    };
    started(setup).map(Some)
}

/// The outbox of an outlet whose receiver may ask again for any change of so many days.
///
/// # Errors
/// There can be no other thread.
#[cfg(feature = "fleet")]
pub(super) fn start_for_again(outlet: &Outlet, days: i64) -> Result<OutboxHandle, Problem> {
    started(OutboxSetup {
        file: outlet.outbox_file(),
        days,
        is_for_again: true,
        has: Box::new(|_| true),
        site: outlet.service.follow(),
        report: outlet.report.clone(),
    })
}

fn started(setup: OutboxSetup) -> Result<OutboxHandle, Problem> {
    let broken =
        |error: std::io::Error| Problem::new(codes::INTERNAL).with("reason", error.to_string());
    OutboxHandle::start(setup).map_err(broken)
}

/// How the outbox is, once something is new. Can be dropped.
pub(super) async fn changed(outbox: Option<&mut OutboxHandle>) -> OutboxState {
    match outbox {
        Some(outbox) => outbox.changed().await,
        None => std::future::pending().await,
    }
}

/// What was read of it, once that is done. Can be dropped.
pub(super) async fn read(reading: &mut Option<Reading>) -> Option<(Arc<str>, Piece)> {
    let Some(under_way) = reading else {
        return std::future::pending().await;
    };
    let read = under_way.await;
    *reading = None;
    read
}

/// Removes what an outbox has kept.
pub(super) fn remove(file: &Path) {
    Outbox::remove(file);
}

/// The thread: the owner of the file.
struct Keeper {
    /// None until it could be opened.
    outbox: Option<Outbox>,
    recording: Recording,
    file: PathBuf,
    keep: OutboxKeep,
    told: watch::Sender<OutboxState>,
    report: Report,
    busy: Busy,
    /// How often in a row the disk failed.
    failures: u32,
    /// The first entry after those that were dropped, when all was told because of them.
    told_dropped: u64,
}

impl Keeper {
    async fn run(
        mut self,
        mut site: Follower,
        mut orders: mpsc::Receiver<OutboxOrder>,
        mut to_delete: watch::Receiver<(Arc<str>, u64)>,
    ) {
        let (mut write_at, mut delete_at) = (None, None);
        let mut tidy_at = Instant::now();
        loop {
            // What failed is tried again, also where nothing is new: others rely on it.
            if self.recording.is_waiting() || self.outbox.is_none() || self.failures > 0 {
                let wait = if self.failures > 0 { AGAIN } else { FLUSH };
                write_at.get_or_insert_with(|| Instant::now() + wait);
            }
            self.busy.end();
            let due = [write_at, delete_at].into_iter().flatten();
            let due = due.chain([tidy_at]).min().unwrap_or(tidy_at);
            tokio::select! {
                news = site.next() => match news {
                    Some(news) => self.take(&news, site.missed()),
                    None => break,
                },
                order = orders.recv() => {
                    self.busy.begin();
                    match order {
                    Some(OutboxOrder::Read { after, count, reply }) => {
                        // Fails where the outlet waits no longer.
                        let _ = reply.send(self.read(after, count));
                    }
                    Some(OutboxOrder::ReadAgain { span, count, reply }) => {
                        let _ = reply.send(self.read_again(span, count));
                    }
                    Some(OutboxOrder::State(reply)) => {
                        let _ = reply.send(self.state());
                    }
                    // The outlet ends.
                    None => break,
                    }
                }
                Ok(()) = to_delete.changed() => {
                    delete_at.get_or_insert(Instant::now() + FLUSH);
                }
                () = tokio::time::sleep_until(due) => {}
            }
            self.busy.begin();
            let now = Instant::now();
            let is_full = self.recording.is_full() && self.failures == 0;
            if is_full || write_at.is_some_and(|at| at <= now) {
                write_at = None;
                self.write();
            }
            if delete_at.is_some_and(|at| at <= now) {
                delete_at = None;
                let delivered = to_delete.borrow().clone();
                self.delete(&delivered);
            }
            if tidy_at <= now {
                let is_more = self.tidy();
                tidy_at = Instant::now() + if is_more { TIDY_MORE } else { TIDY };
            }
        }
        // What the site told before it ended, or before the outlet did.
        while let Some(news) = site.next_now() {
            self.take(&news, site.missed());
        }
        self.write();
        let delivered = to_delete.borrow().clone();
        self.delete(&delivered);
        self.mark(Duration::ZERO);
    }

    fn take(&mut self, news: &News, missed: u64) {
        match news {
            News::Picture(picture) => self.recording.picture(picture, missed),
            News::Batch(batch) => self.recording.batch(batch),
        }
    }

    /// Writes what waits. What the disk does not take is tried again; what is too much by then is
    /// a gap, and after it everything is told anew. Whether all is written.
    fn write(&mut self) -> bool {
        match self.try_write() {
            Ok(()) => {
                self.failures = 0;
                true
            }
            Err(why) => {
                self.can_not_write(why);
                false
            }
        }
    }

    fn try_write(&mut self) -> Result<(), OutboxError> {
        let outbox = match &mut self.outbox {
            Some(outbox) => outbox,
            empty => {
                let outbox = Outbox::open(&self.file)?;
                self.recording.opened(outbox.known_until()?);
                empty.insert(outbox)
            }
        };
        let before = match *self.told.borrow().epoch == *outbox.epoch() {
            true => self.told.borrow().before,
            false => outbox.newest()?,
        };
        let waiting = self.recording.waiting(SystemTime::now());
        let newest = match waiting.is_empty() {
            true => {
                if self.failures > 0
                    && let Some(at) = SystemTime::now().checked_sub(ON_ITS_WAY_MAX)
                {
                    // Whether it takes anything again.
                    outbox.known(millis(at))?;
                }
                outbox.newest()?
            }
            false => outbox.append(waiting)?,
        };
        self.recording.written();
        let delivered = match *self.told.borrow().epoch == *outbox.epoch() {
            true => self.told.borrow().delivered,
            false => outbox.taken()?,
        };
        let now = OutboxState {
            epoch: Arc::from(outbox.epoch()),
            newest,
            before,
            delivered,
            is_failing: false,
        };
        self.told.send_if_modified(|told| {
            let is_new = *told != now;
            *told = now;
            is_new
        });
        Ok(())
    }

    /// What is told so far is written first, so that it has a number.
    fn state(&mut self) -> Option<StateAt> {
        let is_written = self.write();
        let told = self.told.borrow();
        let is_known = self.recording.is_known() && !self.recording.is_waiting();
        (is_written && is_known)
            .then(|| (Arc::clone(&told.epoch), told.newest, self.recording.now()))
    }

    fn read_again(&mut self, span: (u64, u64), count: usize) -> Option<(Arc<str>, Piece)> {
        let outbox = self.outbox.as_ref()?;
        match outbox.read_again(span, count) {
            Ok(piece) => Some((Arc::from(outbox.epoch()), piece.unwrap_or_default())),
            Err(why) => {
                self.failed(why);
                None
            }
        }
    }

    fn read(&mut self, after: u64, count: usize) -> Option<(Arc<str>, Piece)> {
        let read = self.outbox.as_ref().map(|outbox| {
            let piece = outbox.read(after, count)?;
            Ok(piece.map(|piece| (Arc::from(outbox.epoch()), piece)))
        });
        match read.transpose() {
            Ok(piece) => {
                let piece = piece.flatten();
                if let Some((_, piece)) = &piece {
                    self.tell_dropped(piece);
                }
                piece
            }
            Err(why) => {
                // A broken page may stand before everything that is still to be read.
                self.failed(why);
                None
            }
        }
    }

    /// Where entries were dropped before these, the last one of a point may be among them: every
    /// point is told once more, after all that waits.
    fn tell_dropped(&mut self, piece: &Piece) {
        if piece.missing.is_some() && self.told_dropped != piece.first {
            self.told_dropped = piece.first;
            self.recording.tell_all();
        }
    }

    fn delete(&mut self, (epoch, newest): &(Arc<str>, u64)) {
        let Some(outbox) = &mut self.outbox else {
            return;
        };
        // Numbers of another epoch are those of other entries.
        if **epoch == *outbox.epoch()
            && let Err(why) = outbox.delivered(*newest, self.keep.is_for_again)
        {
            self.can_not_write(why);
        }
    }

    /// Writes down that all is known until now, and drops what is too old or too much. Whether
    /// there is more to drop.
    fn tidy(&mut self) -> bool {
        self.mark(ON_ITS_WAY_MAX);
        let Some(outbox) = &mut self.outbox else {
            return false;
        };
        let pruned = outbox.prune(self.keep, millis(SystemTime::now()));
        // A problem of the disk shows at the next write, too.
        let _ = outbox.tidy();
        let is_more = match &pruned {
            Ok((dropped, is_more)) => {
                if *dropped > 0 {
                    self.report.counts().dropped.fetch_add(*dropped, Relaxed);
                    let problem = Problem::new(codes::OUTBOX_DROPPED);
                    let problem = problem
                        .with("count", *dropped)
                        .with("days", self.keep.age_ms / DAY_MS);
                    self.report.noted(problem, 1);
                }
                *is_more
            }
            Err(_) => false,
        };
        if let Err(why) = pruned {
            self.can_not_write(why);
        }
        is_more
    }

    /// Writes down that every change until so long ago is on the disk.
    fn mark(&mut self, ago: Duration) {
        if self.recording.is_waiting() {
            return;
        }
        if let Some(outbox) = &mut self.outbox {
            let at = SystemTime::now().checked_sub(ago);
            let end = at.map_or(Ok(()), |at| outbox.known(millis(at)));
            if let Err(why) = end {
                self.can_not_write(why);
            }
        }
    }

    /// Changes can't be written. Only a write that works says otherwise.
    fn can_not_write(&mut self, why: OutboxError) {
        self.told
            .send_if_modified(|told| !std::mem::replace(&mut told.is_failing, true));
        self.failed(why);
    }

    /// Something could not be done with the file.
    fn failed(&mut self, why: OutboxError) {
        self.failures = self.failures.saturating_add(1);
        if why.is_broken {
            // The next write begins another one.
            self.outbox = None;
            // Tried again with the next failure.
            let _ = Outbox::put_aside(&self.file);
        }
        let problem = Problem::new(codes::OUTBOX_FAILS);
        let problem = problem
            .with("path", self.file.display().to_string())
            .with("reason", why.reason);
        self.report.noted(problem, self.failures);
    }
}

/// Since when the thread is busy with the disk: one that hangs says nothing.
#[derive(Clone, Debug, Default)]
struct Busy(Arc<Mutex<Option<Instant>>>);

impl Busy {
    fn begin(&self) {
        self.since().get_or_insert_with(Instant::now);
    }

    fn end(&self) {
        *self.since() = None;
    }

    fn since(&self) -> MutexGuard<'_, Option<Instant>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests;

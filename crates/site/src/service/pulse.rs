//! Pulses: by the module where it keeps the time, else timed here, and then released whatever
//! becomes of the caller.

use super::command::channel;
use super::{Inner, Service, lock};
use crate::audit::Note;
use crate::{Failure, Origin, Pulses, WriteDone};
use railbus_device::{Bank, Family, Op, Point, Seen};
use railbus_host::Confirmed;
use railbus_wire::{Micros, r55::U24};
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};
use std::time::Duration;
use tokio::sync::{oneshot, watch};

/// The longest pulse: 24 bits of milliseconds, 4 h 39 min [R55 §3.6].
pub const PULSE_MAX: Micros = Micros::from_millis(0x00FF_FFFF);

/// An output that could not be released is tried again after this time.
const RETRY: Duration = Duration::from_secs(1);
/// When the site ends, its pulses have this time to be released.
const STOP_MAX: Duration = Duration::from_millis(2_500);
/// How often a release is tried then.
const STOP_TRIES: u8 = 3;

/// A pulse to give.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Pulse {
    /// How long; none is the module's own width.
    pub width: Option<Micros>,
    /// Who keeps the time.
    pub by: By,
    /// Release first and pull in after the time, instead of the reverse.
    pub off: bool,
}

/// Who keeps the time of a pulse.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum By {
    /// The module where it can.
    #[default]
    Auto,
    /// The module.
    Device,
    /// The host.
    Host,
}

/// How a pulse was begun.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PulseDone {
    /// The state during the pulse.
    pub value: bool,
    /// What it was before, where that was known.
    pub before: Option<bool>,
    /// Who keeps the time.
    pub by: By,
    /// How long it is.
    pub width: Micros,
    /// How far it is certain that it began.
    pub confirmed: Confirmed,
    /// From handing the command in to the last byte of its own reply.
    pub took: Micros,
    /// The number of its audit entry.
    pub audit: String,
}

/// What a pulse comes down to.
enum Way {
    /// One command; the module does the rest.
    Device(Op, Micros),
    /// A command now and one later.
    Host(Micros),
}

impl Service {
    /// Gives a pulse; returns when it has begun. One that is timed here is ended by a task of
    /// its own, which also tries again until the output is released, another command takes the
    /// output over, or the site is closed.
    ///
    /// # Errors
    /// [`Failure::PulseWidth`] where the module has no such pulse, or as [`Service::write`].
    /// Where the module may have acted, the output is released all the same.
    pub async fn pulse(
        &self,
        module: &str,
        point: Point,
        pulse: Pulse,
    ) -> Result<PulseDone, Failure> {
        self.inner.writable(module, &[point])?;
        let value = !pulse.off;
        let way = self.way(module, point, pulse).await?;
        self.inner.timers.forget(module, point);
        let label = self.inner.label(module, point);
        let points = [point];
        let (begun, by, width) = match way {
            Way::Device(op, width) => {
                let note = self.note(format!("pulse {label} {}ms by device", width.0 / 1_000));
                let wanted = |_| Some(value);
                let begun = self.inner.command(module, &points, op, true, note, wanted);
                (begun.await, By::Device, width)
            }
            Way::Host(width) => {
                let note = self.note(format!("pulse {label} {}ms by host", width.0 / 1_000));
                let begun = self.begin_timed(module, point, value, width, note);
                (begun.await, By::Host, width)
            }
        };
        let begun = begun?;
        Ok(PulseDone {
            value,
            before: begun.outputs.first().and_then(|(_, _, before)| *before),
            by,
            width,
            confirmed: begun.confirmed,
            took: begun.took,
            audit: begun.audit,
        })
    }

    /// How a pulse is given by this kind of module.
    async fn way(&self, module: &str, point: Point, pulse: Pulse) -> Result<Way, Failure> {
        let setup = self.inner.described(module)?.setup;
        let refused = |pulses: Option<Pulses>| Failure::PulseWidth {
            point,
            asked: pulse.width,
            own: pulses.map(own_width),
            pulse_mode: pulses.is_some_and(|pulses| pulses.of(point).is_some()),
        };
        let width = pulse.width.filter(|width| {
            let shortest = Micros::from_millis(1);
            (shortest..=PULSE_MAX).contains(width)
        });
        if pulse.width.is_some() && width.is_none() {
            return Err(refused(None));
        }
        match (setup.family, pulse.by) {
            (Family::R55, By::Auto | By::Device) => {
                let width = width.ok_or_else(|| refused(None))?;
                let millis = u32::try_from(width.0 / 1_000).ok().and_then(U24::new);
                let jog = Op::Jog {
                    channel: channel(point)?,
                    close: !pulse.off,
                    millis: millis.ok_or_else(|| refused(None))?,
                };
                Ok(Way::Device(jog, width))
            }
            (Family::Eda9060a, by) => {
                let pulses = self.pulses(module).await?;
                let own = pulses.of(point).map(|_| own_width(pulses));
                match (own, by, width) {
                    (Some(own), By::Auto | By::Device, asked)
                        if !pulse.off && asked.is_none_or(|asked| asked == own) =>
                    {
                        let on = Op::Write(Bank::one(channel(point)?, true));
                        Ok(Way::Device(on, own))
                    }
                    (None, By::Host, Some(width)) => Ok(Way::Host(width)),
                    _ => Err(refused(Some(pulses))),
                }
            }
            (_, By::Device) => Err(refused(None)),
            (_, By::Auto | By::Host) => width.map(Way::Host).ok_or_else(|| refused(None)),
        }
    }

    /// Which outputs of the module give pulses; it is asked where that is not known.
    async fn pulses(&self, module: &str) -> Result<Pulses, Failure> {
        let known = lock(&self.inner.state).site.pulses(module);
        if let Some(pulses) = known {
            return Ok(pulses);
        }
        let done = self.inner.run(module, Op::ReadPulse, false).await?;
        match done.seen {
            Some(Seen::Pulse { mask, width }) => Ok(Pulses { mask, width }),
            _ => Err(railbus_host::Fault::Unsupported.into()),
        }
    }

    /// Begins a pulse that is timed here, in a task that ends it too: once the first frame may
    /// have gone out, nothing depends on the caller any more.
    async fn begin_timed(
        &self,
        module: &str,
        point: Point,
        value: bool,
        width: Micros,
        note: Note,
    ) -> Result<WriteDone, Failure> {
        let (told, begun) = oneshot::channel();
        let timer = Timer {
            inner: Arc::clone(&self.inner),
            place: (module.to_owned(), point),
            value,
            width: Duration::from_micros(width.0),
        };
        let turn = self.inner.timers.add(&timer.place);
        tokio::spawn(timer.run(note, turn, told));
        let lost = || Err(railbus_host::Fault::Unknown.into());
        begun.await.unwrap_or_else(|_| lost())
    }

    /// Waits until all pulses that are timed here have ended.
    pub async fn pulses_ended(&self) {
        self.inner.timers.all_ended().await;
    }
}

fn own_width(pulses: Pulses) -> Micros {
    Micros::from_millis(u64::from(pulses.width.tenths()) * 100)
}

/// An output, by its module's name.
type Place = (String, Point);

/// A pulse that is timed here.
struct Timer {
    inner: Arc<Inner>,
    place: Place,
    value: bool,
    width: Duration,
}

/// A pulse's own end of its entry among the [`Timers`].
struct Turn {
    number: u64,
    taken_over: oneshot::Receiver<()>,
    stop: watch::Receiver<bool>,
}

impl Timer {
    async fn run(
        self,
        note: Note,
        mut turn: Turn,
        told: oneshot::Sender<Result<WriteDone, Failure>>,
    ) {
        let begun = self.switch(self.value, note).await;
        let ended = begun
            .as_ref()
            .is_err_and(|failure| !failure.may_have_acted());
        // Fails where the caller has gone away.
        let _ = told.send(begun);
        let taken_over = ended
            || tokio::select! {
                _ = &mut turn.taken_over => true,
                () = tokio::time::sleep(self.width) => false,
                _ = turn.stop.wait_for(|stop| *stop) => false,
            };
        if !taken_over {
            self.release(&mut turn).await;
        }
        self.inner.timers.ended(&self.place, turn.number);
    }

    /// Brings the output back, however often that takes.
    async fn release(&self, turn: &mut Turn) {
        let (module, point) = &self.place;
        let mut tries_when_stopping = 0;
        loop {
            let note = Note {
                origin: Origin::program("pulse"),
                what: format!("end of pulse {}", self.inner.label(module, *point)),
            };
            let done = self.switch(!self.value, note).await;
            if done.is_ok() || self.inner.writable(module, &[*point]).is_err() {
                return;
            }
            if *turn.stop.borrow() {
                tries_when_stopping += 1;
                if tries_when_stopping >= STOP_TRIES {
                    return;
                }
            }
            let stopping = *turn.stop.borrow();
            tokio::select! {
                _ = &mut turn.taken_over => return,
                () = tokio::time::sleep(RETRY) => {}
                _ = turn.stop.wait_for(|stop| *stop), if !stopping => {}
            }
        }
    }

    async fn switch(&self, on: bool, note: Note) -> Result<WriteDone, Failure> {
        let (module, point) = &self.place;
        let op = Op::Write(Bank::one(channel(*point)?, on));
        let wanted = |_| Some(on);
        self.inner
            .command(module, &[*point], op, true, note, wanted)
            .await
    }
}

/// The pulses that are timed here: at most one of each output.
#[derive(Debug)]
pub(super) struct Timers {
    running: Mutex<Running>,
    count: watch::Sender<usize>,
    stop: watch::Sender<bool>,
}

#[derive(Debug, Default)]
struct Running {
    newest: u64,
    by_place: BTreeMap<Place, (u64, oneshot::Sender<()>)>,
    /// Those that run, the ones that were taken over included.
    count: usize,
}

impl Default for Timers {
    fn default() -> Timers {
        Timers {
            running: Mutex::default(),
            count: watch::Sender::new(0),
            stop: watch::Sender::new(false),
        }
    }
}

impl Timers {
    fn add(&self, place: &Place) -> Turn {
        let (take_over, taken_over) = oneshot::channel();
        let mut running = lock(&self.running);
        running.newest += 1;
        let number = running.newest;
        if let Some((_, older)) = running.by_place.insert(place.clone(), (number, take_over)) {
            // Fails where that one has just ended.
            let _ = older.send(());
        }
        running.count += 1;
        self.count.send_replace(running.count);
        Turn {
            number,
            taken_over,
            stop: self.stop.subscribe(),
        }
    }

    fn ended(&self, place: &Place, number: u64) {
        let mut running = lock(&self.running);
        let own = running
            .by_place
            .get(place)
            .is_some_and(|(n, _)| *n == number);
        if own {
            running.by_place.remove(place);
        }
        running.count = running.count.saturating_sub(1);
        self.count.send_replace(running.count);
    }

    /// Another command takes an output over: its pulse, if any, will not be ended from here.
    pub(super) fn forget(&self, module: &str, point: Point) {
        let place = (module.to_owned(), point);
        let older = lock(&self.running).by_place.remove(&place);
        if let Some((_, older)) = older {
            let _ = older.send(());
        }
    }

    async fn all_ended(&self) {
        let mut count = self.count.subscribe();
        // Fails only where the site has gone.
        let _ = count.wait_for(|count| *count == 0).await;
    }

    /// Ends all pulses now, and waits for that as long as may be.
    pub(super) async fn stop_all(&self) {
        self.stop.send_replace(true);
        let _ = tokio::time::timeout(STOP_MAX, self.all_ended()).await;
    }
}

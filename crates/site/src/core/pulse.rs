//! Pulses: by the module if it can time them, otherwise timed here, and released whatever happens
//! to the caller.

use super::context::Context;
use super::order::{Entry, Order, channel};
use super::promises::Why;
use super::timers::Begin;
use super::within::{TTL, Within};
use super::write::note;
use crate::config::{Config, Place};
use crate::rights::Who;
use crate::{CommandError, Pulses};
use railbus_device::{Bank, Observation, Op, Point, PulseTiming};
use railbus_host::Confirmation;
use railbus_wire::{Micros, r55::U24};
use std::time::Duration;

/// The longest pulse: 24 bits of milliseconds, 4 h 39 min [R55 §3.6].
pub const PULSE_MAX: Micros = Micros::from_millis(0x00FF_FFFF);

/// A requested pulse.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Pulse {
    /// How long; none for the module's own width.
    pub width: Option<Micros>,
    /// Who times it.
    pub by: By,
    /// Release first and pull in after the time, instead of the reverse.
    pub off: bool,
    /// The caller confirms an output that requires it.
    pub confirm: bool,
    /// It must have begun within this time.
    pub within: Within,
}

/// Who times a pulse.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum By {
    /// The module if it can.
    #[default]
    Auto,
    /// The module.
    Device,
    /// The host.
    Host,
}

/// How a pulse began.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PulseDone {
    /// The state during the pulse.
    pub value: bool,
    /// The state before, if it was known.
    pub before: Option<bool>,
    /// Who times it.
    pub by: By,
    /// How long it is.
    pub width: Micros,
    /// How far it is certain that it began.
    pub confirmed: Confirmation,
    /// From submitting the command to the last byte of its own reply.
    pub took: Micros,
    /// The number of its audit entry.
    pub audit: String,
}

/// How a pulse is carried out.
enum Way {
    /// One command; the module does the rest.
    Device(Op, Micros),
    /// A command now and one later.
    Host(Micros),
}

impl Context {
    /// Starts a pulse; returns when it has begun.
    pub(crate) async fn pulse(
        &self,
        who: &Who,
        module: &str,
        point: Point,
        pulse: Pulse,
    ) -> Result<PulseDone, CommandError> {
        let since = self.config();
        self.pulse_since(&since, who, module, point, pulse).await
    }

    /// The same at the board that had the name in an earlier configuration, as one of several
    /// steps: see [`Context::turn_since`].
    pub(super) async fn pulse_since(
        &self,
        since: &Config,
        who: &Who,
        module: &str,
        point: Point,
        pulse: Pulse,
    ) -> Result<PulseDone, CommandError> {
        self.with(|state| state.may_command(who, module, &[point], pulse.confirm))?;
        let expires = self.expires(pulse.within);
        let output = [Place::new(module, point)];
        let turn = self.turn_since(since, output, expires).await?;
        // Meanwhile the configuration may have changed, or the site begun to end.
        self.with(|state| state.may_command(who, module, &[point], pulse.confirm))?;
        // It may be another board by now, or keep the time otherwise.
        let way = self.way(module, point, pulse, expires).await?;
        let value = !pulse.off;
        let label = self.with(|state| state.label(module, point));
        let (begun, by, width) = match way {
            Way::Device(op, width) => {
                let noted = note(
                    who,
                    format!("pulse {label} {}ms by device", width.0 / 1_000),
                );
                let order = Order {
                    module,
                    points: &[point],
                    op,
                    verify: true,
                    expires,
                };
                let mut entry = Entry::new(noted);
                let wanted = |_| Some(value);
                let begun = self.command(&turn, order, &mut entry, wanted).await?;
                let begun = self.take_over(module, &[point], begun).await?;
                (begun, By::Device, width)
            }
            Way::Host(width) => {
                let begin = Begin {
                    key: (Place::new(module, point), Why::Pulse),
                    value,
                    end: Some(!value),
                    length: Duration::from_micros(width.0),
                    note: note(who, format!("pulse {label} {}ms by host", width.0 / 1_000)),
                    expires,
                };
                let (begun, _) = self.begin_timed(&turn, begin).await?;
                (begun, By::Host, width)
            }
        };
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
    async fn way(
        &self,
        module: &str,
        point: Point,
        pulse: Pulse,
        expires: Micros,
    ) -> Result<Way, CommandError> {
        let setup = self.with(|state| state.described(module).map(|module| module.setup))?;
        let refused = |pulses: Option<Pulses>| CommandError::PulseWidth {
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
        match (setup.family.datasheet().pulses, pulse.by) {
            (PulseTiming::Command, By::Auto | By::Device) => {
                let width = width.ok_or_else(|| refused(None))?;
                let millis = u32::try_from(width.0 / 1_000).ok().and_then(U24::new);
                let jog = Op::Jog {
                    channel: channel(point)?,
                    close: !pulse.off,
                    millis: millis.ok_or_else(|| refused(None))?,
                };
                Ok(Way::Device(jog, width))
            }
            (PulseTiming::Stored, by) => {
                let pulses = self.pulses(module, expires).await?;
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
    async fn pulses(&self, module: &str, expires: Micros) -> Result<Pulses, CommandError> {
        let known = self.with(|state| state.site.pulses(module));
        if let Some(pulses) = known {
            return Ok(pulses);
        }
        let done = self.run(module, Op::ReadPulse, expires).await?;
        match done.seen {
            Some(Observation::Pulse { mask, width }) => Ok(Pulses { mask, width }),
            _ => Err(railbus_host::Fault::Unsupported.into()),
        }
    }

    /// Whether switching an output on begins a pulse of the module's own. Where the module does not
    /// say so, it may.
    pub(super) async fn gives_pulses(&self, place: &Place) -> bool {
        let gives_none = self.with(|state| {
            let described = state.described(&place.module);
            described
                .is_ok_and(|module| module.setup.family.datasheet().pulses != PulseTiming::Stored)
        });
        if gives_none {
            return false;
        }
        let pulses = self.pulses(&place.module, self.now() + TTL).await;
        pulses.map_or(true, |pulses| pulses.of(place.point).is_some())
    }
}

fn own_width(pulses: Pulses) -> Micros {
    Micros::from_millis(u64::from(pulses.width.tenths()) * 100)
}

//! Exclusive access to a line, for callers that change settings of modules.

use super::{Service, Update, close_all};
use crate::Failure;
use crate::config::Place;
use crate::core::STOP_MAX;
use railbus_host::{Fault, LineState, PortError};
use railbus_wire::Micros;
use std::sync::Arc;
use std::time::Duration;
use tokio::time::Instant;

/// The longest exclusive access; for longer ones it is requested again.
pub const LOAN_MAX: Duration = Duration::from_secs(900);
/// The shortest loan that is of use: a change of one setting, and the way back.
const LOAN_MIN: Duration = Duration::from_secs(60);
/// So long before an output must be switched off a loan is over: a write that was begun then is
/// still verified, and the line is opened.
const SAFE: Duration = Duration::from_secs(30);

/// Exclusive access to a line. Its port is closed, and its points become stale with the reason
/// `lent`, until [`Loan::end`], or until this is dropped: whatever happens to the holder, the line
/// comes back.
#[derive(Debug)]
pub struct Loan {
    service: Service,
    line: String,
    until: Instant,
    is_over: bool,
}

impl Service {
    /// Closes the port of a line and leaves it to the caller, until [`Loan::until`]. Pulses and
    /// leases of its outputs end before that, since nobody could end them meanwhile; commands
    /// under way get a second to end.
    ///
    /// # Errors
    /// [`Failure::NoSuchLine`]; [`Failure::Lent`] while somebody else has it; [`Failure::Due`]
    /// where an output must be switched off soon, which nobody could do meanwhile.
    pub async fn lend(&self, line: &str) -> Result<Loan, Failure> {
        let (service, line) = (self.clone(), line.to_owned());
        // If the caller has gone, it comes back at once.
        let lent = tokio::spawn(async move { service.lend_asked(&line).await });
        lent.await.unwrap_or_else(|_| Err(Fault::Unknown.into()))
    }

    async fn lend_asked(&self, line: &str) -> Result<Loan, Failure> {
        let _one_at_a_time = self.inner.reloading.lock().await;
        let config = self.config();
        let of_line = |place: &Place| {
            let module = config.modules.get(&place.module);
            module.is_some_and(|module| module.line == line)
        };
        self.time_to_lend(of_line)?;
        self.inner.change(|state| {
            let now = state.lines.get_mut(line).ok_or(Failure::NoSuchLine)?;
            match std::mem::replace(&mut now.lent, true) {
                true => Err(Failure::Lent),
                false => Ok(()),
            }
        })?;
        // From here on it comes back, whatever becomes of this.
        let mut loan = Loan {
            service: self.clone(),
            line: line.to_owned(),
            until: Instant::now(),
            is_over: false,
        };
        let outputs = self.inner.read(|state| state.outputs());
        let of = outputs.into_iter().filter(of_line).collect();
        let (turns, left) = self.end_now(of, STOP_MAX).await;
        // What could not be ended is, once the line is back.
        self.inner.change(|state| state.hasten(&left));
        loan.until = match self.time_to_lend(of_line) {
            Ok(time) => Instant::now() + time,
            Err(failure) => {
                // Such an output was switched on in the meantime. The port was not closed.
                loan.is_over = true;
                self.inner.change(|state| {
                    if let Some(now) = state.lines.get_mut(line) {
                        now.lent = false;
                    }
                });
                return Err(failure);
            }
        };
        let handle = self.inner.take_line(line);
        close_all(handle.into_iter()).await;
        self.inner.change(|state| {
            if let Some(now) = state.lines.get_mut(line) {
                now.state = LineState::Absent(Arc::new(PortError::Exclusive));
            }
        });
        drop(turns);
        self.inner.tell(Update::Line(line.to_owned()));
        Ok(loan)
    }

    /// How long a line can be lent: what its outputs have until they must be switched off.
    fn time_to_lend(&self, of_line: impl Fn(&Place) -> bool) -> Result<Duration, Failure> {
        let limits = self.inner.read(|state| state.limits(of_line));
        let Some((left, place)) = limits.into_iter().min() else {
            return Ok(LOAN_MAX);
        };
        match left.checked_sub(SAFE) {
            Some(time) if time >= LOAN_MIN => Ok(time.min(LOAN_MAX)),
            _ => Err(Failure::Due {
                path: self.config().path(&place),
                left: Micros(u64::try_from(left.as_micros()).unwrap_or(u64::MAX)),
            }),
        }
    }
}

impl Loan {
    /// Resolves when it is over: the holder has to finish and release the line.
    #[must_use]
    pub const fn until(&self) -> Instant {
        self.until
    }

    /// Takes the line back, and the configuration as it is now, where there is a text: a module
    /// may have moved meanwhile. A text that has problems changes nothing.
    pub async fn end(mut self, text: Option<&str>) {
        self.is_over = true;
        take_back(&self.service, &self.line, text).await;
    }

    /// The site ends: there is nothing to take back.
    pub fn leave(mut self) {
        self.is_over = true;
    }
}

impl Drop for Loan {
    fn drop(&mut self) {
        if self.is_over || self.service.inner.read(|state| state.is_stopping()) {
            return;
        }
        let (service, line) = (self.service.clone(), std::mem::take(&mut self.line));
        // Without a runtime the process ends.
        if let Ok(runtime) = tokio::runtime::Handle::try_current() {
            runtime.spawn(async move { take_back(&service, &line, None).await });
        }
    }
}

async fn take_back(service: &Service, line: &str, text: Option<&str>) {
    service.inner.change(|state| {
        if let Some(now) = state.lines.get_mut(line) {
            now.lent = false;
        }
    });
    if let Some(text) = text {
        // Errors in it are reported to the caller of a reload.
        let _ = service.reload(text).await;
    }
    let _one_at_a_time = service.inner.reloading.lock().await;
    let config = service.config();
    // Another caller may already have borrowed it again.
    let (is_lent, is_open) = service.inner.read(|state| {
        let now = state.lines.get(line);
        now.map_or((false, false), |now| (now.lent, now.id.is_some()))
    });
    if !is_open && !is_lent && config.lines.contains_key(line) {
        // The holder may have done anything, and the line's clock starts anew.
        let of_line = |module: &str| {
            let config = config.modules.get(module);
            config.is_some_and(|config| config.line == line)
        };
        service.inner.change(|state| state.come_back(of_line));
        service.open_again(&config, line);
        service.inner.tell(Update::Line(line.to_owned()));
    }
}

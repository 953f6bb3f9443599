//! Exclusive access to a line, for callers that change settings of modules: what is done is decided
//! in the core.

use super::{Service, lock};
use crate::core::{Context, Exclusive, LoanId, TaskId};
use crate::{CommandError, Config};
use railbus_host::Fault;
use std::sync::{Arc, Mutex};
use std::time::Duration;
use tokio::sync::oneshot;
use tokio::time::Instant;

/// Exclusive access to a line. Its port is closed, and its points become stale with the reason
/// `lent`, until [`ExclusiveHold::end`], or until this is dropped: whatever happens to the holder,
/// the line comes back.
#[derive(Debug)]
pub struct ExclusiveHold {
    service: Service,
    line: String,
    id: LoanId,
    until: Instant,
    is_over: bool,
}

/// Exclusive access that is requested. If the caller goes away, that ends; what was granted and not
/// told yet is given back.
struct Lending<'a> {
    service: &'a Service,
    line: &'a str,
    task: TaskId,
    /// What was granted, until the caller has it. The answer may come later than that: it waits
    /// until the ends of pulses are in the log.
    granted: Arc<Mutex<Option<Exclusive>>>,
}

impl Drop for Lending<'_> {
    fn drop(&mut self) {
        let task = self.task;
        self.service.inner.drive(|core, now| core.cancel(now, task));
        let granted = lock(&self.granted).take();
        if let Some(lent) = granted {
            drop(self.service.loan(self.line, lent));
        }
    }
}

impl Service {
    /// Closes the port of a line and leaves it to the caller, until [`ExclusiveHold::until`].
    /// Pulses and leases of its outputs end before that, since they can't be ended while the line
    /// is held; commands under way get a second to end.
    ///
    /// # Errors
    /// [`CommandError::RoleTooLow`], [`CommandError::Limited`]; [`CommandError::NoSuchLine`];
    /// [`CommandError::Lent`] while another caller has it; [`CommandError::Due`] where an output
    /// must be switched off soon, which is impossible while the line is held;
    /// [`Fault::Overloaded`] where too many wait for lines; [`Fault::Closed`] when the site ends.
    pub async fn lend(&self, line: &str) -> Result<ExclusiveHold, CommandError> {
        self.who.rights.may_change_site()?;
        let (end, lent) = oneshot::channel();
        let (name, granted) = (line.to_owned(), Arc::default());
        let grants = Arc::clone(&granted);
        let task = self.inner.drive(|core, now| {
            let lend = |context: Context| async move {
                let lent = context.lend_line(&name).await;
                *lock(&grants) = lent.as_ref().ok().copied();
                lent
            };
            // Fails if the caller has gone.
            core.start(now, lend, |lent| _ = end.send(lent))
        });
        let lending = Lending {
            service: self,
            line,
            task,
            granted,
        };
        let lent = lent.await;
        let lent = lent.unwrap_or_else(|_| Err(Fault::Unknown.into()))?;
        _ = lock(&lending.granted).take();
        Ok(self.loan(line, lent))
    }

    fn loan(&self, line: &str, lent: Exclusive) -> ExclusiveHold {
        ExclusiveHold {
            service: self.clone(),
            line: line.to_owned(),
            id: lent.loan,
            until: self.inner.start + Duration::from_micros(lent.until.0),
            is_over: false,
        }
    }
}

impl ExclusiveHold {
    /// Resolves when it is over: the holder has to finish and release the line.
    #[must_use]
    pub const fn until(&self) -> Instant {
        self.until
    }

    /// Takes the line back, and the configuration as it is now, where there is a text: a module
    /// may have moved meanwhile. A text that has problems changes nothing: they are reported to the
    /// caller of a reload.
    pub async fn end(mut self, text: Option<&str>) {
        self.is_over = true;
        let config = text.and_then(|text| Config::parse(text).ok());
        self.service.tell_zone();
        let (line, id) = (self.line.clone(), self.id);
        self.service
            .ask(|core| async move { core.give_back(&line, id, config).await })
            .await;
    }

    /// The site ends: there is nothing to take back.
    pub fn leave(mut self) {
        self.is_over = true;
    }
}

impl Drop for ExclusiveHold {
    fn drop(&mut self) {
        if self.is_over {
            return;
        }
        let (line, id) = (std::mem::take(&mut self.line), self.id);
        self.service.inner.drive(|core, now| {
            let give_back =
                |context: Context| async move { context.give_back(&line, id, None).await };
            core.start(now, give_back, |()| {})
        });
    }
}

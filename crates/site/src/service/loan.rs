//! A line left to somebody else for a while: who changes what modules keep needs it for himself.

use super::{Service, Update, close_all, lock};
use crate::Failure;
use crate::config::Place;
use railbus_host::{LineState, PortError};
use std::sync::Arc;

/// A line that is lent. Its port is closed, and its points grow stale with `lent` as the reason,
/// until [`Loan::end`].
#[derive(Debug)]
pub struct Loan {
    service: Service,
    line: String,
}

impl Service {
    /// Closes the port of a line and leaves it to the caller. Pulses and leases of its outputs end
    /// before that, since nobody could end them meanwhile; commands under way get a second to end.
    ///
    /// # Errors
    /// [`Failure::NoSuchLine`]; [`Failure::Lent`] while somebody else has it.
    pub async fn lend(&self, line: &str) -> Result<Loan, Failure> {
        let _one_at_a_time = self.inner.reloading.lock().await;
        {
            let mut state = lock(&self.inner.state);
            let now = state.lines.get_mut(line).ok_or(Failure::NoSuchLine)?;
            if std::mem::replace(&mut now.lent, true) {
                return Err(Failure::Lent);
            }
        }
        let config = self.config();
        let of_line = |place: &Place| {
            let module = config.modules.get(&place.module);
            module.is_some_and(|module| module.line == line)
        };
        // What could not be ended is, once the line is back.
        let (turn, left) = self.inner.end_now(of_line).await;
        for number in left {
            self.inner.schedule.hasten(number);
        }
        let handle = lock(&self.inner.lines).remove(line);
        close_all(handle.into_iter()).await;
        drop(turn);
        if let Some(now) = lock(&self.inner.state).lines.get_mut(line) {
            now.state = LineState::Absent(Arc::new(PortError::Lent));
        }
        self.inner.tell(Update::Line(line.to_owned()));
        Ok(Loan {
            service: self.clone(),
            line: line.to_owned(),
        })
    }
}

impl Loan {
    /// Takes the line back, and the configuration as it is now, where there is a text: a module
    /// may have moved meanwhile. A text that has problems changes nothing.
    pub async fn end(self, text: Option<&str>) {
        let Loan { service, line } = self;
        if let Some(now) = lock(&service.inner.state).lines.get_mut(&line) {
            now.lent = false;
        }
        if let Some(text) = text {
            // What is wrong with it is told by whoever asks for a reload.
            let _ = service.reload(text).await;
        }
        let _one_at_a_time = service.inner.reloading.lock().await;
        let config = service.config();
        let is_lent = {
            let state = lock(&service.inner.state);
            state.lines.get(&line).is_some_and(|now| now.lent)
        };
        // Somebody else may have been quicker to borrow it again.
        let is_open = lock(&service.inner.lines).contains_key(&line);
        if !is_open && !is_lent && config.lines.contains_key(&line) {
            // Who had it may have done anything, and the line's clock begins anew.
            let of_line = |module: &str| {
                let config = config.modules.get(module);
                config.is_some_and(|config| config.line == line)
            };
            {
                let mut state = lock(&service.inner.state);
                state.site.forget(of_line);
                state.guard.forget_doubts(of_line);
                state.may_have_gone_off(of_line, service.inner.now());
            }
            service.open_again(&config, &line);
            service.inner.tell(Update::Line(line));
        }
    }
}

//! A raw frame that may change something. It is sent between the polls of its line, once, and is
//! not a command: no restriction of the configuration applies to it. So from before it is sent, no
//! cached state of the outputs of its modules is valid any more, until they are read again.

use super::{Inner, RawTerms, Service};
use crate::config::Place;
use crate::{CommandError, Role};
use railbus_commission::{Risk, is_answered};
use railbus_host::{Fault, ProbeResult, Probed, reply_in};
use railbus_store::audit::End;
use railbus_wire::{Exchange, Response, ascii, rtu};
use std::sync::Arc;
use std::time::Duration;

/// What was not sent by then is taken back: it may be long after it was wanted.
const SEND_TTL: Duration = Duration::from_secs(5);

/// The result of a raw frame.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Sent {
    /// What came back.
    pub met: ProbeResult,
    /// The number of its audit entry.
    pub audit: String,
}

impl Service {
    /// The modules of a line that a request may concern: the one asked, or all that speak its
    /// protocol.
    #[must_use]
    pub fn concerned(&self, line: &str, asked: &Exchange<'_>) -> Vec<String> {
        let config = self.config();
        let all = Risk::of(asked) == Risk::All;
        let of_line = config.modules_of(line).filter(|(_, module)| {
            let setup = &module.setup;
            setup.protocol == asked.protocol() && (all || setup.address == asked.address())
        });
        of_line.map(|(name, _)| name.clone()).collect()
    }

    /// Whether this handle's rights cover what a frame may do to modules of this line, by the
    /// present configuration: engineers send, and with a limit to some points only what can affect
    /// no other output. Stored settings include the address: another module would answer to that
    /// name.
    ///
    /// # Errors
    /// [`CommandError::RoleTooLow`], [`CommandError::Limited`], [`CommandError::NotPermitted`].
    pub fn may_send(&self, line: &str, asked: &Exchange<'_>) -> Result<(), CommandError> {
        let rights = &self.who.rights;
        rights.at_least(Role::Engineer)?;
        match Risk::of(asked) {
            Risk::Read => return Ok(()),
            Risk::Output => {}
            Risk::Kept | Risk::All => return rights.may_change_site(),
        }
        if !rights.is_limited() {
            return Ok(());
        }
        let (modules, config) = (self.concerned(line, asked), self.config());
        if modules.is_empty() {
            return Err(CommandError::NotPermitted {
                module: String::new(),
                label: String::new(),
            });
        }
        let outputs = self.inner.read(|state| state.outputs());
        let mut outputs = outputs
            .iter()
            .filter(|place| modules.contains(&place.module));
        outputs.try_for_each(|place| rights.may_switch_in(&config, &place.module, place.point))
    }

    /// Sends a frame that may change something, once. Its audit entry contains `what`. The caller
    /// has reported what it may do.
    ///
    /// # Errors
    /// As [`Service::may_send`], which is asked again after the audit entry; [`CommandError`];
    /// [`CommandError::may_have_acted`] says whether it may have been sent.
    pub async fn send(
        &self,
        line: &str,
        exchange: Exchange<'static>,
        terms: RawTerms,
        what: String,
    ) -> Result<Sent, CommandError> {
        self.may_send(line, &exchange)?;
        let (handle, probe) = self.probe_of(line, exchange, terms)?;
        if self.inner.read(|state| state.is_stopping()) {
            return Err(Fault::Closed.into());
        }
        let modules = self.concerned(line, &exchange);
        let alone = match &modules[..] {
            [module] => Some(module.clone()),
            _ => None,
        };
        let work = self.note_work(alone.as_deref().unwrap_or_default(), what);
        let work = work.await?;
        if let Err(refused) = self.may_send(line, &exchange) {
            work.end(End::not_done(refused.name())).await;
            return Err(refused);
        }
        let audit = work.id().to_owned();
        // Not earlier: another configuration may have come with the audit entry.
        let doubt = Doubt::begin(&self.inner, self.concerned(line, &exchange));
        let probe = railbus_host::Probe {
            changes: true,
            ..probe
        };
        let end = tokio::time::timeout(SEND_TTL, handle.probe(probe)).await;
        // It was taken back, unless it was on its way just then.
        let end = end.unwrap_or(Err(Fault::Unknown));
        drop(doubt);
        work.end(audited(&exchange, &end)).await;
        let met = end?;
        if met.outcome == Probed::Unsafe {
            return Err(Fault::Unsupported.into());
        }
        if let Some(module) = alone {
            // If it does not answer, nothing is known of it, and that is reported.
            let _ = self.read_fresh(&module).await;
        }
        Ok(Sent { met, audit })
    }
}

/// How it ended, as the audit log tells it.
fn audited(asked: &Exchange<'_>, end: &Result<ProbeResult, Fault>) -> End {
    let met = match end {
        Ok(met) => met,
        Err(fault) => {
            return End::Failed {
                name: fault.name(),
                may_have_acted: fault.may_have_acted(),
            };
        }
    };
    match met.outcome {
        Probed::Answered if is_refused(asked, &met.bytes) => End::not_done("refused"),
        Probed::Answered => End::Reply,
        Probed::Garbled => End::unsure("garbled"),
        Probed::Silent if is_answered(asked) => End::unsure("no_reply"),
        Probed::Silent => End::Sent,
        Probed::Unsafe => End::not_done(Fault::Unsupported.name()),
    }
}

/// Whether a module that answered said no, by all that was heard.
#[must_use]
pub fn is_refused(asked: &Exchange<'_>, heard: &[u8]) -> bool {
    let reply = reply_in(asked, heard).unwrap_or_default();
    let reply = asked.decode_response(reply).whole();
    reply.is_some_and(|reply| {
        matches!(
            reply.response,
            Response::Rtu(rtu::Response::Exception(_))
                | Response::Ascii(ascii::Response::Invalid | ascii::Response::Ignored)
        )
    })
}

/// While it lives, any output of these modules may be on; after it, only what is read then says
/// how it is.
struct Doubt {
    inner: Arc<Inner>,
    modules: Vec<String>,
    outputs: Vec<Place>,
}

impl Doubt {
    fn begin(inner: &Arc<Inner>, modules: Vec<String>) -> Doubt {
        let outputs = inner.change(|state| state.doubt(&modules));
        Doubt {
            inner: Arc::clone(inner),
            modules,
            outputs,
        }
    }
}

impl Drop for Doubt {
    fn drop(&mut self) {
        let (modules, outputs) = (&self.modules, &self.outputs);
        self.inner
            .change(|state| state.no_longer_doubt(modules, outputs));
    }
}

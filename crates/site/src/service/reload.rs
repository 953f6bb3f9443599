//! Another configuration, while the site is at work: what is done is decided in the core.

use super::{Service, lock};
use crate::config::ConfigProblem;
use crate::core::Store;
use crate::{CommandError, Config, Reloaded};
use railbus_host::Fault;
use std::convert::Infallible;
use std::sync::{Arc, Mutex};
use tokio::task::JoinError;

/// Why a configuration is not brought into force.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ReloadError {
    /// The text has these problems.
    Problems(Vec<ConfigProblem>),
    /// [`CommandError::RoleTooLow`], or [`CommandError::Limited`] where it changes more than the
    /// names of points that the caller is limited to; [`Fault::Overloaded`] where too many reloads
    /// and loans wait. [`Fault::Closed`] where the site ends: the text may be written, and is in
    /// force with the next start then. [`Fault::Unknown`] where that is not known, because the
    /// program failed.
    Refused(CommandError),
}

impl From<Vec<ConfigProblem>> for ReloadError {
    fn from(problems: Vec<ConfigProblem>) -> ReloadError {
        ReloadError::Problems(problems)
    }
}

impl From<CommandError> for ReloadError {
    fn from(failure: CommandError) -> ReloadError {
        ReloadError::Refused(failure)
    }
}

impl Service {
    /// Takes another configuration. Lines that stay where they are go on: of their modules, those
    /// that changed begin anew, and the others notice nothing. Lines that changed themselves are
    /// closed and opened anew. It goes on to its end, whether or not somebody waits.
    ///
    /// # Errors
    /// [`ReloadError`]. But for [`Fault::Unknown`], nothing has changed.
    pub async fn reload(&self, text: &str) -> Result<Reloaded, ReloadError> {
        let written = async { Ok::<(), Infallible>(()) };
        let reloaded = self.reload_written(text, written).await?;
        Ok(reloaded.unwrap_or_else(|never| match never {}))
    }

    /// The same of a text that is written meanwhile: what is promised of modules whose names are
    /// about to stand for others is done before that, so that a crash leaves nothing behind that is
    /// to be done at a board without a name. What can't be written is not taken.
    ///
    /// # Errors
    /// As [`Service::reload`]; inside it, why it was not written.
    pub async fn reload_written<E: Send + 'static>(
        &self,
        text: &str,
        written: impl Future<Output = Result<(), E>> + Send + 'static,
    ) -> Result<Result<Reloaded, E>, ReloadError> {
        let config = Config::parse(text)?;
        self.who.rights.may_reload(&self.config(), &config)?;
        self.tell_zone();
        let end = Arc::new(Mutex::new(None));
        let ended = Arc::clone(&end);
        let store = Store(Box::pin(async move {
            // A panic in it is the caller's.
            let written = tokio::spawn(written).await;
            let is_written = matches!(written, Ok(Ok(())));
            *lock(&ended) = Some(written);
            is_written
        }));
        let rights = self.who.rights.clone();
        let reloaded = self
            .ask(|core| async move { core.reload(&rights, config, Some(store)).await })
            .await;
        let written = lock(&end).take();
        came_of(reloaded, written)
    }
}

/// What came of a reload: what the core said, unless its procedure was cut off, and how the writing
/// ended, where it has.
fn came_of<E>(
    reloaded: Option<Result<Option<Reloaded>, CommandError>>,
    written: Option<Result<Result<(), E>, JoinError>>,
) -> Result<Result<Reloaded, E>, ReloadError> {
    match (reloaded.transpose()?.flatten(), written) {
        (Some(reloaded), _) => Ok(Ok(reloaded)),
        (None, Some(Ok(Err(why)))) => Ok(Err(why)),
        (None, Some(Err(broken))) if broken.is_panic() => {
            std::panic::resume_unwind(broken.into_panic())
        }
        (None, _) => Err(CommandError::Line(Fault::Unknown).into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The procedure of the core panics, before or after the text is written.
    #[test]
    fn a_reload_that_is_cut_off_ends() {
        for written in [None, Some(Ok(Ok::<(), ()>(())))] {
            let unknown = ReloadError::Refused(CommandError::Line(Fault::Unknown));
            assert_eq!(came_of(None, written), Err(unknown));
        }
    }
}

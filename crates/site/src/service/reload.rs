//! Another configuration, while the site is at work.

use super::state::LineNow;
use super::{Service, Update, close_all, lock, prepare};
use crate::Config;
use crate::config::Problem;
use railbus_host::{LineState, PortError};
use std::collections::BTreeSet;
use std::sync::Arc;

/// What another configuration changed.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Reloaded {
    /// Lines that go on as they were, with all that is known of their modules.
    pub kept: Vec<String>,
    /// Lines that were opened, or closed and opened again.
    pub opened: Vec<String>,
    /// Lines that are no more.
    pub closed: Vec<String>,
}

impl Service {
    /// Takes another configuration. Lines that it leaves as they are go on; the others are
    /// closed and opened anew.
    ///
    /// # Errors
    /// Every problem of the text. Then nothing has changed.
    pub async fn reload(&self, text: &str) -> Result<Reloaded, Vec<Problem>> {
        let config = Config::parse(text)?;
        let _one_at_a_time = self.inner.reloading.lock().await;
        let old = self.config();
        let same = |line: &String| same_line(&old, &config, line);
        let kept: BTreeSet<String> = config.lines.keys().filter(|l| same(l)).cloned().collect();
        let changed = |line: &&String| !kept.contains(*line);
        let reloaded = Reloaded {
            kept: kept.iter().cloned().collect(),
            opened: config.lines.keys().filter(changed).cloned().collect(),
            closed: old
                .lines
                .keys()
                .filter(|line| !config.lines.contains_key(*line))
                .cloned()
                .collect(),
        };

        let gone: Vec<_> = {
            let mut lines = lock(&self.inner.lines);
            let ending = reloaded.opened.iter().chain(&reloaded.closed);
            ending.filter_map(|line| lines.remove(line)).collect()
        };
        close_all(gone.into_iter()).await;

        {
            let mut state = lock(&self.inner.state);
            for line in &reloaded.closed {
                state.lines.remove(line);
            }
            for line in &reloaded.opened {
                let lent = state.lines.get(line).is_some_and(|now| now.lent);
                let mut now = LineNow::new(&config, line);
                if lent {
                    now.lent = true;
                    now.state = LineState::Absent(Arc::new(PortError::Lent));
                }
                state.lines.insert(line.clone(), now);
            }
            let keep = |module: &str| {
                let line = config.modules.get(module).map(|module| &module.line);
                line.is_some_and(|line| kept.contains(line))
            };
            state.site.reconfigure(config.clone(), keep);
            state.health.retain(|module, _| keep(module));
        }
        for line in &reloaded.opened {
            // Who has it gives it back.
            let lent = lock(&self.inner.state)
                .lines
                .get(line)
                .is_some_and(|now| now.lent);
            if !lent {
                self.open_again(&config, line);
            }
        }
        self.inner.tell(Update::Reloaded);
        Ok(reloaded)
    }

    /// Opens a line of a configuration that was checked. What the system refuses even so is the
    /// line's state.
    pub(super) fn open_again(&self, config: &Config, line: &str) {
        let Ok(prepared) = prepare(config, line, self.inner.polls) else {
            return;
        };
        if let Err(why) = self.open(line.to_owned(), prepared) {
            let absent = LineState::Absent(Arc::new(why));
            if let Some(now) = lock(&self.inner.state).lines.get_mut(line) {
                now.state = absent;
            }
        }
    }
}

/// Whether a line and its modules are the same to the line's task. What points are called and
/// which are locked is no business of it.
fn same_line(old: &Config, new: &Config, line: &str) -> bool {
    let modules = |config: &Config| {
        let modules = config.modules_of(line);
        modules
            .map(|(name, module)| (name.clone(), module.setup, module.plan))
            .collect::<Vec<_>>()
    };
    let both = (old.lines.get(line), new.lines.get(line));
    matches!(both, (Some(a), Some(b)) if a == b) && modules(old) == modules(new)
}

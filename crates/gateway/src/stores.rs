//! What survives the daemon: history and audit log, in the state folder.

use railbus_site::Service;
use railbus_store::audit::{AuditLog, OpenReport};
use railbus_store::history::{Event, EventKind, History, Severity};
use std::path::Path;

/// The open stores of a site.
pub(super) struct Stores {
    history: Option<History>,
}

impl Stores {
    /// Opens them for a site. Failures are reported as events: the site is served all the same.
    pub(super) fn open(service: &Service, folder: &Path) -> Stores {
        let past = service.config().past;
        let history = History::open(folder, past.history);
        match &history {
            Ok(history) => service.keep_history(history.clone()),
            Err(error) => tell(service, Severity::Error, "history_fails", error),
        }
        match AuditLog::open(folder) {
            Ok((log, found)) => {
                log.require(past.audit_required);
                log.keep(past.audit_bytes);
                service.keep_audit(log);
                tell_found(service, &found);
            }
            Err(error) => {
                if past.audit_required {
                    service.miss_audit();
                }
                tell(service, Severity::Error, "audit_fails", error);
            }
        }
        service.tell_event(Event::new(EventKind::System, Severity::Info, "started"));
        service.tell_dropped_ends();
        Stores {
            history: history.ok(),
        }
    }

    /// Writes what is left. The site was closed before.
    pub(super) async fn close(self, service: &Service) {
        service.tell_event(Event::new(EventKind::System, Severity::Info, "stopped"));
        if let Some(log) = service.audit_log() {
            log.close().await;
        }
        if let Some(history) = self.history {
            history.close().await;
        }
    }
}

/// Reports that commands with an `Idempotency-Key` are refused, because keys can't be written.
pub(super) fn tell_of_keys(service: &Service) {
    if let Some(error) = service.keys_failed() {
        tell(service, Severity::Error, "keys_fail", error);
    }
}

fn tell(service: &Service, severity: Severity, code: &str, text: impl ToString) {
    let event = Event::new(EventKind::System, severity, code);
    service.tell_event(event.text(text.to_string()));
}

/// Reports what was found when the log was opened.
fn tell_found(service: &Service, found: &OpenReport) {
    if let Some(aside) = &found.put_aside {
        tell(service, Severity::Error, "audit_put_aside", aside.display());
    } else if found.cut {
        tell(service, Severity::Error, "audit_cut", "");
    }
    if found.torn > 0 {
        tell(service, Severity::Warning, "audit_torn", found.torn);
    }
    for id in &found.unfinished {
        tell(service, Severity::Warning, "audit_unfinished", id);
    }
}

//! What a site and its centre have in common as clients of NATS servers.

use crate::northbound::broker::tls_reason;
use async_nats::ConnectErrorKind;
use futures_core::Stream;
use railbus_api::problem::{Problem, codes};
use std::error::Error as _;
use std::path::Path;
use std::pin::Pin;

/// Why there is no connection.
pub(crate) fn unreached(error: async_nats::ConnectError) -> Problem {
    let code = match error.kind() {
        ConnectErrorKind::Authentication | ConnectErrorKind::AuthorizationViolation => {
            codes::FLEET_LOGIN
        }
        ConnectErrorKind::Tls => codes::FLEET_TLS,
        _ if tls_reason(&error).is_some() => codes::FLEET_TLS,
        _ => codes::FLEET_UNREACHED,
    };
    // What the system said, without the library's word for it.
    let source = error.source().map(ToString::to_string);
    let reason = tls_reason(&error).or(source);
    Problem::new(code).with("reason", reason.unwrap_or_else(|| error.to_string()))
}

/// A file with keys or certificates can't be used.
pub(crate) fn unusable(path: &Path, reason: &dyn ToString) -> Problem {
    Problem::new(codes::FLEET_FILE)
        .with("path", path.display().to_string())
        .with("reason", reason.to_string())
}

/// The next of a stream; none at its end. Cancel-safe.
pub(crate) async fn next<S: Stream + Unpin>(from: &mut S) -> Option<S::Item> {
    std::future::poll_fn(|context| Pin::new(&mut *from).poll_next(context)).await
}

//! The limit of open WebSockets.

use std::sync::Arc;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

/// How many WebSockets there may be. Each takes one file handle, of which a process usually has
/// 1,024, and some 30 KiB of memory; messages are serialized once for all of them.
const SOCKETS_MAX: usize = 512;

/// Counts open WebSockets.
#[derive(Clone, Debug)]
pub(crate) struct SocketLimit(Arc<Semaphore>);

impl SocketLimit {
    pub(crate) fn new() -> SocketLimit {
        SocketLimit(Arc::new(Semaphore::new(SOCKETS_MAX)))
    }

    /// A permit for one more, released when it is dropped; none if there are too many.
    pub(super) fn acquire(&self) -> Option<OwnedSemaphorePermit> {
        Arc::clone(&self.0).try_acquire_owned().ok()
    }
}

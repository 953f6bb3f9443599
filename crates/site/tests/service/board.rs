//! Relay boards of a few lines, over TCP: ERC-8 with coils from 60 on, functions 01, 05 and 0F.

use railbus_device::{Point, PointKind};
use railbus_wire::crc16;
use std::sync::atomic::{AtomicBool, AtomicU8, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpListener;

/// A write that a board has carried out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Write {
    pub(crate) address: usize,
    /// 5 for one relay, 15 for several.
    pub(crate) function: u8,
    /// The relays that it is about, and those of them that it pulls in.
    pub(crate) mask: u8,
    pub(crate) on: u8,
}

/// What hangs on the line.
#[derive(Debug, Default)]
pub(crate) struct Boards {
    /// The relays of each address.
    relays: [AtomicU8; 8],
    /// These addresses do not answer, and do nothing.
    mute: [AtomicBool; 8],
    /// So many writes are refused from now on.
    refused: AtomicU8,
    /// So many writes of several relays are refused from now on.
    refused_together: AtomicU8,
    /// These relays of each address do not move any more, whatever is acknowledged.
    welded: [AtomicU8; 8],
    /// Every state that there was, as the relays of all addresses.
    states: Mutex<Vec<[u8; 8]>>,
    /// Every write that was carried out, in their order.
    writes: Mutex<Vec<Write>>,
    /// How long a reply takes.
    latency_ms: AtomicU8,
}

impl Boards {
    /// The relays of an address.
    pub(crate) fn relays(&self, address: usize) -> u8 {
        self.relays[address].load(Ordering::SeqCst)
    }

    /// Switches a board off its line, or on again.
    pub(crate) fn mute(&self, address: usize, mute: bool) {
        self.mute[address].store(mute, Ordering::SeqCst);
    }

    /// Lets the boards refuse the next writes.
    pub(crate) fn refuse(&self, writes: u8) {
        self.refused.store(writes, Ordering::SeqCst);
    }

    /// Lets the boards refuse the next writes of several relays at once.
    pub(crate) fn refuse_together(&self, writes: u8) {
        self.refused_together.store(writes, Ordering::SeqCst);
    }

    /// Welds relays of an address as they are.
    pub(crate) fn weld(&self, address: usize, relays: u8) {
        self.welded[address].store(relays, Ordering::SeqCst);
    }

    /// Lets every reply take so long.
    pub(crate) fn slow(&self, millis: u8) {
        self.latency_ms.store(millis, Ordering::SeqCst);
    }

    /// Every write that was carried out, in their order.
    pub(crate) fn writes(&self) -> Vec<Write> {
        self.writes.lock().unwrap().clone()
    }

    /// Moves relays by hand.
    pub(crate) fn set(&self, address: usize, relays: u8) {
        self.relays[address].store(relays, Ordering::SeqCst);
    }

    /// Every state that commands have made, in their order.
    pub(crate) fn states(&self) -> Vec<[u8; 8]> {
        self.states.lock().unwrap().clone()
    }

    fn answer(&self, request: &[u8]) -> Option<Vec<u8>> {
        if request[0] == 0 {
            // All obey, and none answers.
            for address in 1..8 {
                let mut one = request.to_vec();
                one[0] = address;
                self.answer(&one);
            }
            return None;
        }
        let address = usize::from(request[0] & 7);
        if self.mute[address].load(Ordering::SeqCst) {
            return None;
        }
        if request[1] == 3 {
            // Its settings: address, 9600 baud, no parity.
            let mut reply = vec![request[0], 3, 6, 0, request[0], 0, 3, 0, 0];
            reply.extend(crc16(&reply).to_le_bytes());
            return Some(reply);
        }
        let relays = &self.relays[address];
        let coil = request[3] - 60;
        let takes = |from: &AtomicU8| {
            let less = |left: u8| left.checked_sub(1);
            from.fetch_update(Ordering::SeqCst, Ordering::SeqCst, less)
                .is_ok()
        };
        let is_refused = request[1] == 15 && takes(&self.refused_together)
            || request[1] != 1 && takes(&self.refused);
        if is_refused {
            let mut reply = vec![request[0], request[1] | 0x80, 4];
            reply.extend(crc16(&reply).to_le_bytes());
            return Some(reply);
        }
        let welded = self.welded[address].load(Ordering::SeqCst);
        let mut done = None;
        let mut reply = match request[1] {
            1 => vec![request[0], 1, 1, self.relays(address) >> coil],
            5 => {
                let bit = 1 << coil;
                let on = if request[4] == 0xFF { bit } else { 0 };
                done = Some((bit, on));
                request[..6].to_vec()
            }
            15 => {
                let mask = ((1_u16 << request[5]) - 1) as u8;
                done = Some((mask << coil, (request[7] & mask) << coil));
                request[..6].to_vec()
            }
            other => vec![request[0], other | 0x80, 1],
        };
        if let Some((mask, on)) = done {
            let moved = mask & !welded;
            let left = self.relays(address) & !moved;
            relays.store(left | on & moved, Ordering::SeqCst);
            self.writes.lock().unwrap().push(Write {
                address,
                function: request[1],
                mask,
                on,
            });
            let state = std::array::from_fn(|address| self.relays(address));
            self.states.lock().unwrap().push(state);
        }
        reply.extend(crc16(&reply).to_le_bytes());
        Some(reply)
    }
}

/// Starts them; gives back the name of their port.
pub(crate) async fn start() -> (String, Arc<Boards>) {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let port = format!("tcp:{}", listener.local_addr().unwrap());
    let boards = Arc::new(Boards::default());
    let state = Arc::clone(&boards);
    tokio::spawn(async move {
        while let Ok((mut stream, _)) = listener.accept().await {
            let mut request = [0; 64];
            while let Ok(len @ 8..) = stream.read(&mut request).await {
                if let Some(reply) = state.answer(&request[..len]) {
                    let latency = state.latency_ms.load(Ordering::SeqCst);
                    tokio::time::sleep(Duration::from_millis(latency.into())).await;
                    let _ = stream.write_all(&reply).await;
                }
            }
        }
    });
    (port, boards)
}

/// A relay by its number as printed.
pub(crate) const fn k(number: u8) -> Point {
    Point {
        kind: PointKind::Output,
        index: number - 1,
    }
}

/// Waits until something is so.
pub(crate) async fn until(what: impl Fn() -> bool) {
    for _ in 0..1_000 {
        if what() {
            return;
        }
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
    panic!("it never came");
}

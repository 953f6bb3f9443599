//! The jobs that are counted: four exchanges in each of the four protocols, as module and as host.
//!
//! A *server* job reads a request and writes its reply; a *client* job writes a request and reads
//! its reply. `any-client-read` is `rtu-client-read` through the [`Exchange`] of any protocol, as
//! the line master does it.

use crate::floor;
use railbus_wire::{
    Address, Bits, Channel, Decoded, Exchange, Frame, Response, ascii, lc02, r55, rtu,
};
use std::hint::black_box;

/// Reads the bytes received and writes a frame to send; returns the value it read.
type Work = fn(&[u8], &mut Frame) -> Option<u32>;
/// The same without the library.
type Floor = fn(&[u8], &mut [u8; 256]) -> Option<(usize, u32)>;

/// One job.
pub struct Job {
    /// Its name in the table and in `codec-limits.toml`.
    pub name: &'static str,
    received: &'static [u8],
    sent: &'static [u8],
    learned: u32,
    ours: Work,
    floor: Floor,
}

impl Job {
    /// Runs the job this many times, after one run that checks its result.
    pub fn repeat(&self, is_floor: bool, times: u32) -> Result<(), String> {
        let mut frame = Frame::new();
        let mut buffer = [0; 256];
        let right = if is_floor {
            let result = (self.floor)(self.received, &mut buffer);
            result == Some((self.sent.len(), self.learned)) && buffer.starts_with(self.sent)
        } else {
            let result = (self.ours)(self.received, &mut frame);
            result == Some(self.learned) && frame.bytes() == self.sent
        };
        if !right {
            return Err(format!("{} does not do its job", self.name));
        }
        for _ in 0..times {
            if is_floor {
                black_box((self.floor)(
                    black_box(self.received),
                    black_box(&mut buffer),
                ));
            } else {
                black_box((self.ours)(black_box(self.received), black_box(&mut frame)));
            }
        }
        Ok(())
    }
}

/// The outputs and inputs of every module here: the state 0311h of sixteen coils.
const STATE: u32 = 0x0311;

const RTU_READ: &[u8] = &[0x01, 0x01, 0x00, 0x00, 0x00, 0x10, 0x3D, 0xC6];
const RTU_BITS: &[u8] = &[0x01, 0x01, 0x02, 0x11, 0x03, 0xF5, 0xAD];
const RTU_WRITE: &[u8] = &[0x01, 0x05, 0x00, 0x03, 0xFF, 0x00, 0x7C, 0x3A];
const LC02_READ: &[u8] = &[0x4C, 0x57, 0x01, 0x03, 0x04, 0x0D];
const LC02_DATA: &[u8] = &[0x6C, 0x63, 0x01, 0x11, 0x22, 0x34, 0x0D];
const LC02_WRITE: &[u8] = &[0x4C, 0x57, 0x01, 0x04, 0x03, 0x01, 0x09, 0x0D];
const LC02_DONE: &[u8] = &[0x6C, 0x63, 0x01, 0x01, 0x0D];
const R55_READ: &[u8] = &[0x55, 0x01, 0x10, 0, 0, 0, 0, 0x66];
const R55_STATE: &[u8] = &[0x22, 0x01, 0x10, 0, 0, 0x03, 0x11, 0x47];
const R55_CLOSE: &[u8] = &[0x55, 0x01, 0x12, 0, 0, 0, 0x04, 0x6C];
const R55_CLOSED: &[u8] = &[0x22, 0x01, 0x12, 0, 0, 0x03, 0x11, 0x49];

/// All jobs. ASCII jobs use checksums, so that every protocol here has one.
pub const JOBS: &[Job] = &[
    Job {
        name: "rtu-server-read",
        received: RTU_READ,
        sent: RTU_BITS,
        learned: 0,
        ours: rtu_server,
        floor: floor::rtu_server_read,
    },
    Job {
        name: "rtu-server-write",
        received: RTU_WRITE,
        sent: RTU_WRITE,
        learned: 0x0103,
        ours: rtu_server,
        floor: floor::rtu_server_write,
    },
    Job {
        name: "rtu-client-read",
        received: RTU_BITS,
        sent: RTU_READ,
        learned: STATE,
        ours: rtu_client_read,
        floor: floor::rtu_client_read,
    },
    Job {
        name: "rtu-client-write",
        received: RTU_WRITE,
        sent: RTU_WRITE,
        learned: 1,
        ours: rtu_client_write,
        floor: floor::rtu_client_write,
    },
    Job {
        name: "any-client-read",
        received: RTU_BITS,
        sent: RTU_READ,
        learned: STATE,
        ours: any_client_read,
        floor: floor::rtu_client_read,
    },
    Job {
        name: "ascii-server-read",
        received: b"$016BB\r",
        sent: b"!11220047\r",
        learned: 0,
        ours: ascii_server,
        floor: floor::ascii_server_read,
    },
    Job {
        name: "ascii-server-write",
        received: b"#01130149\r",
        sent: b">3E\r",
        learned: 0x1301,
        ours: ascii_server,
        floor: floor::ascii_server_write,
    },
    Job {
        name: "ascii-client-read",
        received: b"!11220047\r",
        sent: b"$016BB\r",
        learned: 0x1122,
        ours: ascii_client_read,
        floor: floor::ascii_client_read,
    },
    Job {
        name: "ascii-client-write",
        received: b">3E\r",
        sent: b"#01130149\r",
        learned: 1,
        ours: ascii_client_write,
        floor: floor::ascii_client_write,
    },
    Job {
        name: "lc02-server-read",
        received: LC02_READ,
        sent: LC02_DATA,
        learned: 0,
        ours: lc02_server,
        floor: floor::lc02_server_read,
    },
    Job {
        name: "lc02-server-write",
        received: LC02_WRITE,
        sent: LC02_DONE,
        learned: 0x0103,
        ours: lc02_server,
        floor: floor::lc02_server_write,
    },
    Job {
        name: "lc02-client-read",
        received: LC02_DATA,
        sent: LC02_READ,
        learned: 0x1122,
        ours: lc02_client_read,
        floor: floor::lc02_client_read,
    },
    Job {
        name: "lc02-client-write",
        received: LC02_DONE,
        sent: LC02_WRITE,
        learned: 1,
        ours: lc02_client_write,
        floor: floor::lc02_client_write,
    },
    Job {
        name: "r55-server-read",
        received: R55_READ,
        sent: R55_STATE,
        learned: 0,
        ours: r55_server,
        floor: floor::r55_server_read,
    },
    Job {
        name: "r55-server-write",
        received: R55_CLOSE,
        sent: R55_CLOSED,
        learned: 0x0103,
        ours: r55_server,
        floor: floor::r55_server_write,
    },
    Job {
        name: "r55-client-read",
        received: R55_STATE,
        sent: R55_READ,
        learned: STATE,
        ours: r55_client_read,
        floor: floor::r55_client_read,
    },
    Job {
        name: "r55-client-write",
        received: R55_CLOSED,
        sent: R55_CLOSE,
        learned: STATE,
        ours: r55_client_write,
        floor: floor::r55_client_write,
    },
];

/// The module's own address, and the one the host uses.
fn one() -> Address {
    Address(black_box(1))
}

/// A write in one number: the state above, the channel below.
fn write_of(channel: u8, on: bool) -> u32 {
    u32::from(on) << 8 | u32::from(channel)
}

fn rtu_server(rx: &[u8], out: &mut Frame) -> Option<u32> {
    let asked = rtu::Exchange::decode_frame(rx).ok()?;
    if asked.address != one() {
        return None;
    }
    match asked.request {
        rtu::Request::ReadCoils(span) => {
            let bits = Bits::from_mask(black_box(STATE) >> span.start(), span.count())?;
            asked.encode_response(one(), &rtu::Response::Bits(bits), out);
            Some(0)
        }
        rtu::Request::WriteCoil { at, value } => {
            let on = value.state()?;
            asked.encode_response(one(), &rtu::Response::Done, out);
            Some(write_of(at as u8, on))
        }
        _ => None,
    }
}

fn rtu_client_read(rx: &[u8], out: &mut Frame) -> Option<u32> {
    let span = rtu::BitSpan::new(black_box(0), black_box(16))?;
    let exchange = rtu::Exchange {
        address: one(),
        request: rtu::Request::ReadCoils(span),
    };
    exchange.encode(out);
    match exchange.decode_response(rx).whole()?.response {
        rtu::Response::Bits(bits) => Some(bits.to_mask()),
        _ => None,
    }
}

fn any_client_read(rx: &[u8], out: &mut Frame) -> Option<u32> {
    let span = rtu::BitSpan::new(black_box(0), black_box(16))?;
    let exchange = Exchange::rtu(one(), rtu::Request::ReadCoils(span));
    exchange.encode(out);
    match exchange.decode_response(rx).whole()?.response {
        Response::Rtu(rtu::Response::Bits(bits)) => Some(bits.to_mask()),
        _ => None,
    }
}

fn rtu_client_write(rx: &[u8], out: &mut Frame) -> Option<u32> {
    let (at, value) = (black_box(3), rtu::CoilValue::ON);
    let exchange = rtu::Exchange {
        address: one(),
        request: rtu::Request::WriteCoil { at, value },
    };
    exchange.encode(out);
    match exchange.decode_response(rx).whole()?.response {
        rtu::Response::Done => Some(1),
        _ => None,
    }
}

fn ascii_server(rx: &[u8], out: &mut Frame) -> Option<u32> {
    const RULES: ascii::DecodeRules = ascii::DecodeRules {
        checksum: true,
        lower_case: false,
    };
    let Decoded::Whole { value: asked, .. } = ascii::Exchange::decode_request(rx, RULES) else {
        return None;
    };
    if asked.address != one() {
        return None;
    }
    match asked.request {
        ascii::Request::ReadData => {
            let (outputs, inputs) = (black_box(0x11), black_box(0x22));
            asked.encode_response(one(), &ascii::Response::Data { outputs, inputs }, out);
            Some(0)
        }
        ascii::Request::WriteOutputs { order, data } => {
            asked.encode_response(one(), &ascii::Response::Done, out);
            Some(u32::from(order) << 8 | u32::from(data))
        }
        _ => None,
    }
}

fn ascii(request: ascii::Request) -> ascii::Exchange {
    ascii::Exchange {
        address: one(),
        checksum: true,
        request,
    }
}

fn ascii_client_read(rx: &[u8], out: &mut Frame) -> Option<u32> {
    let exchange = ascii(ascii::Request::ReadData);
    exchange.encode(out);
    match exchange.decode_response(rx).whole()?.response {
        ascii::Response::Data { outputs, inputs } => {
            Some(u32::from(outputs) << 8 | u32::from(inputs))
        }
        _ => None,
    }
}

fn ascii_client_write(rx: &[u8], out: &mut Frame) -> Option<u32> {
    let (order, data) = (black_box(0x13), black_box(1));
    let exchange = ascii(ascii::Request::WriteOutputs { order, data });
    exchange.encode(out);
    match exchange.decode_response(rx).whole()?.response {
        ascii::Response::Done => Some(1),
        _ => None,
    }
}

fn lc02_server(rx: &[u8], out: &mut Frame) -> Option<u32> {
    let Decoded::Whole { value: asked, .. } = lc02::Exchange::decode_request(rx) else {
        return None;
    };
    if asked.address != one() {
        return None;
    }
    match asked.request {
        lc02::Request::ReadData => {
            let (outputs, inputs) = (black_box(0x11), black_box(0x22));
            asked.encode_response(one(), lc02::Response::Data { outputs, inputs }, out);
            Some(0)
        }
        lc02::Request::WriteOutputs(lc02::Outputs::One(channel, on)) => {
            asked.encode_response(one(), lc02::Response::Done, out);
            Some(write_of(channel.index(), on))
        }
        _ => None,
    }
}

fn lc02_client_read(rx: &[u8], out: &mut Frame) -> Option<u32> {
    let exchange = lc02::Exchange {
        address: one(),
        request: lc02::Request::ReadData,
    };
    exchange.encode(out);
    match exchange.decode_response(rx).whole()?.response {
        lc02::Response::Data { outputs, inputs } => {
            Some(u32::from(outputs) << 8 | u32::from(inputs))
        }
        _ => None,
    }
}

fn lc02_client_write(rx: &[u8], out: &mut Frame) -> Option<u32> {
    let outputs = lc02::Outputs::One(Channel::new(black_box(3))?, true);
    let exchange = lc02::Exchange {
        address: one(),
        request: lc02::Request::WriteOutputs(outputs),
    };
    exchange.encode(out);
    match exchange.decode_response(rx).whole()?.response {
        lc02::Response::Done => Some(1),
        _ => None,
    }
}

fn r55_server(rx: &[u8], out: &mut Frame) -> Option<u32> {
    let Decoded::Whole { value: asked, .. } = r55::Exchange::decode_request(rx) else {
        return None;
    };
    if asked.address() != one() {
        return None;
    }
    let state = r55::Response::word(black_box(STATE));
    match asked.request() {
        r55::Request::ReadState => {
            asked.encode_response(one(), state, out);
            Some(0)
        }
        r55::Request::Close(channel) => {
            asked.encode_response(one(), state, out);
            Some(write_of(channel.index(), true))
        }
        _ => None,
    }
}

fn r55_client_read(rx: &[u8], out: &mut Frame) -> Option<u32> {
    r55_client(r55::Request::ReadState, rx, out)
}

fn r55_client_write(rx: &[u8], out: &mut Frame) -> Option<u32> {
    r55_client(r55::Request::Close(Channel::new(black_box(3))?), rx, out)
}

fn r55_client(request: r55::Request, rx: &[u8], out: &mut Frame) -> Option<u32> {
    let exchange = r55::Exchange::new(one(), request);
    exchange.encode(out);
    Some(exchange.decode_response(rx).whole()?.response.to_word())
}

//! The 0x55/0x22 relay boards: up to 32 relays, inputs, or 16 of each.

use crate::datasheet::{
    Access, Datasheet, Factory, Key, PerProtocol, PulseTiming, Recognition, ScanEvidence,
    Separation, StoredSetting,
};
use crate::engine::DeviceState;
use crate::extensions;
use crate::{Bank, Family, Layout, Observation, Op, Profile, SettingWrite, Setup};
use railbus_wire::r55::{BROADCAST, Exchange, FRAME_LEN, Request, Response, U24};
use railbus_wire::{
    Address, Baud, Channel, Character, Decoded, Frame, Instant, Malformed, Micros, Protocol, Reply,
    SerialSettings,
};

/// The datasheet as data.
pub(crate) static PROFILE: Profile = Profile {
    name: "r55",
    model: "0x55 board",
    outputs: 32,
    inputs: 32,
    analogs: 0,
    protocols: &[Protocol::R55],
    bauds: &[(0, Baud::B9600)],
    characters: &[(0, Character::N1)],
    addresses: (1, 255),
    gap: None,
    output_label: ("k", 1),
    input_label: ("d", 1),
};

/// What only a host asks. The sheet has neither terminals nor ratings.
pub(crate) static DATASHEET: Datasheet = Datasheet {
    title: ["0x55 board", "0x55 继电器板"],
    names: &[],
    numbers: &[],
    signs: &[],
    recognition: PerProtocol::same(Recognition::ByBehaviour),
    refuses: false,
    evidence: ScanEvidence::HighestOn,
    // [R55 §3.4]
    channels_vary: true,
    // [R55 §4.1, §4.9]
    broadcast: Some(BROADCAST),
    // [R55 §1.5]; the sheet names no address.
    factory: Factory {
        address: Address(1),
        serial: SerialSettings::FACTORY,
        voltage: None,
    },
    serial_as_one: false,
    settings: &[
        // [R55 §4.6, §4.8]
        StoredSetting::new(Key::Address, Access::AtPowerUp),
        // [R55 §1.5]
        StoredSetting::new(Key::Baud, Access::Fixed),
    ],
    separation: PerProtocol::same(Separation::PowerUp),
    // [R55 §2.10, §2.11]
    pulses: PulseTiming::Command,
    // [R55 §4.8]
    dip_switch: true,
    init_pin: false,
    registers: &[],
    terminals: &[],
    notes: &[
        [
            "9600 8N1 always; up to 32 channels",
            "固定 9600 8N1；最多 32 路",
        ],
        // [R55 §2.12]
        [
            "Times pulses itself, up to 4 h 39 min",
            "模块自行计时点动，最长 4 小时 39 分",
        ],
        [
            "The address is stored, or set by DIP switch; a new one is taken within 10 s of \
             power-up",
            "地址为存储或拨码；上电 10 秒内才接受新地址",
        ],
    ],
};

/// How long after power-up an address can be written [R55 §4.6].
const ADDRESS_WINDOW: Micros = Micros::from_secs(10);
/// The number of variables of a programmable board in the simulator [R55 §5.3].
pub(crate) const VARIABLES: usize = match Family::ONLY {
    None | Some(Family::R55) => 32,
    Some(_) => 0,
};

/// Host side: the single exchange for an op. Every op except `WriteSilent` uses the form with a
/// reply.
pub(crate) fn exchange(setup: &Setup, op: &Op) -> Option<railbus_wire::Exchange<'static>> {
    let request = match *op {
        Op::ReadOutputs | Op::ReadInputs => Request::ReadState,
        // A board with variables has two distinguishable reads, and is polled for both.
        Op::Fence if setup.variables == 0 => Request::ReadAddress,
        Op::Write(bank) | Op::WriteSilent(bank) => write(setup, bank)?,
        Op::Toggle(mask) if mask == 0 || mask & !setup.output_mask() != 0 => return None,
        Op::Toggle(mask) => match single(mask) {
            Some(channel) => Request::Toggle(channel),
            None => Request::GroupToggle(mask),
        },
        Op::Jog { channel, .. } if channel.index() >= setup.outputs => return None,
        Op::Jog {
            channel,
            close,
            millis,
        } if close != setup.invert_on_off => Request::JogClose(channel, millis),
        Op::Jog {
            channel, millis, ..
        } => Request::JogOpen(channel, millis),
        Op::ReadVariable(index) if index < setup.variables => Request::ReadVariable(index),
        Op::WriteVariable(index, value) if index < setup.variables => {
            Request::WriteVariable(index, value)
        }
        Op::Configure(SettingWrite::Address(new)) => Request::WriteAddress(new),
        _ => return None,
    };
    let exchange = Exchange::new(setup.address, request);
    let exchange = match op {
        Op::WriteSilent(_) => exchange.without_reply()?,
        _ => exchange,
    };
    Some(railbus_wire::Exchange::R55(exchange))
}

/// The request that switches these outputs, if there is one: one relay, a group with one state, or
/// all.
fn write(setup: &Setup, bank: Bank) -> Option<Request> {
    let on = if setup.invert_on_off {
        !bank.on & bank.mask
    } else {
        bank.on
    };
    Some(match (single(bank.mask), on) {
        (Some(channel), 0) => Request::Open(channel),
        (Some(channel), _) => Request::Close(channel),
        (None, on) if bank.mask == setup.output_mask() => Request::SetAll(on),
        (None, 0) => Request::GroupOff(bank.mask),
        (None, on) if on == bank.mask => Request::GroupOn(bank.mask),
        (None, _) => return None,
    })
}

const fn single(mask: u32) -> Option<Channel> {
    if mask.count_ones() == 1 {
        Channel::new(mask.trailing_zeros() as u8)
    } else {
        None
    }
}

/// Host side: as much of a write as one frame can carry. All outputs, or those with the state of
/// the lowest one.
pub(crate) const fn group(setup: &Setup, want: Bank) -> Bank {
    let lowest = want.mask & want.mask.wrapping_neg();
    if want.mask == setup.output_mask() {
        want
    } else if want.on & lowest != 0 {
        Bank::new(want.on, want.on)
    } else {
        Bank::new(want.mask & !want.on, 0)
    }
}

/// Host side: decodes a reply. Commands are answered with the state after execution.
pub(crate) fn interpret(
    setup: &Setup,
    op: &Op,
    response: &railbus_wire::Response<'_>,
) -> Option<Observation> {
    let railbus_wire::Response::R55(response) = response else {
        return None;
    };
    Some(match *op {
        Op::ReadVariable(asked) | Op::WriteVariable(asked, _) => {
            let [.., index] = response.data;
            let value = U24::new(response.to_word() >> 8)?;
            if index != asked {
                return None;
            }
            Observation::Variable(index, value)
        }
        Op::Configure(_) => Observation::Done,
        _ => {
            let (outputs, inputs) = match setup.layout {
                Layout::Outputs => (response.to_word(), 0),
                Layout::Inputs => (0, response.to_word()),
                Layout::Mixed => (response.outputs().into(), response.inputs().into()),
            };
            let outputs = if setup.invert_on_off {
                !outputs
            } else {
                outputs
            };
            Observation::Channels {
                outputs: Bank::new(setup.output_mask(), outputs),
                inputs: Bank::new(setup.input_mask(), inputs),
            }
        }
    })
}

/// The address of the board that answered an address read: in D4, or in the address byte of a board
/// that leaves D4 empty [R55 §4.4].
#[must_use]
pub fn board_address(reply: &Reply<Response>) -> Option<Address> {
    let [.., low] = reply.response.data;
    match low {
        0 => reply.from.filter(|from| *from != BROADCAST),
        address => Some(Address(address)),
    }
}

/// Device side: the frame at the start of the received bytes. An unknown request with a good
/// checksum is still a frame, and nothing is searched for inside it [R55 §1.8].
pub(crate) fn decode_frame(heard: &[u8]) -> Decoded<Option<Exchange>> {
    match Exchange::decode_request(heard) {
        Decoded::Malformed(Malformed::Function | Malformed::Value) => Decoded::Whole {
            len: FRAME_LEN,
            value: None,
        },
        decoded => decoded.map(Some),
    }
}

/// Device side: executes a request and writes the reply; returns whether there is one.
pub(crate) fn answer(
    state: &mut DeviceState,
    now: Instant,
    exchange: &Exchange,
    reply: &mut Frame,
) -> bool {
    if !state.hears(exchange.address()) {
        return false;
    }
    let broadcast = exchange.address() == BROADCAST;
    let from = state.address();
    let extra = extensions::variable(state, now, exchange.address(), exchange.request());
    let response = extra.unwrap_or_else(|| carry_out(state, now, exchange.request()));
    let Some(response) = response else {
        return false;
    };
    let to_one = !broadcast || matches!(exchange.request(), Request::ReadAddress);
    let answers = exchange.expects_reply() && to_one;
    if answers {
        exchange.encode_response(from, response, reply);
    }
    answers
}

/// Executes a request; none if the board does not reply.
fn carry_out(state: &mut DeviceState, now: Instant, request: Request) -> Option<Response> {
    let all = state.setup.output_mask();
    let has = |channel: Channel| (channel.index() < state.setup.outputs).then_some(channel);
    match request {
        Request::ReadState => {}
        Request::Open(channel) => state.switch(has(channel)?.mask(), 0),
        Request::Close(channel) => state.switch(has(channel)?.mask(), all),
        Request::SetAll(on) => state.switch(all, on),
        Request::GroupOff(mask) => state.switch(mask, 0),
        Request::GroupOn(mask) => state.switch(mask, mask),
        Request::GroupToggle(mask) => state.switch(mask, !state.outputs),
        Request::Toggle(channel) => state.switch(has(channel)?.mask(), !state.outputs),
        Request::JogClose(channel, time) | Request::JogOpen(channel, time) => {
            let close = matches!(request, Request::JogClose(..));
            let time = Micros::from_millis(time.get().into());
            state.switch_for(now, has(channel)?, close, time);
        }
        Request::ReadAddress => return Some(Response::word(state.address().0.into())),
        Request::WriteAddress(new) => return readdress(state, now, new),
        Request::ReadVariable(index) => {
            return Some(Response::variable(
                index,
                U24::new(*variable(state, index)?)?,
            ));
        }
        Request::WriteVariable(index, value) => {
            *variable(state, index)? = value.get();
            return Some(Response::variable(index, value));
        }
    }
    Some(state_response(state))
}

/// The state in this board's layout.
const fn state_response(state: &DeviceState) -> Response {
    Response::word(match state.setup.layout {
        Layout::Outputs => state.outputs,
        Layout::Inputs => state.levels,
        Layout::Mixed => state.levels << 16 | state.outputs,
    })
}

/// Writes the address: only soon after power-up, and only if no DIP switch sets it
/// [R55 §4.6, §4.8].
fn readdress(state: &mut DeviceState, now: Instant, new: Address) -> Option<Response> {
    let in_window = now.since(state.started) <= ADDRESS_WINDOW;
    let allowed = new != Address(0) && new != BROADCAST;
    if !in_window || state.dip != 0 || !allowed {
        return None;
    }
    state.keep().address = new;
    Some(Response::word(new.0.into()))
}

/// A variable, on boards that have variables.
fn variable(state: &mut DeviceState, index: u8) -> Option<&mut u32> {
    let programmable = state.setup.variables > 0;
    let variable = state.variables.get_mut(usize::from(index));
    variable.filter(|_| programmable)
}

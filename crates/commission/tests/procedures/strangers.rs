//! Modules that are none of the five families are not written to, whatever they are taken for.

use railbus_commission::settings::Wanted;
use railbus_commission::{
    ChangeOrigin, DriverAction, Event, Job, ProcedureError, ProcedureStep, RxBytes, change,
};
use railbus_device::{Family, Setup};
use railbus_wire::{Address, Frame, Instant, Micros, Protocol, crc16};

/// Takes a slave for a module with that description and tries to set its address to 9; returns how
/// that ends.
fn configured(
    setup: Setup,
    slave: &dyn Fn(&[u8]) -> Option<Vec<u8>>,
) -> Result<(), ProcedureError> {
    let mut procedure = change(Job {
        change: 1,
        line: "main".to_owned(),
        module: "module".to_owned(),
        setup,
        wanted: Wanted::parse(&setup, ["address=9"]).unwrap(),
        neighbours: Vec::new(),
        by: ChangeOrigin::Set,
        undoes: None,
    });
    let (mut now, mut event) = (Instant(0), Event::Begin);
    loop {
        let act = match procedure.next(now, event) {
            ProcedureStep::Done(end) => return end.map(|_| ()),
            ProcedureStep::Do(act) => act,
        };
        now = now + Micros::from_millis(600);
        event = match act {
            DriverAction::Journal(record) => panic!("it is about to be written: {record:?}"),
            DriverAction::Ask(ask) => {
                let mut frame = Frame::new();
                ask.exchange.encode(&mut frame);
                let bytes = match frame.bytes().first() {
                    Some(first) if *first == setup.address.0 => slave(frame.bytes()),
                    _ => None,
                };
                let bytes = bytes.unwrap_or_default();
                Event::Heard(RxBytes {
                    bytes,
                    ..RxBytes::default()
                })
            }
            DriverAction::Wait(_) | DriverAction::Tell(_) => Event::Over,
            DriverAction::Confirm(_) => Event::Answer(true),
        };
    }
}

fn reply(address: u8, body: &[u8]) -> Vec<u8> {
    let mut frame = vec![address];
    frame.extend(body);
    frame.extend(crc16(&frame).to_le_bytes());
    frame
}

/// A device that has everything, or this much of it, or that does not answer for what it lacks.
fn plc(frame: &[u8], has: impl Fn(u8, u16, u16) -> bool, outside: Option<u8>) -> Option<Vec<u8>> {
    let word = |at: usize| u16::from_be_bytes([frame[at], frame[at + 1]]);
    let (address, function, start, count) = (frame[0], frame[1], word(2), word(4));
    let len = match function {
        1 | 2 => count.div_ceil(8),
        _ => 2 * count,
    };
    if !has(function, start, count) {
        return Some(reply(address, &[function | 0x80, outside?]));
    }
    let mut body = vec![function, len as u8];
    // Register 1 is its own address, with valid codes.
    let words = (start..).map(|at| [0, if at == 1 { u16::from(address) as u8 } else { 1 }]);
    match function {
        1 | 2 => body.extend(std::iter::repeat_n(0, len.into())),
        _ => body.extend(words.take(count.into()).flatten()),
    }
    Some(reply(address, &body))
}

#[test]
fn a_stranger_is_not_written_to() {
    let everything = |frame: &[u8]| plc(frame, |_, _, _| true, None);
    let hundred = |frame: &[u8]| plc(frame, |_, at, count| at + count <= 100, Some(2));
    let coils = |frame: &[u8]| {
        plc(
            frame,
            |function, at, count| function == 1 && at + count <= 100,
            Some(2),
        )
    };
    let eight = |frame: &[u8]| {
        plc(
            frame,
            |function, at, count| function == 1 && at + count <= 8,
            None,
        )
    };
    let ten = |frame: &[u8]| {
        plc(
            frame,
            |function, at, count| {
                function == 3 && at + count <= 8 || function == 1 && at + count <= 10
            },
            Some(2),
        )
    };
    let gateway = |frame: &[u8]| match frame[1..6] {
        [1, 0, 60, 0, 8] => Some(reply(frame[0], &[1, 1, 0])),
        _ => Some(reply(frame[0], &[frame[1] | 0x80, 0x0B])),
    };
    let silent = |frame: &[u8]| match frame[1..6] {
        [1, 0, 60, 0, 8] => Some(reply(frame[0], &[1, 1, 0])),
        _ => None,
    };
    type Slave<'a> = &'a dyn Fn(&[u8]) -> Option<Vec<u8>>;
    let strangers: [(&str, Slave<'_>); 7] = [
        ("everything", &everything),
        ("a hundred of all", &hundred),
        ("a hundred coils", &coils),
        ("eight coils, silent to all else", &eight),
        ("ten coils and eight registers", &ten),
        ("a gateway that reaches nobody", &gateway),
        ("silent but at 60", &silent),
    ];
    for family in [Family::Erc8, Family::Emd2a2q, Family::Eda9050] {
        let setup = Setup {
            protocol: Protocol::Rtu,
            ..Setup::new(family, Address(5))
        };
        for (what, slave) in strangers {
            let end = configured(setup, slave);
            assert!(
                matches!(
                    end,
                    Err(ProcedureError::WrongModel(..) | ProcedureError::NoReply(_))
                ),
                "{what}, taken for {family}: {end:?}"
            );
        }
    }
}

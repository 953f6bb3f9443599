//! Ops by themselves: banks of channels, and what no model has.

use railbus_device::{Bank, Family, Module, Op, SettingWrite, Setup};
use railbus_wire::{Address, Channel, Frame, Protocol, foreign_command, r55::U24};

/// States are known for the channels of the mask alone.
#[test]
fn a_bank_says_nothing_of_other_channels() {
    let channel = |index| Channel::new(index).expect("0 to 31");
    let bank = Bank::new(0b0110, 0b1100);
    assert_eq!(bank.on, 0b0100);
    let states = [0, 1, 2, 3].map(|index| bank.get(channel(index)));
    assert_eq!(states, [None, Some(false), Some(true), None]);
    for on in [true, false] {
        let one = Bank::one(channel(31), on);
        assert_eq!((one.mask, one.get(channel(31))), (1 << 31, Some(on)));
        assert_eq!(one.get(channel(30)), None);
    }
}

#[test]
fn some_ops_only_read() {
    let reads = [
        Op::ReadOutputs,
        Op::ReadInputs,
        Op::ReadAnalogs,
        Op::ReadVariable(0),
        Op::ReadPulse,
        Op::Identify,
        Op::ReadConfig,
    ];
    assert!(reads.iter().all(Op::is_read));
    let millis = U24::new(1).expect("24 bits");
    let jog = Op::Jog {
        channel: Channel::MAX,
        close: true,
        millis,
    };
    let writes = [
        Op::Write(Bank::new(1, 1)),
        Op::WriteSilent(Bank::new(1, 1)),
        Op::Toggle(1),
        jog,
        Op::WriteVariable(0, millis),
        Op::Configure(SettingWrite::Restore),
    ];
    assert!(!writes.iter().any(Op::is_read));
}

#[test]
fn what_a_model_can_not_do_is_said_in_words() {
    let setup = Setup::new(Family::Erc8, Address(1));
    let module = Module::new(setup).expect("a possible module");
    let text = module
        .exchange(&Op::ReadInputs)
        .map_err(|why| why.to_string());
    assert_eq!(text, Err("this model has no command for that".to_owned()));
}

/// What a line asks by itself is no request of another protocol, at no address: on a mixed line it
/// is never refused, and so a silent module is always checked.
#[test]
fn what_is_asked_again_and_again_is_no_request_of_another_protocol() {
    let mut frames = 0;
    let setups = Family::ALL.into_iter().flat_map(|family| {
        let protocols = Protocol::ALL.into_iter();
        protocols.flat_map(move |protocol| {
            (0..=u8::MAX).flat_map(move |address| {
                [false, true].map(|checksum| Setup {
                    protocol,
                    checksum,
                    variables: if family == Family::R55 { 32 } else { 0 },
                    ..Setup::new(family, Address(address))
                })
            })
        })
    });
    for module in setups.filter_map(|setup| Module::new(setup).ok()) {
        let own = module.setup().protocol;
        let asked = module.full_poll().chain(module.on_online_op());
        for op in asked.chain([Op::Identify, Op::Fence]) {
            let Ok(exchange) = module.exchange(&op) else {
                continue;
            };
            let mut frame = Frame::new();
            exchange.encode(&mut frame);
            let other = foreign_command(frame.bytes(), own, Protocol::ALL);
            assert_eq!(other, None, "{op:?} of {:?}", module.setup());
            frames += 1;
        }
    }
    assert!(frames > 15_000, "{frames}");
}

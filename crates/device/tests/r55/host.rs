//! The host's half: ops, replies, and boards whose on and off are swapped.

use super::*;

/// [R55 §3.5] the host ignores bits above the count.
#[test]
fn the_host_ignores_bits_above_the_count() {
    use Layout::{Inputs, Mixed, Outputs};
    for (setup, outputs, inputs) in [
        (setup(Outputs, 3, 0), 0b111, 0),
        (setup(Inputs, 0, 3), 0, 0b111),
        (setup(Mixed, 1, 2), 0b1, 0b11),
    ] {
        let seen = seen(&host(setup), &Op::ReadOutputs, &reply(0x10, u32::MAX));
        let expected = Observation::Channels {
            outputs: Bank::new(outputs, outputs),
            inputs: Bank::new(inputs, inputs),
        };
        assert_eq!(seen, expected);
    }
}

/// [R55 §2.2] the function that the host takes for each op: one relay, all, or a group of one
/// state. [R55 §3.9] with `invert_on_off` the other one of each pair, and the other word.
#[test]
fn the_host_asks() {
    let relay = |index| Channel::new(index).expect("a relay");
    let jog = |close| Op::Jog {
        channel: relay(2),
        close,
        millis: U24::new(1000).expect("a time"),
    };
    let write = |mask, on| Op::Write(Bank::new(mask, on));
    let table = [
        (write(0x80, 0x80), "12 00000008", "11 00000008"),
        (write(0x01, 0x00), "11 00000001", "12 00000001"),
        (write(0xFF, 0xA5), "13 000000A5", "13 0000005A"),
        (write(0xFF, 0xFF), "13 000000FF", "13 00000000"),
        (write(0x03, 0x00), "14 00000003", "15 00000003"),
        (write(0x81, 0x81), "15 00000081", "14 00000081"),
        (jog(true), "21 0003E8 03", "22 0003E8 03"),
        (jog(false), "22 0003E8 03", "21 0003E8 03"),
        (Op::Toggle(0x04), "20 00000003", "20 00000003"),
        (Op::Toggle(0x84), "16 00000084", "16 00000084"),
        (Op::Toggle(0xFF), "16 000000FF", "16 000000FF"),
        (Op::ReadOutputs, "10 00000000", "10 00000000"),
        (Op::ReadInputs, "10 00000000", "10 00000000"),
        (
            Op::WriteSilent(Bank::new(0x80, 0x80)),
            "32 00000008",
            "31 00000008",
        ),
        (
            Op::WriteSilent(Bank::new(0xFF, 0x0F)),
            "33 0000000F",
            "33 000000F0",
        ),
        (
            Op::WriteSilent(Bank::new(0x03, 0)),
            "34 00000003",
            "35 00000003",
        ),
        (
            Op::Configure(SettingWrite::Address(Address(7))),
            "41 00000007",
            "41 00000007",
        ),
    ];
    let straight = setup(Layout::Outputs, 8, 0);
    let inverted = Setup {
        invert_on_off: true,
        ..straight
    };
    for (op, text, inverted_text) in table {
        for (setup, text) in [(straight, text), (inverted, inverted_text)] {
            let expected = Some(frame(&format!("01 {text}")));
            assert_eq!(request(&host(setup), &op), expected, "{op:?}");
        }
    }
    let none = [
        write(0x03, 0x01),
        write(0x100, 0x100),
        write(0, 0),
        Op::Toggle(0),
        Op::Toggle(0x100),
        Op::Jog {
            channel: relay(8),
            close: true,
            millis: U24::new(1).expect("a time"),
        },
        Op::ReadAnalogs,
        Op::ReadVariable(0),
        Op::ReadConfig,
    ];
    for op in none {
        assert_eq!(request(&host(straight), &op), None, "{op:?}");
    }
}

/// Of a request that takes two frames the lowest relay's state comes first, whatever it is.
#[test]
fn the_host_groups() {
    let host = host(setup(Layout::Outputs, 8, 0));
    let table = [
        ((0b0110, 0b0100), (0b0010, 0b0000)),
        ((0b0110, 0b0010), (0b0010, 0b0010)),
        ((0b1110, 0b1010), (0b1010, 0b1010)),
        ((0b1110, 0b0100), (0b1010, 0b0000)),
        ((0xFF, 0b0100), (0xFF, 0b0100)),
    ];
    for ((mask, on), (first, on_first)) in table {
        let group = host.group(Bank::new(mask, on));
        assert_eq!(group, Bank::new(first, on_first), "{mask:b}, {on:b}");
    }
}

/// [R55 §3.9] on and off change places in states too, those of inputs not.
#[test]
fn the_host_inverts_states() {
    let mixed = setup(Layout::Mixed, 4, 4);
    let inverted = Setup {
        invert_on_off: true,
        ..mixed
    };
    for (setup, outputs) in [(mixed, 0b0011), (inverted, 0b1100)] {
        let seen = seen(&host(setup), &Op::ReadOutputs, &reply(0x10, 0x0005_0003));
        let expected = Observation::Channels {
            outputs: Bank::new(0b1111, outputs),
            inputs: Bank::new(0b1111, 0b0101),
        };
        assert_eq!(seen, expected);
    }
}

/// [R55 §3.8] a toggle or jog is never repeated blindly; what was commanded is read back with 10.
#[test]
fn the_host_reads_back() {
    let host = host(Setup {
        variables: 1,
        ..setup(Layout::Outputs, 8, 0)
    });
    let millis = U24::new(1000).expect("a time");
    let channel = Channel::MAX;
    let table = [
        (Op::Write(Bank::new(1, 1)), true, Some(Op::ReadOutputs)),
        (
            Op::WriteSilent(Bank::new(1, 1)),
            true,
            Some(Op::ReadOutputs),
        ),
        (Op::Toggle(1), false, Some(Op::ReadOutputs)),
        (
            Op::Jog {
                channel,
                close: true,
                millis,
            },
            false,
            Some(Op::ReadOutputs),
        ),
        (
            Op::WriteVariable(0, millis),
            true,
            Some(Op::ReadVariable(0)),
        ),
        (
            Op::Configure(SettingWrite::Address(Address(2))),
            false,
            None,
        ),
        (Op::ReadOutputs, true, None),
    ];
    for (op, repeatable, read_back) in table {
        assert_eq!(host.repeatable(&op), repeatable, "{op:?}");
        assert_eq!(host.read_back(&op), read_back, "{op:?}");
    }
}

/// [R55 §4.10] the new address in the reply to 41 is no state of outputs.
#[test]
fn the_host_takes_no_address_for_a_state() {
    let host = host(setup(Layout::Outputs, 8, 0));
    let change = Op::Configure(SettingWrite::Address(Address(7)));
    assert_eq!(seen(&host, &change, &reply(0x41, 7)), Observation::Done);
}

/// [R55 §5.1] what the host makes of a variable, and of the reply for another one.
#[test]
fn the_host_reads_variables() {
    let host = host(Setup {
        variables: 32,
        ..setup(Layout::Outputs, 8, 0)
    });
    let value = U24::new(0xABCDEF).expect("24 bits");
    let write = Op::WriteVariable(3, value);
    assert_eq!(request(&host, &write), Some(frame("01 71 ABCDEF 03")));
    assert_eq!(
        request(&host, &Op::ReadVariable(3)),
        Some(frame("01 70 00000003"))
    );
    let seen_value = Observation::Variable(3, value);
    assert_eq!(seen(&host, &write, &reply(0x71, 0xABCD_EF03)), seen_value);
    let read = Op::ReadVariable(3);
    assert_eq!(seen(&host, &read, &reply(0x70, 0xABCD_EF03)), seen_value);
    assert_eq!(
        seen(&host, &read, &reply(0x70, 0xABCD_EF04)),
        Observation::Unexpected
    );
}

/// [R55 §3.7] the host expects nothing after a twin, and a reply after everything else.
#[test]
fn the_host_waits_for_replies() {
    let host = host(setup(Layout::Outputs, 8, 0));
    let silent = Op::WriteSilent(Bank::new(1, 1));
    for (op, waits) in [(Op::Write(Bank::new(1, 1)), true), (silent, false)] {
        let exchange: Exchange<'_> = host.exchange(&op).expect("an op of a board");
        assert_eq!(exchange.expects_reply(), waits);
    }
}

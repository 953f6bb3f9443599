//! What the two modules of Nanjing Yingleike have in common: register maps shifted by one,
//! when settings act, exceptions, and the switches of the simulated module.

mod support;

use railbus_device::{Applies, Eeprom, Effect, Family, Input, Options, Setup};
use railbus_wire::{Address, Baud, Character, Exchange, Instant, Micros, SerialSettings, rtu};
use support::{Bench, hex, with_crc};

/// Where the maps of the two differ.
#[derive(Clone, Copy)]
struct Sister {
    family: Family,
    first_coil: u16,
    /// Address; speed and parity are the next two.
    first_register: u16,
    rates: &'static [u32],
    gap_millis: u64,
}

const ERC8: Sister = Sister {
    family: Family::Erc8,
    first_coil: 60,
    first_register: 0,
    rates: &[4800, 9600, 19200, 38400],
    gap_millis: 20,
};

const EMD2A2Q: Sister = Sister {
    family: Family::Emd2a2q,
    first_coil: 8,
    first_register: 1,
    rates: &[2400, 4800, 9600, 19200, 38400],
    gap_millis: 10,
};

const BOTH: [Sister; 2] = [ERC8, EMD2A2Q];
const PARITIES: [Character; 3] = [Character::N1, Character::O1, Character::E1];

impl Sister {
    fn at(self, address: u8) -> Bench {
        self.with(address, Options::default())
    }

    fn with(self, address: u8, options: Options) -> Bench {
        let setup = Setup::new(self.family, Address(address));
        Bench::with(setup, Eeprom::of(&setup), options)
    }

    /// The first relay is switched on.
    fn on(self, address: u8) -> String {
        format!("{address:02X} 05 {:04X} FF00", self.first_coil)
    }

    /// The first relay is read.
    fn read(self, address: u8) -> String {
        format!("{address:02X} 01 {:04X} 0001", self.first_coil)
    }

    /// A setting is written: 0 address, 1 speed, 2 parity.
    fn set(self, address: u8, setting: u16, value: u16) -> String {
        let at = self.first_register + setting;
        format!("{address:02X} 06 {at:04X} {value:04X}")
    }

    /// The three settings as FC03 reads them.
    fn settings(self, module: &mut Bench, address: u8) -> Option<Vec<u8>> {
        let at = self.first_register;
        let reply = module.ask_rtu(&format!("{address:02X} 03 {at:04X} 0003"))?;
        Some(reply[3..].to_vec())
    }
}

/// [ERC-8 §1.8, §1.9, EMD-2A2Q §1.8, §1.9] relays are released at power-up, and the LED is on.
#[test]
fn at_power_up() {
    for sister in BOTH {
        let mut module = sister.at(1);
        let lit = (Instant(1_000_000), Effect::Led(true));
        assert_eq!(
            (module.engine.outputs(), &module.effects[..]),
            (0, &[lit][..])
        );
        module.ask_rtu(&sister.on(1));
        assert_eq!(module.engine.outputs(), 1);
        assert_eq!(module.did().len(), 1, "the LED stays on");
        module.power_cycle();
        assert_eq!(module.engine.outputs(), 0);
        assert_eq!(module.ask_rtu(&sister.read(1)), Some(hex("01 01 01 00")));
    }
}

/// [ERC-8 §1.4, §1.5, §4.2, §4.3, §4.7, EMD-2A2Q §1.4, §1.5, §4.3, §4.4, §4.9] the codes of speed
/// and parity; as shipped 9600 without parity.
#[test]
fn speeds_and_parities_are_written() {
    for sister in BOTH {
        let mut module = sister.at(1);
        let code_of_9600 = sister.rates.iter().position(|rate| *rate == 9600);
        let as_shipped = [0, 1, 0, code_of_9600.expect("one") as u8, 0, 0];
        assert_eq!(sister.settings(&mut module, 1), Some(as_shipped.to_vec()));
        for (code, rate) in (0u8..).zip(sister.rates) {
            for (parity, character) in (0u8..).zip(PARITIES) {
                module.ask_rtu(&sister.set(1, 1, code.into()));
                module.ask_rtu(&sister.set(1, 2, parity.into()));
                let baud = Baud::from_rate(*rate).expect("a speed");
                let active = module.engine.active().serial;
                assert_eq!(active, SerialSettings { baud, character });
                let read = sister.settings(&mut module, 1);
                assert_eq!(read, Some(vec![0, 1, 0, code, 0, parity]));
            }
        }
        for wrong in [sister.rates.len() as u16, 0x0100, 0xFFFF] {
            module.refuses(&sister.set(1, 1, wrong), 3);
        }
        for wrong in [3, 0x0101] {
            module.refuses(&sister.set(1, 2, wrong), 3);
        }
    }
}

/// [ERC-8 §4.4, EMD-2A2Q §4.10] a new setting is kept when the request has been understood, and
/// acts when the reply has left; each is told once.
#[test]
fn settings_act_after_the_reply() {
    for sister in BOTH {
        let mut module = sister.at(1);
        module.wait(50);
        module.did();
        module.send(&with_crc(&hex(&sister.set(1, 2, 2))));
        let understood = module.now + SerialSettings::FACTORY.t3_5();
        let left = understood + SerialSettings::FACTORY.frame_time(8);
        let reply = module.run_until(left + Micros(1));
        assert!(reply.is_some());
        let even = SerialSettings {
            character: Character::E1,
            ..SerialSettings::FACTORY
        };
        let kept = Eeprom {
            serial: even,
            ..Eeprom::of(&module.setup)
        };
        module.wait(1000);
        assert_eq!(
            module.did(),
            [
                (understood, Effect::Save(kept)),
                (left, Effect::Serial(even)),
            ]
        );
        // Writing it again changes nothing.
        module.ask_rtu(&sister.set(1, 2, 2));
        assert_eq!(module.did(), []);
    }
}

/// [ERC-8 §4.5, §4.12, EMD-2A2Q §4.11, §4.15] with `config_applies` = after restart a setting is
/// acknowledged, stored and read back, and the old one is in force until the next power-up.
#[test]
fn settings_act_after_restart() {
    for sister in BOTH {
        let applies = Applies::AfterRestart;
        let mut module = sister.with(
            6,
            Options {
                applies,
                ..Options::default()
            },
        );
        for (setting, value) in [(1, 3), (2, 1), (0, 7)] {
            let write = sister.set(6, setting, value);
            assert_eq!(module.ask_rtu(&write), Some(hex(&write)));
        }
        let stored = Some(vec![0, 7, 0, 3, 0, 1]);
        assert_eq!(sister.settings(&mut module, 6), stored);
        assert_eq!(module.engine.active().serial, SerialSettings::FACTORY);
        assert!(
            !module
                .did()
                .iter()
                .any(|(_, effect)| matches!(effect, Effect::Serial(_)))
        );

        module.power_cycle();
        assert_eq!(sister.settings(&mut module, 6), None);
        assert_eq!(sister.settings(&mut module, 7), stored);
        assert_eq!(module.engine.active(), module.engine.eeprom());
    }
}

#[test]
fn the_address_alone_may_act_at_once() {
    for sister in BOTH {
        let applies = Applies::AddressAfterReply;
        let mut module = sister.with(
            6,
            Options {
                applies,
                ..Options::default()
            },
        );
        module.ask_rtu(&sister.set(6, 1, 3));
        module.ask_rtu(&sister.set(6, 0, 7));
        assert_eq!(
            sister.settings(&mut module, 7),
            Some(vec![0, 7, 0, 3, 0, 0])
        );
        assert_eq!(module.engine.active().serial, SerialSettings::FACTORY);
        module.power_cycle();
        assert_ne!(module.engine.active().serial, SerialSettings::FACTORY);
    }
}

/// [ERC-8 §4.9, EMD-2A2Q §4.12] settings survive power-off, relays do not; what the module was
/// told to save last is what it wakes up with.
#[test]
fn settings_survive_power_off() {
    for sister in BOTH {
        let mut module = sister.at(6);
        module.ask_rtu(&sister.on(6));
        for (setting, value) in [(0, 9), (1, 0), (2, 2)] {
            let address = module.engine.active().address.0;
            module.ask_rtu(&sister.set(address, setting, value));
        }
        let saved = module
            .did()
            .into_iter()
            .rev()
            .find_map(|(_, effect)| match effect {
                Effect::Save(eeprom) => Some(eeprom),
                _ => None,
            });
        assert_eq!(saved, Some(*module.engine.eeprom()));
        module.power_cycle();
        assert_eq!(
            sister.settings(&mut module, 9),
            Some(vec![0, 9, 0, 0, 0, 2])
        );
        assert_eq!(module.engine.outputs(), 0);
    }
}

/// [ERC-8 §1.10, EMD-2A2Q §1.10] with "insist on the gap" a request less than 20 or 10 ms behind
/// other traffic is not heard, and by default it is.
#[test]
fn a_module_may_insist_on_the_gap() {
    let foreign = with_crc(&hex("1F 03 0000 0001"));
    for sister in BOTH {
        let gap = sister.gap_millis * 1000;
        let table = [
            (true, gap - 100, false),
            (true, gap - 1, false),
            (true, gap, true),
            (false, gap - 100, true),
            (false, 4_000, true),
        ];
        for (insist_on_gap, silence, heard) in table {
            let options = Options {
                insist_on_gap,
                ..Options::default()
            };
            let mut module = sister.with(1, options);
            assert_eq!(module.ask(&foreign), None);
            module.send(&foreign);
            assert_eq!(module.run_until(module.now + Micros(silence)), None);
            module.send(&with_crc(&hex(&sister.on(1))));
            let reply = module.run_until(module.now + Micros::from_millis(100));
            let outputs = module.engine.outputs();
            let context = format!("{} after {silence} µs", sister.family);
            assert_eq!((reply.is_some(), outputs == 1), (heard, heard), "{context}");
        }
        // Its own reply is traffic too.
        let options = Options {
            insist_on_gap: true,
            ..Options::default()
        };
        let mut module = sister.with(1, options);
        module.wait(50);
        module.send(&with_crc(&hex(&sister.read(1))));
        let left =
            module.now + SerialSettings::FACTORY.t3_5() + SerialSettings::FACTORY.frame_time(6);
        assert!(module.run_until(left + Micros(gap - 100)).is_some());
        module.send(&with_crc(&hex(&sister.on(1))));
        assert_eq!(
            module.run_until(module.now + Micros::from_millis(100)),
            None
        );
        assert_eq!(module.engine.outputs(), 0);
    }
}

/// A reply begins when silence has ended the request and the turnaround has passed.
#[test]
fn turnaround() {
    for sister in BOTH {
        for turnaround in [Micros::ZERO, Micros::from_millis(7)] {
            let mut module = sister.with(
                1,
                Options {
                    turnaround,
                    ..Options::default()
                },
            );
            module.wait(50);
            module.send(&with_crc(&hex(&sister.read(1))));
            let begins = module.now + SerialSettings::FACTORY.t3_5() + turnaround;
            assert_eq!(module.run_until(Instant(begins.0 - 1)), None);
            assert!(module.run_until(begins).is_some());
        }
    }
}

/// Characters may be fed one by one or in pieces; only silence inside the frame breaks it.
#[test]
fn a_request_in_pieces() {
    for sister in BOTH {
        let request = with_crc(&hex(&sister.on(1)));
        for cut in 1..=request.len() {
            for (pause, heard) in [(0, true), (2_600, true), (3_700, cut == request.len())] {
                let mut module = sister.at(1);
                module.wait(50);
                let (first, second) = request.split_at(cut);
                hand_in(&mut module, first);
                let silence = module.now + Micros(pause);
                let reply = module.run_until(silence);
                let reply = reply.or_else(|| {
                    hand_in(&mut module, second);
                    module.run_until(module.now + Micros::from_millis(100))
                });
                let expected = heard.then(|| request.clone());
                assert_eq!(reply, expected, "cut at {cut}, pause of {pause} µs");
            }
        }
    }
}

/// Characters that are fed together when the last one has ended.
fn hand_in(module: &mut Bench, piece: &[u8]) {
    module.now = module.now + SerialSettings::FACTORY.frame_time(piece.len());
    module.engine.handle(module.now, Input::Bytes(piece));
}

/// [ERC-8 §5.8, EMD-2A2Q §6.5] a frame with a wrong CRC or a parity error gets no reply.
/// [ERC-8 §5.9, EMD-2A2Q §6.6] with the switch on, 08 and 04, to the module's own address only.
#[test]
fn damaged_frames() {
    for sister in BOTH {
        let damaged = |address| {
            let mut frame = with_crc(&hex(&sister.on(address)));
            *frame.last_mut().expect("a CRC") ^= 0x01;
            frame
        };
        let mut silent = sister.at(1);
        silent.ignores(&damaged(1));
        assert_eq!(with_bad_byte(&mut silent, &sister.on(1), 7), None);
        assert_eq!(silent.engine.outputs(), 0);

        let answer_bad_frames = true;
        let mut loud = sister.with(
            1,
            Options {
                answer_bad_frames,
                ..Options::default()
            },
        );
        let exception = |code| Some(with_crc(&[0x01, 0x85, code]));
        assert_eq!(loud.ask(&damaged(1)), exception(8));
        for damaged_at in 2..8 {
            let reply = with_bad_byte(&mut loud, &sister.on(1), damaged_at);
            assert_eq!(reply, exception(4), "byte {damaged_at}");
        }
        // The frame's address is unknown, or known to be another module's.
        for damaged_at in [0, 1] {
            assert_eq!(with_bad_byte(&mut loud, &sister.on(1), damaged_at), None);
        }
        for address in [0, 2] {
            loud.ignores(&damaged(address));
            assert_eq!(with_bad_byte(&mut loud, &sister.on(address), 7), None);
        }
        assert_eq!((loud.engine.outputs(), loud.did()), (0, vec![]));
        assert!(
            loud.ask_rtu(&sister.on(1)).is_some(),
            "the next one is heard"
        );
    }
}

/// Sends a request of which one byte arrives damaged.
fn with_bad_byte(module: &mut Bench, text: &str, at: usize) -> Option<Vec<u8>> {
    let frame = with_crc(&hex(text));
    module.wait(50);
    module.send(&frame[..at]);
    let end = module.now + SerialSettings::FACTORY.frame_time(1);
    assert_eq!(module.run_until(end), None);
    module.engine.handle(end, Input::BadByte);
    module.send(&frame[at + 1..]);
    module.run_until(module.now + Micros::from_millis(100))
}

/// [ERC-8 §5.1, EMD-2A2Q §6.3] an exception has five bytes with its CRC.
/// [ERC-8 §5.2, EMD-2A2Q §6.3] the three bytes that are printed are no reply, unless they are
/// read by the function that is for them alone.
#[test]
fn exceptions_with_and_without_crc() {
    let mut module = ERC8.at(1);
    let missing = "01 01 0000 0001";
    let reply = hex("01 81 02 C1 91");
    assert_eq!(module.ask(&with_crc(&hex(missing))), Some(reply.clone()));
    assert_eq!(
        EMD2A2Q.at(1).ask(&with_crc(&hex(missing))),
        Some(reply.clone())
    );

    let span = rtu::BitSpan::new(0, 1).expect("one coil");
    let request = rtu::Exchange {
        address: Address(1),
        request: rtu::Request::ReadCoils(span),
    };
    let exchange = Exchange::Rtu(request);
    assert!(exchange.decode_response(&reply).whole().is_some());
    for bare in ["01 81 02", "01 81 02 00 00", "01 81 02 FF FF"] {
        assert_eq!(exchange.decode_response(&hex(bare)).whole(), None);
    }
    let bare = [
        ("01 81 02", Some(rtu::Exception::ADDRESS)),
        ("01 81 08", Some(rtu::Exception::CHECKSUM)),
        ("02 81 02", None),
        ("01 82 02", None),
        ("01 01 02", None),
        ("01 81", None),
        ("01 81 02 C1", None),
    ];
    for (bytes, expected) in bare {
        assert_eq!(
            request.decode_bare_exception(&hex(bytes)),
            expected,
            "{bytes}"
        );
    }
}

/// [ERC-8 §5.3, §5.4, §5.6, §5.7, EMD-2A2Q §6.4] what the codes mean, by a request that earns
/// each; nothing changes for any of them.
#[test]
fn codes_of_exceptions() {
    for sister in BOTH {
        let mut module = sister.at(1);
        let coil = sister.first_coil;
        let table = [
            // A function that there is not.
            ("01 08 0000 0000".to_owned(), 1),
            // A start that there is not, and a run that leaves the map.
            (format!("01 05 {:04X} FF00", coil - 1), 2),
            (format!("01 01 {coil:04X} 0009"), 2),
            // A run past the last of all coils.
            ("01 01 FFFF 0002".to_owned(), 2),
            // A value, a quantity and a byte count out of range, and a setting.
            (format!("01 05 {coil:04X} 0001"), 3),
            (format!("01 01 {coil:04X} 0000"), 3),
            (format!("01 0F {coil:04X} 0002 02 03 00"), 3),
            (sister.set(1, 2, 3), 3),
            // Function before value, value before address.
            ("01 02 0000 0000".to_owned(), 1),
            ("01 04 0000 007E".to_owned(), 1),
            ("01 01 0000 0000".to_owned(), 3),
            ("01 05 0000 1234".to_owned(), 3),
        ];
        for (request, code) in table {
            module.refuses(&request, code);
        }
        let answer_bad_frames = true;
        let mut loud = sister.with(
            1,
            Options {
                answer_bad_frames,
                ..Options::default()
            },
        );
        let failed = with_bad_byte(&mut loud, &sister.on(1), 7);
        assert_eq!(failed, Some(with_crc(&[0x01, 0x85, 4])));
    }
    let meanings = [
        (1, "01 illegal function"),
        (2, "02 illegal data address"),
        (3, "03 illegal data value"),
        (4, "04 device failure"),
        (8, "08 checksum or memory parity error"),
    ];
    for (code, text) in meanings {
        assert_eq!(rtu::Exception(code).to_string(), text);
    }
}

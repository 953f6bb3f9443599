//! The demo line answers as the datasheets say.

mod support;

use railbus_sim::demo::{Demo, gate_inputs, pump_inputs, tank_analogs};
use railbus_sim::{Input, Output, VirtualLineConfig};
use railbus_wire::{Instant, Micros, SerialSettings, crc16};
use support::{hex, show};

struct Host {
    demo: Demo,
    now: Instant,
}

impl Host {
    fn new() -> Host {
        let demo =
            Demo::new(Instant(0), VirtualLineConfig::default()).expect("five possible modules");
        let mut host = Host {
            demo,
            now: Instant(0),
        };
        host.run_until(Instant(100_000));
        host
    }

    fn ask(&mut self, bytes: &[u8]) -> Vec<u8> {
        let settings = SerialSettings::FACTORY;
        self.demo.handle(self.now, Input::Send { bytes, settings });
        self.run_until(self.now + Micros::from_millis(200))
    }

    fn ask_hex(&mut self, text: &str) -> String {
        show(&self.ask(&hex(text)))
    }

    fn run_until(&mut self, end: Instant) -> Vec<u8> {
        let mut heard = Vec::new();
        loop {
            let at = match self.demo.poll() {
                Output::Heard { bytes, .. } => {
                    heard.extend_from_slice(bytes);
                    continue;
                }
                Output::Effect { .. } => continue,
                Output::Wait(at) => at.expect("the inputs go on moving"),
            };
            if at > end {
                self.now = end;
                return heard;
            }
            self.now = at;
            self.demo.handle(at, Input::Timeout);
        }
    }
}

#[test]
fn all_five_answer() {
    let mut host = Host::new();
    // The name of the EDA9060A is 9060 [EDA9060A §1.2].
    assert_eq!(host.ask(b"$01M\r"), b"!019060\r");
    assert_eq!(
        host.ask_hex("4C 57 02 03 05 0D"),
        "6C 63 02 00 7F 81 0D",
        "EDA9050"
    );
    assert_eq!(
        host.ask_hex("03 05 00 3C FF 00 4D D4"),
        "03 05 00 3C FF 00 4D D4",
        "ERC-8"
    );
    assert_eq!(
        host.ask_hex("55 04 12 00 00 00 01 6C"),
        "22 04 12 00 00 00 01 39",
        "0x55 board"
    );
    assert_eq!(
        host.ask_hex("05 01 00 08 00 02 3D 8D"),
        "05 01 01 00 50 B8",
        "EMD-2A2Q"
    );
}

#[test]
fn the_inputs_are_what_the_functions_of_time_say() {
    let mut host = Host::new();
    for seconds in [1, 4, 17, 33, 61, 140] {
        let now = Instant(seconds * 1_000_000 + 50_000);
        host.run_until(now);
        let pump = host.ask(b"$016\r");
        assert_eq!(pump, format!("!00{:02X}00\r", pump_inputs(now)).as_bytes());
        host.run_until(now + Micros::from_millis(300));
        let gate = host.ask(b"LW\x02\x03\x05\r");
        assert_eq!(u32::from(gate[4]), gate_inputs(now));
        host.run_until(now + Micros::from_millis(600));
        let mut request = vec![5, 3, 0, 6, 0, 2];
        request.extend(crc16(&request).to_le_bytes());
        let tank = host.ask(&request);
        let words = [&tank[3..5], &tank[5..7]].map(|word| i16::from_be_bytes([word[0], word[1]]));
        let then = Instant(seconds * 1_000_000 + 600_000);
        assert_eq!(words, tank_analogs(then), "at {seconds} s");
    }
}

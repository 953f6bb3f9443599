//! Plants in virtual time: by file, by flag and by prompt, to the byte and the microsecond.

use super::Stage;
use crate::orders::{Directory, Order};
use crate::{answers, plant};
use railbus_sim::{Input, Output};
use railbus_site::Config;
use railbus_wire::{Baud, Character, Instant, Micros, SerialSettings};
use railbus_words::Lang;

const PLANT: &str = r#"
[line.main]
port = "pty:/tmp/x"
[module.pump]
line = "main"
model = "eda9060a"
address = 1
[module.gate]
line = "main"
model = "eda9050"
address = 2
[module.oven]
line = "main"
model = "erc8"
address = 3
[module.yard]
line = "main"
model = "r55"
address = 4
outputs = 8
[module.tank]
line = "main"
model = "emd2a2q"
address = 5
"#;

/// Relay 1 of `oven` on, answered by its echo.
const OVEN_ON: [u8; 8] = [0x03, 0x05, 0x00, 0x3C, 0xFF, 0x00, 0x4D, 0xD4];
/// The outputs of `pump` and its inputs, without a checksum.
const PUMP: &[u8] = b"$016\r";
/// No reply.
const SILENCE: [u8; 0] = [];
/// The analog inputs of `tank`.
const TANK: [u8; 8] = [0x05, 0x03, 0x00, 0x06, 0x00, 0x02, 0x25, 0x8E];

/// The first line of a plant.
struct Bench {
    stage: Stage,
    directory: Directory,
    now: Instant,
    heard: Vec<(Instant, Vec<u8>)>,
}

impl Bench {
    fn new(text: &str) -> Bench {
        Bench::with(text, 0, &[])
    }

    fn with(text: &str, seed: u64, faults: &[&str]) -> Bench {
        let config = Config::parse(text).expect("a good plant");
        let directory = Directory::of(&config);
        let wanted = plant::PlantOptions {
            seed: Some(seed),
            faults: faults.iter().map(|text| (*text).to_owned()).collect(),
            ..plant::PlantOptions::default()
        };
        let stages = plant::stages(Lang::En, &config, &directory, None, &wanted);
        let mut bench = Bench {
            stage: stages.expect("a possible plant").remove(0),
            directory,
            now: Instant(0),
            heard: Vec::new(),
        };
        bench.run(Micros(0));
        bench
    }

    /// Lets time pass.
    fn run(&mut self, time: Micros) {
        let until = self.now + time;
        loop {
            match self.stage.poll() {
                Output::Heard { at, bytes } => self.heard.push((at, bytes.to_vec())),
                Output::Effect { .. } => {}
                Output::Wait(at) => match at.filter(|at| *at <= until) {
                    Some(at) => {
                        self.now = at;
                        self.stage.handle(at, Input::Timeout);
                    }
                    None => break,
                },
            }
        }
        self.now = until;
        self.stage.handle(until, Input::Timeout);
    }

    /// Does what a line of text says, and gives the answer.
    fn order(&mut self, text: &str) -> String {
        let order = match self.directory.read(Lang::En, text) {
            Ok(Order::Line(_, order) | Order::All(order)) => order,
            other => panic!("{text}: {other:?}"),
        };
        let answer = answers::perform(Lang::En, &mut self.stage, self.now, order);
        self.run(Micros(0));
        answer.join(" | ")
    }

    /// What the host hears within a second of sending.
    fn ask(&mut self, bytes: &[u8]) -> Vec<u8> {
        self.ask_with(bytes, SerialSettings::FACTORY)
    }

    fn ask_with(&mut self, bytes: &[u8], settings: SerialSettings) -> Vec<u8> {
        self.run(Micros::from_millis(20));
        self.heard.clear();
        self.stage.handle(self.now, Input::Send { bytes, settings });
        self.run(Micros::from_secs(1));
        self.heard
            .iter()
            .flat_map(|(_, bytes)| bytes.clone())
            .collect()
    }
}

/// A command to a 0x55 board, with its checksum.
fn yard(address: u8, function: u8, data: u8) -> [u8; 8] {
    let mut frame = [0x55, address, function, 0, 0, 0, data, 0];
    frame[7] = frame[..7]
        .iter()
        .fold(0, |sum: u8, byte| sum.wrapping_add(*byte));
    frame
}

fn with_sim(module: &str, sim: &str) -> String {
    format!("{PLANT}[module.{module}.sim]\n{sim}\n")
}

#[test]
fn the_same_seed_and_deeds_give_the_same_bytes() {
    let trial = |seed| {
        let faults = [
            "line: noise 200ms, flip 2%",
            "pump: delay 20ms±15, drop 20%",
        ];
        let mut bench = Bench::with(PLANT, seed, &faults);
        let mut all = Vec::new();
        for round in 0..20 {
            bench.order(&format!("pump.di1 = {}", round % 2));
            for request in [PUMP, &OVEN_ON, &TANK] {
                bench.ask(request);
                all.append(&mut bench.heard);
            }
        }
        all
    };
    let first = trial(7);
    assert!(first.len() > 100, "{}", first.len());
    assert_eq!(first, trial(7));
    assert_ne!(first, trial(8));
}

#[test]
fn inputs_are_as_the_plant_and_the_prompt_say() {
    let inputs = "inputs = { di0 = 0, di2 = { every = \"10s\" } }";
    let mut bench = Bench::new(&with_sim("pump", inputs));
    assert_eq!(bench.ask(PUMP), b"!000A00\r");
    bench.run(Micros::from_secs(10));
    assert_eq!(bench.ask(PUMP), b"!000E00\r");
    assert_eq!(bench.order("pump.di1 = 0"), "pump.di1 = low");
    assert_eq!(bench.order("pump.di2 = 0"), "pump.di2 = low");
    assert_eq!(bench.ask(PUMP), b"!000800\r");
    bench.run(Micros::from_secs(10));
    assert_eq!(bench.ask(PUMP), b"!000800\r", "it moves no more");
    assert_eq!(bench.order("pump.di2 = auto"), "pump.di2 = auto");
    assert_eq!(bench.order("pump.di1 = auto"), "pump.di1 = auto");
    assert_eq!(bench.ask(PUMP), b"!000A00\r", "nothing there is open");
    bench.run(Micros::from_secs(10));
    assert_eq!(bench.ask(PUMP), b"!000E00\r", "the other moves as before");
}

#[test]
fn a_fault_is_over_after_so_many_replies() {
    let mut bench = Bench::new(PLANT);
    let told = bench.order("fault pump bad 2x");
    assert_eq!(told, "pump: faults: bad 2x (2x left)");
    assert_eq!(bench.ask(PUMP), b"!000F00\x1D");
    assert_eq!(bench.order("show pump").matches("(1x left)").count(), 1);
    assert_eq!(bench.ask(PUMP), b"!000F00\x1D");
    assert_eq!(bench.ask(PUMP), b"!000F00\r");
    assert_eq!(bench.order("fault pump clear"), "pump: faults: none");
}

#[test]
fn single_faults_are_taken_back() {
    let mut bench = Bench::new(PLANT);
    bench.order("fault oven stuck k1, stuck k2, duplicate 100%");
    assert_eq!(
        bench.order("fault oven clear duplicate"),
        "oven: faults: stuck k1, stuck k2"
    );
    assert_eq!(bench.ask(&OVEN_ON), OVEN_ON);
    assert!(bench.order("show oven").contains("outputs 00000000"));
    assert_eq!(
        bench.order("fault oven clear stuck k1"),
        "oven: faults: stuck k2"
    );
    assert_eq!(bench.ask(&OVEN_ON), OVEN_ON);
    assert!(bench.order("show oven").contains("outputs 10000000"));
    assert_eq!(
        bench.order("fault oven clear mute"),
        "oven: faults: stuck k2"
    );
    assert_eq!(bench.order("fault oven clear stuck"), "oven: faults: none");
}

#[test]
fn analog_inputs_are_fixed_or_move() {
    let inputs = "inputs = { ai1 = 8.71, ai2 = { from = 1, to = 9, every = \"100s\" } }";
    let mut bench = Bench::new(&with_sim("tank", inputs));
    let values = |reply: Vec<u8>| {
        let word = |at: usize| u16::from_be_bytes([reply[at], reply[at + 1]]);
        [word(3), word(5)]
    };
    let first = values(bench.ask(&TANK));
    assert_eq!(first[0], 871);
    assert!((100..110).contains(&first[1]), "{first:?}");
    bench.run(Micros::from_secs(47));
    let later = values(bench.ask(&TANK));
    assert!((860..900).contains(&later[1]), "{later:?}");
    assert_eq!(bench.order("tank.ai2 = 5.5 V"), "tank.ai2 = 5.50");
    assert_eq!(values(bench.ask(&TANK)), [871, 550]);
}

#[test]
fn a_factory_fresh_module_waits_for_its_power_and_its_address() {
    let mut bench = Bench::new(&with_sim("yard", "factory = true\npower = \"off\""));
    assert_eq!(bench.ask(&yard(1, 0x10, 0)), SILENCE);
    assert_eq!(bench.order("power yard on"), "yard: power on");
    bench.run(Micros::from_secs(9));
    assert_eq!(bench.ask(&yard(1, 0x41, 4))[2], 0x41, "within 10 s");
    assert_eq!(bench.ask(&yard(4, 0x10, 0)).len(), 8);
    bench.run(Micros::from_secs(1));
    assert_eq!(bench.ask(&yard(4, 0x41, 9)), SILENCE, "later than that");
    bench.order("power yard cycle");
    assert_eq!(bench.ask(&yard(4, 0x41, 9)).len(), 8, "it kept its address");
    assert_eq!(bench.ask(&yard(9, 0x10, 0)).len(), 8);
    bench.order("reset yard");
    assert_eq!(bench.ask(&yard(1, 0x10, 0)).len(), 8);
}

#[test]
fn a_reset_gives_no_power() {
    let mut bench = Bench::new(PLANT);
    assert_eq!(bench.order("power yard off"), "yard: power off");
    bench.order("reset yard");
    assert_eq!(bench.ask(&yard(1, 0x10, 0)), SILENCE);
    bench.order("power yard cycle");
    assert_eq!(bench.ask(&yard(1, 0x10, 0)).len(), 8);
}

#[test]
fn a_dip_switch_gives_the_address() {
    let mut bench = Bench::new(&with_sim("yard", "dip = 9"));
    assert_eq!(bench.ask(&yard(9, 0x10, 0)).len(), 8);
    assert_eq!(bench.order("dip yard 0"), "yard: DIP switch at 0");
    assert_eq!(bench.ask(&yard(4, 0x10, 0)).len(), 8);
    assert!(bench.order("dip yard 12").ends_with("12"));
    assert!(bench.order("show yard").contains(" 12 (0Ch) r55 "));
}

#[test]
fn init_chooses_the_protocol() {
    let mut bench = Bench::new(PLANT);
    assert_eq!(bench.ask(b"$02M\r").first(), Some(&b'!'));
    assert_eq!(bench.order("init gate on"), "gate: INIT* grounded");
    assert_eq!(bench.ask(b"$02M\r"), SILENCE);
    assert!(bench.order("show gate").contains(" lc02 "));
    let text = PLANT.replace("address = 2\n", "address = 2\nprotocol = \"lc02\"\n");
    let mut wired = Bench::new(&text);
    assert!(wired.order("show gate").contains(" lc02 "));
    let mut fresh = Bench::new(&text.replace("\"lc02\"\n", "\"lc02\"\nsim.factory = true\n"));
    assert!(fresh.order("show gate").contains(" 1 (01h) ascii "));
}

#[test]
fn faults_come_and_go() {
    let mut bench = Bench::with(PLANT, 1, &["oven: mute 5s"]);
    assert_eq!(bench.ask(&OVEN_ON), SILENCE);
    assert!(
        bench.order("show oven").contains("outputs 10000000"),
        "it obeys"
    );
    bench.run(Micros::from_secs(5));
    assert_eq!(bench.ask(&OVEN_ON), OVEN_ON);
    bench.order("fault oven deaf");
    assert_eq!(bench.ask(&OVEN_ON), SILENCE);
    assert_eq!(bench.order("fault oven clear"), "oven: faults: none");
    assert_eq!(bench.ask(&OVEN_ON), OVEN_ON);
    bench.order("fault line echo");
    assert_eq!(bench.ask(&OVEN_ON), [OVEN_ON, OVEN_ON].concat());
    bench.order("fault line main clear");
    assert_eq!(bench.ask(&OVEN_ON), OVEN_ON);
    bench.order("fault oven duplicate 100%");
    assert_eq!(bench.ask(&OVEN_ON), [OVEN_ON, OVEN_ON].concat());
}

#[test]
fn a_late_reply_is_late() {
    let mut bench = Bench::new(PLANT);
    let first = |bench: &mut Bench| {
        let sent = bench.now + Micros::from_millis(20);
        assert_eq!(bench.ask(&OVEN_ON), OVEN_ON);
        bench.heard[0].0.since(sent)
    };
    let usual = first(&mut bench);
    bench.order("fault oven delay 200ms±50");
    for _ in 0..10 {
        let late = first(&mut bench) - usual;
        assert!((150_000..=250_000).contains(&late.0), "{late:?}");
    }
}

#[test]
fn the_dead_have_no_power_and_come_back() {
    let mut bench = Bench::new(PLANT);
    bench.ask(&OVEN_ON);
    bench.order("fault oven dead 3s");
    assert!(
        bench
            .order("show oven")
            .contains("power off; outputs 00000000")
    );
    bench.order("power oven cycle");
    assert_eq!(bench.ask(&OVEN_ON), SILENCE, "a dead one stays dead");
    bench.run(Micros::from_secs(3));
    assert_eq!(bench.ask(&OVEN_ON), OVEN_ON);
    bench.order("fault line dead");
    assert_eq!(bench.ask(&OVEN_ON), SILENCE);
    assert_eq!(bench.ask(PUMP), SILENCE);
    bench.order("power pump off");
    bench.order("fault clear");
    assert_eq!(bench.ask(&OVEN_ON), OVEN_ON);
    assert_eq!(bench.ask(PUMP), SILENCE, "it was switched off");
}

#[test]
fn a_babbler_is_hushed() {
    let mut bench = Bench::new(PLANT);
    bench.order("fault pump babble");
    bench.heard.clear();
    bench.run(Micros::from_secs(1));
    assert!(bench.heard.len() > 10, "it talks all the time");
    bench.order("fault pump clear");
    assert_eq!(bench.ask(&OVEN_ON), OVEN_ON);
    bench.order("fault line babble 1s");
    assert_ne!(bench.ask(&OVEN_ON), OVEN_ON);
    bench.run(Micros::from_secs(1));
    assert_eq!(bench.ask(&OVEN_ON), OVEN_ON);
}

#[test]
fn two_modules_on_one_address_collide() {
    let text = PLANT.replace("model = \"emd2a2q\"", "model = \"erc8\"");
    let mut bench = Bench::with(&text, 3, &["tank: dup-address 3"]);
    assert_ne!(bench.ask(&OVEN_ON), OVEN_ON, "both answer at once");
    assert!(bench.stage.line().collisions() > 0);
    assert!(bench.order("show tank").contains(" 3 (03h) "));
    let tank = bench.stage.parts().iter().find(|part| part.name == "tank");
    let kept = tank.map(|tank| tank.kept(bench.stage.line()).address.0);
    assert_eq!(kept, Some(5), "the fault is not kept");
    bench.order("fault tank clear");
    assert!(bench.order("show tank").contains(" 5 (05h) "));
}

#[test]
fn noise_is_heard_where_the_line_is_idle() {
    let mut bench = Bench::with(PLANT, 5, &["line: noise 100ms"]);
    bench.run(Micros::from_secs(10));
    let noise = bench.stage.line().injected().noise;
    assert!((50..200).contains(&noise), "{noise}");
}

#[test]
fn power_that_fails_by_chance_comes_back() {
    let mut bench = Bench::with(PLANT, 5, &["oven: cuts 10s 2s"]);
    let mut answered = 0;
    for _ in 0..60 {
        answered += usize::from(bench.ask(&OVEN_ON) == OVEN_ON);
    }
    assert!((30..60).contains(&answered), "{answered}");
    assert!(bench.stage.line().injected().cuts > 2);
}

#[test]
fn a_module_of_another_parity_is_understood() {
    let text = PLANT.replace("address = 3\n", "address = 3\nformat = \"8E1\"\n");
    let mut bench = Bench::new(&text);
    assert_eq!(bench.ask(&OVEN_ON), SILENCE);
    let even = SerialSettings {
        baud: Baud::B9600,
        character: Character::E1,
    };
    assert_eq!(bench.ask_with(&OVEN_ON, even), OVEN_ON);
    let addressed: Vec<_> = bench.stage.line().addressed(&OVEN_ON).collect();
    let names: Vec<&str> = addressed
        .iter()
        .map(|id| bench.stage.line().name(*id))
        .collect();
    assert_eq!(names, ["oven"]);
}

#[test]
fn init_may_be_looked_at_when_the_power_comes() {
    let mut bench = Bench::new(&with_sim("gate", "init_sampled = \"at-power-up\""));
    bench.order("init gate on");
    assert_eq!(bench.ask(b"$02M\r").first(), Some(&b'!'), "not yet");
    bench.order("power gate cycle");
    assert_eq!(bench.ask(b"$02M\r"), SILENCE);
    bench.order("power gate off");
    bench.order("init gate off");
    bench.order("power gate on");
    assert_eq!(bench.ask(b"$02M\r").first(), Some(&b'!'));
}

#[test]
fn a_line_shows_what_went_wrong() {
    let mut bench = Bench::with(PLANT, 1, &["line: echo, flip 50% 10s"]);
    bench.ask(&OVEN_ON);
    let shown = bench.order("show line");
    let line = shown.split(" | ").next().unwrap_or_default();
    assert!(
        line.starts_with("line main: 9600 8N1; collisions 0; faults so far "),
        "{line}"
    );
    assert!(
        line.ends_with("; faults: echo, flip 50% 10s (9.0 s left)"),
        "{line}"
    );
}

#[test]
fn the_worst_of_all_lines_goes_on() {
    let faults = [
        "line: noise 1ms, flip 50%, skip 50%, echo, drop 50%, split 100% 5ms, cuts 50ms 10ms",
        "pump: babble, duplicate 100%, delay 9999h",
        "oven: babble 100%, glitch 100%, dup-address 5",
    ];
    let mut bench = Bench::with(PLANT, 9, &faults);
    for _ in 0..5 {
        for request in [PUMP, &OVEN_ON, &TANK] {
            bench.ask(request);
        }
        bench.order("power oven cycle");
    }
    assert_eq!(bench.order("fault clear"), "");
    bench.run(Micros::from_secs(1));
    assert_eq!(bench.ask(&OVEN_ON), OVEN_ON);
    assert_eq!(bench.ask(PUMP), b"!000F00\r");
}

#[test]
fn a_protocol_is_switched_out_of_band() {
    let mut bench = Bench::new(PLANT);
    assert_eq!(bench.ask(PUMP), b"!000F00\r");
    let told = bench.order("protocol pump rtu");
    assert_eq!(told, "pump: restarted with protocol rtu");
    assert_eq!(bench.ask(PUMP), SILENCE);
    assert!(bench.order("show pump").contains(" 1 (01h) rtu "));
    bench.order("reset pump");
    assert_eq!(bench.ask(PUMP), b"!000F00\r");
}

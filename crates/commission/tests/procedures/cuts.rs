//! The host dies, frames get lost and modules lose power, at every act of every change, in every
//! family and protocol. Afterwards a recovery finds the module, and what the journal says about it
//! is true.

use crate::bench::{Bench, CUTS, Cut, End};
use railbus_commission::settings::Wanted;
use railbus_commission::{
    BusAddress, ChangeOrigin, Ended, Job, JournalRecord, ProcedureError, PulseSetup, RecordState,
    Recovered, Spot, change, recover, restore_factory,
};
use railbus_device::{Applies, Eeprom, Family, Options, Setup};
use railbus_wire::{Address, Micros, Protocol};
use std::io::Write;

/// A change that is interrupted at every act.
struct Case {
    family: Family,
    protocol: Protocol,
    /// Nothing is the factory reset.
    set: &'static str,
}

const fn case(family: Family, protocol: Protocol, set: &'static str) -> Case {
    Case {
        family,
        protocol,
        set,
    }
}

const CASES: [Case; 14] = [
    case(
        Family::Eda9060a,
        Protocol::Ascii,
        "address=9 baud=19200 checksum=on",
    ),
    case(Family::Eda9060a, Protocol::Ascii, "checksum=on"),
    case(
        Family::Eda9060a,
        Protocol::Ascii,
        "do3.mode=pulse pulse_width=0.7s",
    ),
    case(Family::Eda9060a, Protocol::Lc02, "address=9 baud=4800"),
    case(Family::Eda9060a, Protocol::Lc02, "pulse_width=20s"),
    case(Family::Eda9060a, Protocol::Rtu, "address=9 baud=19200"),
    case(Family::Eda9060a, Protocol::Rtu, "do0.mode=pulse address=9"),
    case(
        Family::Eda9050,
        Protocol::Ascii,
        "address=9 baud=19200 checksum=on",
    ),
    case(Family::Eda9050, Protocol::Lc02, "address=9 baud=2400"),
    case(Family::Eda9050, Protocol::Rtu, "address=9 baud=19200"),
    case(
        Family::Erc8,
        Protocol::Rtu,
        "address=9 baud=38400 parity=even",
    ),
    case(Family::R55, Protocol::R55, "address=9"),
    case(
        Family::Emd2a2q,
        Protocol::Rtu,
        "address=9 baud=4800 parity=odd calibration_voltage=4V",
    ),
    case(Family::Emd2a2q, Protocol::Rtu, ""),
];

impl Case {
    fn setup(&self) -> Setup {
        // The factory reset leads to address 1.
        let address = if self.set.is_empty() { 7 } else { 1 };
        Setup {
            protocol: self.protocol,
            ..Setup::new(self.family, Address(address))
        }
    }

    fn job(&self) -> Job {
        let setup = self.setup();
        let words = self.set.split(' ').filter(|word| !word.is_empty());
        Job {
            change: 1,
            line: "main".to_owned(),
            module: "module".to_owned(),
            setup,
            wanted: Wanted::parse(&setup, words).unwrap(),
            neighbours: Vec::new(),
            by: ChangeOrigin::Set,
            undoes: None,
        }
    }

    fn run(
        &self,
        bench: &mut Bench,
        cut: Option<(usize, Cut)>,
    ) -> End<Result<Ended, ProcedureError>> {
        match self.set {
            "" => bench.run(restore_factory(self.job()), cut),
            _ => bench.run(change(self.job()), cut),
        }
    }
}

/// Where a module with this EEPROM answers once it has restarted.
fn place(eeprom: &Eeprom) -> BusAddress {
    BusAddress {
        address: eeprom.address,
        serial: eeprom.serial,
        checksum: eeprom.checksum,
    }
}

/// Whether the EEPROM holds one side of a record: the old values, or the new ones.
fn holds(eeprom: &Eeprom, record: &JournalRecord, setup: &Setup, new: bool) -> bool {
    let side = usize::from(new);
    let spot = if new { &record.to } else { &record.from };
    let mut wanted = Wanted::default();
    for (name, values) in &record.set {
        // `calibration` is not a setting that can be written.
        let _ = wanted.set(setup, name, &values[side]);
    }
    let pulse = PulseSetup {
        mask: eeprom.pulse_mask,
        width: eeprom.pulse_width,
    };
    let known = railbus_commission::Kept {
        pulse: Some(pulse),
        ..Default::default()
    };
    let wanted = wanted.over(&known).unwrap();
    // LC-02 and Modbus frames don't show the checksum state, and no case changes it there.
    let there = spot.place().unwrap();
    there == place(eeprom)
        && wanted.pulse.is_none_or(|wanted| wanted == pulse)
        && wanted
            .voltage
            .is_none_or(|voltage| voltage == eeprom.calibration.voltage)
}

/// What the journal says of the module is what its EEPROM holds.
#[track_caller]
fn check(bench: &Bench, before: &Eeprom, setup: &Setup, what: &str) {
    let (log, eeprom) = (bench.log(), bench.eeprom());
    let Some(last) = log.records.last() else {
        assert_eq!(eeprom, *before, "{what}: written, and not in the journal");
        return;
    };
    let said = match last.state {
        RecordState::Done | RecordState::Filed => holds(&eeprom, last, setup, true),
        RecordState::Unchanged => holds(&eeprom, last, setup, false),
        RecordState::Pending => {
            let found = last.found.as_ref().and_then(Spot::place);
            found.is_some()
                && (holds(&eeprom, last, setup, true) || holds(&eeprom, last, setup, false))
        }
        RecordState::Untold => {
            holds(&eeprom, last, setup, true) || holds(&eeprom, last, setup, false)
        }
        RecordState::Elsewhere => last.found.is_some(),
        RecordState::Intent | RecordState::Lost => false,
    };
    assert!(
        said,
        "{what}: the journal says {:?}, the module keeps {eeprom:?}\n{last:?}",
        last.state
    );
}

/// One run, interrupted at one act in one way.
fn cut_off(case: &Case, options: Options, at: usize, cut: Cut) {
    let setup = case.setup();
    let mut bench = Bench::new(&setup, options);
    let before = bench.eeprom();
    let what = format!(
        "{:?} {} {:?} {:?}, act {at} {cut:?}",
        case.family, case.protocol, case.set, options.applies
    );
    let end = case.run(&mut bench, Some((at, cut)));
    bench.wait(Micros::from_secs(1));
    if let End::Done(Ok(Ended::Done(_))) = &end
        && options.applies == Applies::AfterReply
    {
        let last = bench.log().records.last().cloned();
        assert_eq!(
            last.map(|last| last.state),
            Some(RecordState::Done),
            "{what}"
        );
    }
    recovered(&mut bench, &setup, &what);
    check(&bench, &before, &setup, &what);
}

/// Recovers open changes, with the module on the line after one more restart.
fn recovered(bench: &mut Bench, setup: &Setup, what: &str) {
    for round in 0..2 {
        let Some(open) = bench.log().open().first().map(|record| (*record).clone()) else {
            return;
        };
        let earlier = bench.log().places(open.change);
        let end = bench.run(recover(open, earlier, *setup, false, Vec::new()), None);
        let End::Done(Ok(end)) = end else {
            panic!("{what}: {end:?}");
        };
        assert!(!matches!(end, Recovered::Nowhere(_)), "{what}: not found");
        if round == 0 && matches!(end, Recovered::Pending(_) | Recovered::Else(_)) {
            bench.power_cycle();
        }
    }
}

fn all_cuts(options: Options) -> usize {
    let mut points = 0;
    for case in &CASES {
        let mut bench = Bench::new(&case.setup(), options);
        let End::Done(Ok(end)) = case.run(&mut bench, None) else {
            panic!("{} {}", case.protocol, case.set);
        };
        if options.applies == Applies::AfterReply {
            assert!(
                matches!(end, Ended::Done(_)),
                "{:?} {} {end:?}",
                case.family,
                case.set
            );
        }
        for at in 0..bench.acts {
            for cut in CUTS {
                cut_off(case, options, at, cut);
                points += 1;
            }
        }
    }
    points
}

/// Prints how many there were, and fails if there are fewer than expected.
fn told(points: usize, least: usize) {
    let _ = writeln!(std::io::stdout(), "{points} injection points");
    assert!(points >= least, "only {points} injection points");
}

fn options(applies: Applies) -> Options {
    Options {
        turnaround: Micros::from_millis(5),
        applies,
        ..Options::default()
    }
}

#[test]
fn cut_off_at_every_act_where_settings_act_at_once() {
    let points = all_cuts(options(Applies::AfterReply));
    told(points, 3_000);
}

#[test]
fn cut_off_at_every_act_where_settings_act_at_the_next_start() {
    let points = all_cuts(options(Applies::AfterRestart));
    told(points, 3_000);
}

#[test]
fn cut_off_at_every_act_where_only_the_address_acts_at_once() {
    let points = all_cuts(options(Applies::AddressAfterReply));
    told(points, 3_000);
}

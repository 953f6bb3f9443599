//! What is refused before anything is written, and how changes end.

use crate::bench::{Bench, End};
use railbus_commission::settings::Wanted;
use railbus_commission::{
    BusAddress, ChangeOrigin, Ended, Job, Neighbour, ProcedureError, RecordState, Recovered,
    Search, WriteFailure, calibrate, change, look_up, read, recover,
};
use railbus_device::{Eeprom, Family, Options, Setup};
use railbus_sim::{Act, Faults, Input};
use railbus_wire::{Address, Baud, Character, Micros, Protocol};

fn job(setup: Setup, set: &str) -> Job {
    Job {
        change: 1,
        line: "main".to_owned(),
        module: "module".to_owned(),
        setup,
        wanted: Wanted::parse(&setup, set.split(' ')).unwrap(),
        neighbours: Vec::new(),
        by: ChangeOrigin::Set,
        undoes: None,
    }
}

fn end(bench: &mut Bench, job: Job) -> Result<Ended, ProcedureError> {
    match bench.run(change(job), None) {
        End::Done(end) => end,
        End::Died => panic!("nobody killed it"),
    }
}

#[test]
fn every_family_is_read_in_every_protocol() {
    for family in Family::ALL {
        for protocol in family.profile().protocols {
            let setup = Setup {
                protocol: *protocol,
                ..Setup::new(family, Address(5))
            };
            let mut bench = Bench::new(&setup, Options::default());
            let End::Done(found) = bench.run(read(setup), None) else {
                panic!()
            };
            let kept = found.unwrap().kept();
            assert_eq!(kept.address, Some(Address(5)), "{family} {protocol}");
            // Another model at its address is told apart from it.
            for other in Family::ALL {
                let wrong = Setup {
                    protocol: *protocol,
                    ..Setup::new(other, Address(5))
                };
                if other == family || wrong.check().is_err() {
                    continue;
                }
                let mut bench = Bench::new(&setup, Options::default());
                let End::Done(found) = bench.run(read(wrong), None) else {
                    panic!()
                };
                assert!(
                    matches!(
                        found,
                        Err(ProcedureError::WrongModel(..) | ProcedureError::NoReply(_))
                    ),
                    "{family} is taken for {other} in {protocol}: {found:?}"
                );
            }
        }
    }
}

#[test]
fn an_address_where_somebody_answers_is_refused() {
    for (protocol, family) in [
        (Protocol::Ascii, Family::Eda9060a),
        (Protocol::Lc02, Family::Eda9050),
        (Protocol::Rtu, Family::Eda9050),
        (Protocol::Rtu, Family::Emd2a2q),
    ] {
        let setup = Setup {
            protocol,
            ..Setup::new(family, Address(1))
        };
        let mut bench = Bench::new(&setup, Options::default());
        // The other module speaks Modbus at 30, and is in no configuration.
        let refused = end(&mut bench, job(setup, "address=30"));
        assert!(
            matches!(refused, Err(ProcedureError::Taken(_))),
            "{refused:?}"
        );
        assert_eq!(bench.journal, "");
        assert_eq!(bench.eeprom(), Eeprom::of(&setup));
    }
}

/// A module at the new address is found even if it is as slow as a line allows for, in the same
/// protocol or another.
#[test]
fn an_address_where_somebody_answers_late_is_refused() {
    let families = [
        (Protocol::Ascii, Family::Eda9060a),
        (Protocol::Lc02, Family::Eda9050),
        (Protocol::Rtu, Family::Erc8),
        (Protocol::R55, Family::R55),
    ];
    for late in [250, 400, 490, 700, 850] {
        for (protocol, family) in families.into_iter().take(3) {
            for (others, other) in families {
                // Slower than 0.5 s, and of another protocol: its reply is interrupted.
                if late > 490 && others != protocol {
                    continue;
                }
                let of = |family, address, protocol| Setup {
                    protocol,
                    ..Setup::new(family, Address(address))
                };
                let setup = of(family, 1, protocol);
                let mut bench = Bench::new(&setup, Options::default());
                let slow = Options {
                    turnaround: Micros::from_millis(late),
                    ..Options::default()
                };
                let there = of(other, 9, others);
                let kept = Eeprom::of(&there);
                bench
                    .line
                    .add(bench.now, "slow", &there, kept, slow)
                    .unwrap();
                let refused = end(&mut bench, job(setup, "address=9"));
                assert!(
                    matches!(refused, Err(ProcedureError::Taken(_))),
                    "{protocol}, and {others} after {late} ms: {refused:?}"
                );
                assert_eq!(bench.journal, "");
            }
        }
    }
}

/// The configuration has a module there that is switched off.
#[test]
fn the_address_of_a_module_that_is_off_is_taken() {
    let setup = Setup::new(Family::Erc8, Address(1));
    let other = Setup::new(Family::Emd2a2q, Address(9));
    let mut bench = Bench::new(&setup, Options::default());
    let neighbour = Neighbour {
        name: "tank".to_owned(),
        protocol: other.protocol,
        place: BusAddress::of(&other),
    };
    let job = Job {
        neighbours: vec![neighbour],
        ..job(setup, "address=9")
    };
    let Err(ProcedureError::Taken(taken)) = end(&mut bench, job) else {
        panic!()
    };
    assert_eq!(taken.module.as_deref(), Some("tank"));
    assert_eq!(bench.journal, "");
}

#[test]
fn the_new_speed_is_looked_at_before_it_is_taken() {
    let setup = Setup::new(Family::Erc8, Address(1));
    let mut bench = Bench::new(&setup, Options::default());
    let mut other = Setup::new(Family::Erc8, Address(1));
    other.serial.baud = Baud::B19200;
    bench
        .line
        .add(
            bench.now,
            "other",
            &other,
            Eeprom::of(&other),
            Options::default(),
        )
        .unwrap();
    let refused = end(&mut bench, job(setup, "baud=19200"));
    assert!(
        matches!(refused, Err(ProcedureError::Taken(_))),
        "{refused:?}"
    );
}

#[test]
fn two_modules_on_one_address_are_not_written_to() {
    for protocol in [Protocol::Ascii, Protocol::Lc02, Protocol::Rtu] {
        let setup = Setup {
            protocol,
            ..Setup::new(Family::Eda9060a, Address(1))
        };
        for turnaround in [0, 3, 40] {
            let mut bench = Bench::new(&setup, Options::default());
            let options = Options {
                turnaround: Micros::from_millis(turnaround),
                ..Options::default()
            };
            let mut other = Eeprom::of(&setup);
            other.pulse_mask = 5;
            bench
                .line
                .add(bench.now, "twin", &setup, other, options)
                .unwrap();
            if turnaround == 40 && protocol == Protocol::Rtu {
                // It receives the other's reply before its own is sent, and drops its own: it can't
                // be detected.
                continue;
            }
            let refused = end(&mut bench, job(setup, "address=9"));
            assert!(
                matches!(
                    refused,
                    Err(ProcedureError::Garbled(_)
                        | ProcedureError::NoReply(_)
                        | ProcedureError::WrongModel(..))
                ),
                "{protocol} {turnaround}: {refused:?}"
            );
            assert_eq!(bench.journal, "");
        }
    }
}

#[test]
fn a_module_that_does_not_hear_the_write_is_unchanged() {
    let setup = Setup::new(Family::Erc8, Address(1));
    let mut bench = Bench::new(&setup, Options::default());
    bench.line.set_module_faults(bench.module, Faults::DEAF);
    assert!(matches!(
        end(&mut bench, job(setup, "address=9")),
        Err(ProcedureError::NoReply(_))
    ));
    assert_eq!(bench.journal, "");
}

/// No acknowledgement, and the module reports its old values: that is certain, and no recovery is
/// needed.
#[test]
fn a_write_that_is_lost_twice_is_no_mystery() {
    let setup = Setup::new(Family::Erc8, Address(1));
    let mut bench = Bench::new(&setup, Options::default());
    bench.deaf_to = vec![1, 6];
    let ended = end(&mut bench, job(setup, "address=9")).unwrap();
    assert!(
        matches!(ended, Ended::Unchanged(_, WriteFailure::Ignored)),
        "{ended:?}"
    );
    assert!(bench.log().open().is_empty());
}

#[test]
fn a_board_that_is_not_switched_off_keeps_its_address() {
    let setup = Setup::new(Family::R55, Address(1));
    let mut bench = Bench::new(&setup, Options::default());
    bench.heeds = false;
    let ended = end(&mut bench, job(setup, "address=9")).unwrap();
    assert!(
        matches!(ended, Ended::Unchanged(_, WriteFailure::NoPowerCycle)),
        "{ended:?}"
    );
    assert_eq!(bench.eeprom().address, Address(1));
    // With its DIP switch at 1, too.
    let mut bench = Bench::new(&setup, Options::default());
    bench
        .line
        .handle(bench.now, Input::Act(bench.module, Act::Dip(1)));
    let ended = end(&mut bench, job(setup, "address=9")).unwrap();
    assert!(
        matches!(ended, Ended::Unchanged(_, WriteFailure::NoPowerCycle)),
        "{ended:?}"
    );
}

#[test]
fn what_is_so_already_is_not_written() {
    let setup = Setup::new(Family::Eda9060a, Address(1));
    let mut bench = Bench::new(&setup, Options::default());
    let ended = end(
        &mut bench,
        job(setup, "address=1 checksum=off pulse_width=1s"),
    )
    .unwrap();
    assert!(matches!(ended, Ended::Same(_)));
    assert_eq!(bench.journal, "");
}

#[test]
fn a_calibration_is_led_and_may_be_stopped() {
    let setup = Setup::new(Family::Emd2a2q, Address(1));
    let run = |answers: &[bool]| {
        let mut bench = Bench::new(&setup, Options::default());
        let (line, now, id) = (&mut bench.line, bench.now, bench.module);
        line.handle(now, Input::Act(id, Act::Analog(0, 12)));
        line.handle(now, Input::Act(id, Act::Analog(1, 8)));
        let mut rest = answers.iter();
        let mut asked = Vec::new();
        let mut calibrating = job(setup, "address=1");
        calibrating.by = ChangeOrigin::Calibrate;
        let end = bench.run_asking(calibrate(calibrating, 400), None, &mut |question| {
            asked.push(question);
            *rest.next().unwrap_or(&false)
        });
        let End::Done(Ok(done)) = end else {
            panic!("{end:?}")
        };
        (bench, done, asked.len())
    };
    let (bench, done, asked) = run(&[false]);
    assert_eq!((done.zero, asked, bench.journal.as_str()), (None, 1, ""));
    let (bench, done, _) = run(&[true, false]);
    assert_eq!((done.before, done.zero), (Some([12, 8]), Some([0, 0])));
    assert_eq!(bench.eeprom().calibration.zero, [12, 8]);
    let (bench, done, _) = run(&[true, true]);
    assert_eq!(bench.eeprom().calibration.voltage, 400);
    assert!(done.span.is_some() && done.hindered.is_none(), "{done:?}");
    assert!(bench.log().open().is_empty());
}

/// The address was changed, and the speed is refused by silence: the address is changed back as
/// well.
#[test]
fn a_change_that_can_not_be_finished_is_taken_back() {
    let setup = Setup::new(Family::Erc8, Address(1));
    let mut bench = Bench::new(&setup, Options::default());
    // FC06 at register 1, to the new address.
    bench.deaf_to = vec![9, 6, 0, 1];
    let ended = end(&mut bench, job(setup, "address=9 baud=19200")).unwrap();
    assert!(
        matches!(ended, Ended::RolledBack(_, WriteFailure::Ignored)),
        "{ended:?}"
    );
    assert_eq!(bench.eeprom(), Eeprom::of(&setup));
    let states: Vec<(ChangeOrigin, RecordState)> = bench
        .log()
        .records
        .iter()
        .map(|record| (record.by, record.state))
        .collect();
    let all = [
        (ChangeOrigin::Set, RecordState::Intent),
        (ChangeOrigin::Set, RecordState::Done),
        (ChangeOrigin::Set, RecordState::Intent),
        (ChangeOrigin::Set, RecordState::Unchanged),
        (ChangeOrigin::Rollback, RecordState::Intent),
        (ChangeOrigin::Rollback, RecordState::Done),
    ];
    assert_eq!(states, all);
}

/// A module far from where it should be is found, and searched only where there is no other one.
#[test]
fn a_lost_module_is_found_outwards() {
    let wanted = Setup::new(Family::Emd2a2q, Address(9));
    let mut there = Setup::new(Family::Emd2a2q, Address(9));
    there.serial.baud = Baud::B38400;
    there.serial.character = Character::O1;
    let mut bench = Bench::new(&there, Options::default());
    let search = |outwards| Search {
        setup: wanted,
        first: vec![BusAddress::of(&wanted)],
        outwards,
        others: Vec::new(),
    };
    let End::Done(Ok((found, _))) = bench.run(look_up(search(false)), None) else {
        panic!()
    };
    assert_eq!(found, None);
    let End::Done(Ok((found, _))) = bench.run(look_up(search(true)), None) else {
        panic!()
    };
    assert_eq!(found.map(|found| found.place), Some(BusAddress::of(&there)));
}

/// A module that speaks Modbus now also stores an ASCII checksum state, which no Modbus frame
/// changes.
#[test]
fn the_ascii_checksum_state_stays_while_modbus_is_spoken() {
    for protocol in [Protocol::Rtu, Protocol::Lc02] {
        let setup = Setup {
            protocol,
            ..Setup::new(Family::Eda9060a, Address(1))
        };
        let mut bench = Bench::new(&setup, Options::default());
        let eeprom = Eeprom {
            checksum: true,
            ..Eeprom::of(&setup)
        };
        let rewrite = Act::Rewrite(eeprom);
        bench
            .line
            .handle(bench.now, Input::Act(bench.module, rewrite));
        bench.wait(Micros::from_secs(1));
        let ended = end(&mut bench, job(setup, "address=9 baud=4800")).unwrap();
        assert!(matches!(ended, Ended::Done(_)), "{protocol}: {ended:?}");
        assert!(bench.eeprom().checksum && bench.eeprom().address == Address(9));
        // Interrupted, it is known again, too.
        let intent = bench.log().records[0].clone();
        let recovery = recover(intent, Vec::new(), setup, false, Vec::new());
        let End::Done(recovered) = bench.run(recovery, None) else {
            panic!()
        };
        assert!(
            matches!(recovered, Ok(Recovered::New(_))),
            "{protocol}: {recovered:?}"
        );
    }
}

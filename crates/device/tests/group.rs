//! `Module::group`, for every family, protocol and shape of board: any requested states of any
//! outputs become a few frames that produce exactly these.

mod support;

use proptest::prelude::*;
use railbus_device::{Bank, Family, Layout, Module, Observation, Op, Setup};
use railbus_wire::{Address, Protocol};
use support::{Bench, request, seen};

/// Any possible module, at address 5.
fn any_setup() -> impl Strategy<Value = Setup> {
    let families = prop::sample::select(&Family::ALL[..]);
    let shapes = (any::<bool>(), 0..=32u8, any::<prop::sample::Index>());
    (families, shapes).prop_map(|(family, (invert_on_off, channels, pick))| {
        let protocol = *pick.get(family.profile().protocols);
        let setup = Setup {
            protocol,
            ..Setup::new(family, Address(5))
        };
        match family {
            Family::R55 if channels <= 16 && pick.index(2) == 0 => Setup {
                layout: Layout::Mixed,
                outputs: channels,
                inputs: 16 - channels,
                invert_on_off,
                ..setup
            },
            Family::R55 => Setup {
                outputs: channels,
                invert_on_off,
                ..setup
            },
            _ => setup,
        }
    })
}

/// All ops that `group` makes of a request, in order.
fn steps(host: &Module, wish: Bank) -> Vec<Bank> {
    let mut steps = Vec::new();
    let mut want = wish;
    while want.mask != 0 {
        let step = host.group(want);
        assert_ne!(step.mask, 0, "a step for {want:?}");
        assert_eq!(step.mask & !want.mask, 0, "{step:?} is part of {want:?}");
        assert_eq!(step.on, want.on & step.mask, "{step:?} of {want:?}");
        want = Bank::new(want.mask & !step.mask, want.on);
        steps.push(step);
    }
    steps
}

/// Executes ops on the module; every one is answered as its kind is.
fn carry_out(host: &Module, module: &mut Bench, steps: &[Bank], silently: bool) {
    for step in steps {
        let op = if silently {
            Op::WriteSilent(*step)
        } else {
            Op::Write(*step)
        };
        let frame = request(host, &op).expect("one frame for each step");
        match module.ask(&frame) {
            Some(reply) if !silently => {
                let seen = seen(host, &op, &reply);
                assert!(
                    matches!(seen, Observation::Done | Observation::Channels { .. }),
                    "{seen:?}"
                );
            }
            reply => assert!(reply.is_none() && silently, "{op:?}: {reply:?}"),
        }
    }
}

/// The outputs as the host reads them.
fn read(host: &Module, module: &mut Bench) -> u32 {
    let frame = request(host, &Op::ReadOutputs).expect("a read");
    let reply = module.ask(&frame).expect("a reply");
    match seen(host, &Op::ReadOutputs, &reply) {
        Observation::Channels { outputs, .. } => {
            assert_eq!(outputs.mask, host.setup().output_mask());
            outputs.on
        }
        other => panic!("{other:?} are no outputs"),
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2000, ..ProptestConfig::default() })]

    /// [R55 §3.9] boards whose functions are swapped are among them.
    #[test]
    fn a_wish_comes_true_and_nothing_else(
        setup in any_setup(),
        mask in any::<u32>(),
        on in any::<u32>(),
        before in any::<u32>(),
        silently in any::<bool>(),
    ) {
        let host = Module::new(setup).expect("a possible module");
        let mut module = Bench::new(setup);
        let all = setup.output_mask();
        let was = Bank::new(all, before);
        carry_out(&host, &mut module, &steps(&host, was), false);
        prop_assert_eq!(read(&host, &mut module), was.on);

        let wish = Bank::new(mask & all, on);
        let steps = steps(&host, wish);
        let silently = silently && setup.protocol == Protocol::R55;
        carry_out(&host, &mut module, &steps, silently);
        let expected = was.on & !wish.mask | wish.on;
        prop_assert_eq!(read(&host, &mut module), expected);
        let engine = if setup.invert_on_off { !expected & all } else { expected };
        prop_assert_eq!(module.engine.outputs(), engine);
        let union = steps.iter().fold(Bank::default(), |sum, step| {
            Bank::new(sum.mask | step.mask, sum.on | step.on)
        });
        prop_assert_eq!(union, wish);
    }
}

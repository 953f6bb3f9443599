//! What is wrong with a configuration is told all at once, each with its place.

use railbus_site::Config;
use railbus_site::config::{Confirm, Invalid, Place, Policy, Signal, Step, Swing};
use railbus_wire::Micros;

const GOOD: &str = r#"
[line.main]
port = "/dev/ttyUSB0"

[module.pump]
line = "main"
model = "eda9060a"
address = 1
poll = "500ms"

[module.pump.point.do0]
name = { zh = "一号水泵", en = "Pump 1" }
locked = true

[module.oven]
line = "main"
model = "erc8"
address = 3
"#;

/// Code, line, column and path of every problem.
fn problems(text: &str) -> Vec<(&'static str, usize, usize, String)> {
    let problems = Config::parse(text).expect_err("it has problems");
    let told = |p: railbus_site::config::ConfigProblem| (p.kind.code(), p.line, p.column, p.path);
    problems.into_iter().map(told).collect()
}

/// The one problem of a text.
fn problem(text: &str) -> (&'static str, usize, usize, String) {
    let mut all = problems(text);
    assert_eq!(all.len(), 1, "{all:?}");
    all.remove(0)
}

#[test]
fn a_good_one_is_read() {
    let config = Config::parse(GOOD).expect("it is good");
    let pump = &config.modules["pump"];
    assert_eq!(pump.setup.address.0, 1);
    let do0 = pump.setup.point("do0").expect("it has one");
    assert!(pump.points[&do0].locked);
    assert_eq!(pump.points[&do0].name_zh.as_deref(), Some("一号水泵"));
    let names: Vec<_> = config.modules_of("main").map(|(name, _)| name).collect();
    assert_eq!(names, ["oven", "pump"]);
}

#[test]
fn lines_and_modules_are_called_something() {
    let text = GOOD
        .replace("[line.main]\n", "[line.main]\nname = { zh = \"一号线\" }\n")
        .replace(
            "address = 3\n",
            "address = 3\nname = \"Oven\"\narea = \"Hall 2\"\n",
        );
    let config = Config::parse(&text).expect("it is good");
    assert_eq!(config.lines["main"].name.zh.as_deref(), Some("一号线"));
    assert_eq!(config.lines["main"].name.en, None);
    let oven = &config.modules["oven"];
    assert_eq!(oven.name.en.as_deref(), Some("Oven"));
    assert_eq!(oven.name.zh, oven.name.en);
    assert_eq!(oven.area.as_deref(), Some("Hall 2"));
    assert_eq!(config.modules["pump"].area, None);
}

#[test]
fn each_problem_has_its_code_and_place() {
    let at = |text: &str, code, line, column, path: &str| {
        assert_eq!(
            problem(text),
            (code, line, column, path.to_owned()),
            "{text}"
        );
    };
    let line = "[line.main]\nport = \"/dev/ttyUSB0\"\n";
    let pump = format!("{line}[module.pump]\nline = \"main\"\nmodel = \"eda9060a\"\naddress = 1\n");
    at("[line.main\n", "E0811", 1, 11, "");
    at("[lines.main]\n", "E0812", 1, 2, "lines");
    at(
        &format!("{line}prot = 1\n"),
        "E0812",
        3,
        1,
        "line.main.prot",
    );
    at("[line.main]\n", "E0813", 1, 1, "line.main");
    at("[line.main]\nport = 5\n", "E0814", 2, 8, "line.main.port");
    at(
        &format!("{line}baud = 9601\n"),
        "E0815",
        3,
        8,
        "line.main.baud",
    );
    at(
        &pump.replace("= 1\n", "= 256\n"),
        "E0816",
        6,
        11,
        "module.pump.address",
    );
    at(&line.replace("main", "Main"), "E0817", 1, 7, "line.Main");
    at(
        &format!("{pump}poll = \"200\"\n"),
        "E0818",
        7,
        8,
        "module.pump.poll",
    );
    at(
        &format!("{pump}range = \"0-5V\"\n"),
        "E0819",
        7,
        9,
        "module.pump.range",
    );
    at(
        &pump.replace("\"main\"", "\"mian\""),
        "E0820",
        4,
        8,
        "module.pump.line",
    );
    let point = format!("{pump}[module.pump.point.do4]\n");
    at(&point, "E0821", 7, 20, "module.pump.point.do4");
    at(
        &format!("{pump}protocol = \"r55\"\n"),
        "E0822",
        7,
        12,
        "module.pump.protocol",
    );
    at(
        "[line.main]\nport = \"ttyUSB0\"\n",
        "E0825",
        2,
        8,
        "line.main.port",
    );
    let twice = format!("{line}{}", line.replace("main", "other"));
    at(&twice, "E0826", 4, 8, "line.other.port");
}

#[test]
fn two_modules_on_one_address_are_told() {
    let text = GOOD.replace(
        "address = 3",
        "address = 3\n\n[module.shed]\nline = \"main\"\n\
                             model = \"erc8\"\naddress = 3",
    );
    let problems = Config::parse(&text).expect_err("they collide");
    assert_eq!(problems[0].kind, Invalid::AddressTaken("oven".to_owned()));
    assert_eq!(problems[0].kind.code(), "E0823");
    assert_eq!((problems[0].line, problems[0].column), (23, 11));
    // Modules of different protocols do not hear each other's address.
    let other = GOOD.replace("address = 3", "address = 1");
    assert!(Config::parse(&other).is_ok());
}

#[test]
fn an_unknown_key_comes_with_the_one_that_is_meant() {
    let text = GOOD.replace("poll =", "pol =");
    let problems = Config::parse(&text).expect_err("it is unknown");
    assert_eq!(problems[0].kind, Invalid::UnknownKey(Some("poll")));
    let text = GOOD.replace("poll =", "colour =");
    let problems = Config::parse(&text).expect_err("it is unknown");
    assert_eq!(problems[0].kind, Invalid::UnknownKey(None));
}

#[test]
fn a_module_is_asked_for_its_model_unless_that_is_forbidden() {
    let text = |more: &str| {
        format!(
            "[line.main]\nport = \"/dev/ttyUSB0\"\n[module.pump]\nline = \"main\"\n\
             model = \"eda9060a\"\naddress = 1\n{more}"
        )
    };
    let asks = |more: &str| {
        let config = Config::parse(&text(more)).expect("it is good");
        let pump = &config.modules["pump"];
        let asks = pump.plan.identify;
        for polls in [true, false] {
            assert_eq!(pump.plan_where(polls).identify, asks, "{more}");
        }
        assert!(!pump.plan_where(false).enabled, "{more}");
        asks
    };
    assert!(asks("") && asks("identify = true\n") && asks("poll = \"never\"\n"));
    assert!(!asks("identify = false\n"));
    assert!(!asks("poll = \"1s\"\nidentify = false\n"));
    assert!(!asks("poll = \"never\"\nidentify = false\n"));
    let wrong = text("identify = \"no\"\n");
    let (_, line, column, path) = problem(&wrong);
    assert_eq!(
        (line, column, path.as_str()),
        (7, 12, "module.pump.identify")
    );
}

#[test]
fn all_problems_are_told_in_the_order_of_the_text() {
    let text = GOOD
        .replace("/dev/ttyUSB0", "ttyUSB0")
        .replace("500ms", "500")
        .replace("erc8", "erc9");
    let lines: Vec<usize> = problems(&text)
        .into_iter()
        .map(|(_, line, ..)| line)
        .collect();
    assert!(lines.is_sorted(), "{lines:?}");
    assert!(
        lines.contains(&3) && lines.contains(&9) && lines.contains(&17),
        "{lines:?}"
    );
}

#[test]
fn no_text_makes_it_panic() {
    for cut in GOOD.char_indices().map(|(at, _)| at) {
        let _ = Config::parse(&GOOD[..cut]);
        let _ = Config::parse(&GOOD[cut..]);
    }
    for wrong in [
        "line = 1",
        "module = []",
        "[module]\npump = 1",
        "[[line.main]]",
    ] {
        assert!(Config::parse(wrong).is_err(), "{wrong}");
    }
}

/// What a plant's file says of its simulation.
const PLANT: &str = r#"
[sim]
seed = 7
speed = 2

[line.main]
port = "pty:/tmp/x"

[line.main.sim]
tcp = "127.0.0.1:4001"
faults = "noise 1e-4, echo 10s"

[module.gate]
line = "main"
model = "eda9050"
address = 2

[module.gate.sim]
factory = true
power = "off"
init = true
turnaround = "8ms"
applies = "after-restart"
faults = "drop 5%"
inputs = { di0 = 0, di1 = true, di2 = { every = "10s" } }

[module.tank]
line = "main"
model = "emd2a2q"
address = 5
sim.inputs = { ai1 = 8.71, ai2 = { from = 1.2, to = 8.8, every = "4m" } }
"#;

#[test]
fn what_is_said_of_the_simulation_is_read() {
    let config = Config::parse(PLANT).expect("it is good");
    let plant = &config.plant;
    assert_eq!((plant.seed, plant.speed), (Some(7), Some(2.0)));
    let line = &plant.lines["main"];
    assert!(line.tcp.is_some_and(|address| address.port() == 4001));
    assert_eq!(line.faults.len(), 2);
    let gate = &plant.modules["gate"];
    assert!(gate.factory && !gate.powered);
    assert_eq!((gate.init, gate.dip, gate.faults.len()), (Some(true), 0, 1));
    assert_eq!(gate.options.turnaround, Micros::from_millis(8));
    let gate_inputs: Vec<Signal> = gate.inputs.values().copied().collect();
    let ten = Micros::from_secs(10);
    let expected = [
        Signal::Level(false),
        Signal::Level(true),
        Signal::Toggle(ten),
    ];
    assert_eq!(gate_inputs, expected);
    let tank_inputs: Vec<Signal> = plant.modules["tank"].inputs.values().copied().collect();
    let swing = Signal::Swing(Swing {
        from: 120,
        to: 880,
        every: Micros::from_secs(240),
        soft: false,
    });
    assert_eq!(tank_inputs, [Signal::Value(871), swing]);
}

#[test]
fn what_is_wrong_with_the_simulation_has_its_place() {
    let wrong = |from: &str, to: &str, code, line, column, path: &str| {
        assert!(PLANT.contains(from));
        let text = PLANT.replacen(from, to, 1);
        let expected = (code, line, column, path.to_owned());
        assert_eq!(problem(&text), expected, "{to}");
    };
    wrong("seed = 7", "sede = 7", "E0812", 3, 1, "sim.sede");
    wrong("seed = 7", "seed = -1", "E0816", 3, 8, "sim.seed");
    wrong("speed = 2", "speed = 0", "E0814", 4, 9, "sim.speed");
    wrong("tcp =", "tpc =", "E0812", 10, 1, "line.main.sim.tpc");
    wrong(
        "\"127.0.0.1:4001\"",
        "4001",
        "E0814",
        10,
        7,
        "line.main.sim.tcp",
    );
    wrong(
        "noise 1e-4",
        "noise",
        "E0890",
        11,
        10,
        "line.main.sim.faults",
    );
    wrong("drop 5%", "echo", "E0890", 24, 10, "module.gate.sim.faults");
    wrong(
        "factory = true",
        "factory = 1",
        "E0814",
        19,
        11,
        "module.gate.sim.factory",
    );
    wrong(
        "power = \"off\"",
        "power = false",
        "E0815",
        20,
        9,
        "module.gate.sim.power",
    );
    wrong(
        "init = true",
        "dip = 256",
        "E0816",
        21,
        7,
        "module.gate.sim.dip",
    );
    wrong(
        "di0 = 0",
        "di9 = 0",
        "E0821",
        25,
        12,
        "module.gate.sim.inputs.di9",
    );
    wrong(
        "di0 = 0",
        "di0 = 2",
        "E0816",
        25,
        18,
        "module.gate.sim.inputs.di0",
    );
    wrong(
        "\"10s\"",
        "\"10\"",
        "E0818",
        25,
        49,
        "module.gate.sim.inputs.di2.every",
    );
    wrong(
        "to = 8.8, ",
        "",
        "E0813",
        31,
        34,
        "module.tank.sim.inputs.ai2",
    );
    let not_so = ("E0893", "module.gate.sim.inputs.do0");
    wrong("di0 = 0", "do0 = 0", not_so.0, 25, 12, not_so.1);
    wrong(
        "init = true",
        "init_sampled = 1",
        "E0815",
        21,
        16,
        "module.gate.sim.init_sampled",
    );
    // The tables are for these places alone.
    wrong("[sim]", "[simu]", "E0812", 2, 2, "simu");
}

const SAFE: &str = r#"
[line.main]
port = "/dev/ttyUSB0"
[module.oven]
line = "main"
model = "erc8"
address = 3
[module.oven.point.k1]
confirm = "hold"
interlock = ["oven.k2", "pump.do0"]
max_on = "30m"
min_off = "5s"
on_exit = "off"
on_return = "on"
[module.pump]
line = "main"
model = "eda9060a"
address = 1
[group.night]
name = { en = "Night", zh = "夜间" }
members = ["oven.k1", "pump.do1"]
[scene.evening]
steps = [{ set = "oven.k1", to = true }, { wait = "2s" }, { set = "oven.k2", to = false }]
"#;

#[test]
fn what_makes_switching_safe_is_read() {
    let config = Config::parse(SAFE).expect("it is good");
    let place = |path: &str| {
        let (module, label) = path.split_once('.').expect("a path");
        let point = config.modules[module].setup.point(label);
        Place::new(module, point.expect("a point"))
    };
    let k1 = config.safety(&place("oven.k1")).expect("it says so");
    assert_eq!(k1.confirm, Some(Confirm::Hold));
    assert_eq!(k1.max_on, Some(Micros::from_secs(1_800)));
    assert_eq!(k1.min_off, Some(Micros::from_secs(5)));
    assert_eq!((k1.on_exit, k1.on_offline), (Policy::Off, None));
    assert_eq!(k1.on_return, Policy::On);
    for other in ["oven.k2", "pump.do0"] {
        assert!(k1.interlock.contains(&place(other)));
        let back = config.safety(&place(other)).expect("it holds both ways");
        assert!(back.interlock.contains(&place("oven.k1")));
    }
    let night = &config.groups["night"];
    assert_eq!(night.members, [place("oven.k1"), place("pump.do1")]);
    assert_eq!(night.name.zh.as_deref(), Some("夜间"));
    let steps = [
        Step::Set(place("oven.k1"), true),
        Step::Wait(Micros::from_secs(2)),
        Step::Set(place("oven.k2"), false),
    ];
    assert_eq!(config.scenes["evening"].steps, steps);
}

#[test]
fn what_makes_switching_unsafe_is_refused_with_its_place() {
    let of = |from: &str, to: &str| {
        let (code, line, column, path) = problem(&SAFE.replace(from, to));
        (code, (line, column), path)
    };
    let locks = "module.oven.point.k1.interlock".to_owned();
    let lock = |to: &str| of("\"oven.k2\", \"pump", &format!("\"{to}\", \"pump"));
    assert_eq!(lock("oven.k9"), ("E0821", (10, 14), locks.clone()));
    assert_eq!(lock("shed.k1"), ("E0821", (10, 14), locks.clone()));
    assert_eq!(lock("oven.k1"), ("E0866", (10, 14), locks.clone()));
    assert_eq!(lock("pump.di0"), ("E0865", (10, 14), locks));
    let max_on = "module.oven.point.k1.max_on".to_owned();
    assert_eq!(of("30m", "0s"), ("E0868", (11, 10), max_on));
    let confirm = "module.oven.point.k1.confirm".to_owned();
    assert_eq!(of("\"hold\"", "1"), ("E0815", (9, 11), confirm));
    let exit = "module.oven.point.k1.on_exit".to_owned();
    assert_eq!(
        of("exit = \"off\"", "exit = \"out\""),
        ("E0815", (13, 11), exit)
    );
    let members = "group.night.members".to_owned();
    let again = of("\"pump.do1\"", "\"oven.k1\"");
    assert_eq!(again, ("E0867", (21, 23), members.clone()));
    assert_eq!(of("pump.do1", "pump.ai0"), ("E0821", (21, 23), members));
    let steps = "scene.evening.steps".to_owned();
    let step = of("to = true", "wait = \"1s\"");
    assert_eq!(step, ("E0869", (23, 10), steps.clone()));
    assert_eq!(of("\"2s\"", "\"6m\""), ("E0868", (23, 9), steps));
    let input = SAFE.replace("[module.oven.point.k1]", "[module.pump.point.di0]");
    let codes: Vec<_> = problems(&input).into_iter().map(|told| told.0).collect();
    assert_eq!(codes, ["E0865"; 6]);
    // What can't be read makes no second problem of those who name it.
    let (code, ..) = problem(&SAFE.replace("address = 1", "address = 999"));
    assert_eq!(code, "E0816");
}

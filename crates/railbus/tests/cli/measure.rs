//! `bench` and `export`.

use crate::site::Site;

#[test]
fn a_bench_reads_and_says_how_often() {
    let site = Site::demo("bench");
    let ran = site.run("bench --time 300ms -o json");
    let told = ran.json();
    let modules = told["modules"].as_array().expect("a list");
    assert_eq!(modules.len(), 5, "{ran:?}");
    for module in modules {
        assert!(module["n"].as_u64() >= Some(1), "{module}");
        // No reply comes before the request is over.
        assert!(module["p50_ms"].as_f64() > Some(10.0), "{module}");
    }
    assert!(
        told["reads_per_s"].as_f64() <= told["theory_per_s"].as_f64(),
        "{ran:?}"
    );
    // A line on which no module answers.
    let port = format!("-l pty:{}", site.folder.join("line").display());
    let dead = site.run(&format!("{port} -m erc8 -a 9 bench --time 100ms -o json"));
    assert_eq!(
        (dead.code, dead.error()["code"].as_str()),
        (3, Some("E0301")),
        "{dead:?}"
    );
    assert_eq!(site.run("bench --time 5 -o json").code, 2);
    assert_eq!(site.run("-l /dev/none-such -m erc8 -a 3 bench").code, 7);
}

/// It needs exclusive access to the line: if a daemon has it, the error says so, with and without a
/// configuration file, and whether that daemon is named or found.
#[test]
fn a_bench_says_that_a_daemon_has_the_line() {
    let busy = |site: &Site, line: &str| {
        let ran = site.run(&format!("{line} -o json"));
        let error = ran.error();
        assert_eq!((ran.code, ran.out.as_str()), (7, ""), "{line}: {ran:?}");
        assert_eq!(error["code"], "E0706", "{line}: {error}");
        assert_eq!(error["line"], "main", "{line}: {error}");
        let why = error["why"][0].as_str().expect("a reason").to_owned();
        assert!(
            why.ends_with("has the line: stop it while you measure"),
            "{why}"
        );
        // The suggested remedy helps.
        let hint = error["hint"][0].as_str().expect("a hint");
        let told = site.run(hint.strip_prefix("railbus ").expect("a command"));
        assert!(told.out.contains("main"), "{told:?}");
        why
    };
    let mut found = Site::empty("bench-found");
    found.start(&["serve", "--demo", "--listen", "127.0.0.1:0"], "socket");
    let why = busy(&found, "bench --time 100ms");
    assert!(why.contains("the demo"), "{why}");
    busy(&found, "bench --time 100ms -l main");
    let unknown = found.run("bench -l nowhere -o json");
    assert_eq!(unknown.error()["code"], "E0803", "{unknown:?}");
    let mut site = Site::demo("bench-served");
    site.serve();
    busy(
        &site,
        &format!("--socket {} bench --time 100ms", site.socket()),
    );
    // A program that opens it anyway gets the error from the port.
    let direct = site.run("bench --direct --time 100ms -o json");
    assert_eq!(direct.error()["code"], "E0706", "{direct:?}");
}

#[test]
fn an_export_names_what_it_leaves_out() {
    let site = Site::demo("export");
    let pty = site.folder.join("line").display().to_string();
    let ran = site.run("export mbpoll");
    assert_eq!(
        ran.out,
        format!(
            "mbpoll -m rtu -b 9600 -P none -s 1 -a 3 -t 0 -0 -r 60 -c 8 -1 {pty}\n\
             mbpoll -m rtu -b 9600 -P none -s 1 -a 5 -t 0 -0 -r 8 -c 2 -1 {pty}\n\
             mbpoll -m rtu -b 9600 -P none -s 1 -a 5 -t 4 -0 -r 6 -c 2 -1 {pty}\n"
        )
    );
    assert!(
        ran.err
            .ends_with("on a line that mbpoll does not support): gate pump yard\n"),
        "{ran:?}"
    );
    let csv = site.run("export csv").out;
    let mut lines = csv.lines();
    assert_eq!(lines.next().map(|head| head.split(',').count()), Some(13));
    let oven = format!("oven.k1,oven,k1,0,main,pty:{pty},erc8,3,rtu,9600,8N1,,");
    assert!(lines.any(|line| line == oven), "{csv}");
}

/// A file for another program is what comes out, and what is to be done besides is said beside it.
#[test]
fn an_export_for_a_program_is_its_file() {
    let site = Site::empty("export-program");
    let module = "[module.oven]\nline = \"main\"\nmodel = \"erc8\"\naddress = 3\n";
    let text = format!("[line.main]\nport = \"/dev/railbus-test-nothing\"\n{module}");
    site.configure(&text);
    let none = site.run("export ha -o json");
    assert_eq!(
        (none.code, &none.error()["code"]),
        (8, &"E0838".into()),
        "{none:?}"
    );
    let mqtt = |name: &str| format!("[outlet.{name}]\ntype = \"mqtt\"\nsite = \"{name}\"\n");
    site.configure(&format!("{text}{}{}", mqtt("house"), mqtt("scada")));
    let two = site.run("export nodered -o json");
    assert_eq!(
        (two.code, &two.error()["code"]),
        (8, &"E0839".into()),
        "{two:?}"
    );
    assert_eq!(
        two.error()["hint"][0],
        "railbus export nodered --outlet house"
    );
    let home = site.run("export ha --outlet house");
    assert!(home.out.contains("\n    - name: \"k1\"\n"), "{home:?}");
    assert!(home.out.contains("railbus/house/oven/k1/state"), "{home:?}");
    let unknown = site.run("export ha --outlet nosuch -o json");
    assert_eq!(
        unknown.error()["known"],
        serde_json::json!(["house", "scada"]),
        "{unknown:?}"
    );
    let scrape = site.run("export prometheus --url https://gate:7485");
    assert!(
        scrape.out.contains("\n          - \"gate:7485\"\n"),
        "{scrape:?}"
    );
    assert!(
        scrape
            .err
            .starts_with("token: railbus token create prometheus"),
        "{scrape:?}"
    );
    assert_eq!(site.run("export prometheus -q").err, "");
    let wrong = site.run("export prometheus --url gate:7485");
    assert_eq!(wrong.code, 2, "{wrong:?}");
}

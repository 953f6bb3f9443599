//! What commands with many forms print, each form against the published schema.

use crate::liar::liar;
use crate::published::{Forms, keeps_to};
use crate::replay::asked_of_the_demo;
use crate::site::{Ran, Site};
use crate::sniff::{captured, listening};
use serde_json::{Value, json};

/// Runs it for its JSON; the exit code and the texts are as expected.
#[track_caller]
fn run(site: &Site, line: &str, code: i32) -> Vec<Value> {
    let line = match line.contains("-o ndjson") {
        true => format!("-q {line}"),
        false => format!("-q -o json {line}"),
    };
    let ran = site.run(&line);
    assert_eq!(ran.code, code, "{line}: {ran:?}");
    keeps_to(site, &line, &ran)
}

fn rewrite(site: &Site, old: &str, new: &str) {
    let file = site.folder.join("railbus.toml");
    let text = std::fs::read_to_string(file).expect("a file");
    assert!(text.contains(old), "{old} in {text}");
    site.configure(&text.replace(old, new));
}

#[test]
fn every_form_of_config_is_as_published() {
    let site = Site::demo("outputs-config");
    let mut forms = Forms::of(&site, "config");
    for (line, code) in [
        ("config check", 0),
        ("config path", 0),
        ("config show", 0),
        ("--lang zh config show gate yard", 0),
        ("config get tank baud calibration_voltage", 0),
        ("config get pump parity", 8),
        ("config show nobody", 8),
        ("config log", 0),
        ("config backup", 0),
        ("config set pump address=9 -n", 0),
        ("config set tank address=9 -n", 0),
        ("config set pump address=9 baud=19200 --yes", 0),
        ("config set pump address=9 --yes", 0),
        ("config set pump address=1", 2),
        ("config set oven address=5 --yes", 4),
        ("config undo 1 --yes", 0),
        ("config undo 77 --yes", 8),
        ("config recover", 0),
        ("config recover oven", 0),
        ("config calibrate tank --yes", 0),
        ("config calibrate pump --yes", 8),
        ("config factory gate --yes", 8),
        ("config restore none.json", 8),
        ("config diff none.json", 8),
    ] {
        forms.see(&run(&site, line, code));
    }
    assert_eq!(site.run("-q config backup -O kept.json").code, 0);
    for (line, code) in [
        ("config diff kept.json", 0),
        ("config set oven address=7 --yes", 0),
        ("config diff kept.json --exit-code", 10),
        ("config restore kept.json -n", 0),
        ("config restore kept.json", 2),
        ("config restore kept.json --yes", 0),
        ("config factory tank --yes", 0),
        ("--lang zh config log", 0),
    ] {
        forms.see(&run(&site, line, code));
    }
    forms.all_seen();
}

#[test]
fn names_and_areas_are_as_published() {
    let site = Site::demo("outputs-names");
    let tank = "model = \"emd2a2q\"\naddress = 5\n";
    let called = "name = { zh = \"水池\" }\narea = \"Yard\"\npoint.ai2 = { hidden = true }\n";
    rewrite(&site, tank, &format!("{tank}{called}"));
    let all = &run(&site, "ls", 0)[0]["modules"];
    let tank = all.as_array().unwrap().iter();
    let tank = tank
        .clone()
        .find(|module| module["module"] == "tank")
        .unwrap();
    assert_eq!(
        (&tank["name"]["zh"], &tank["area"]),
        (&"水池".into(), &"Yard".into())
    );
    let points = &run(&site, "ls points tank", 0)[0]["points"];
    let hidden = points.as_array().unwrap().iter();
    assert_eq!(hidden.filter(|point| point["hidden"] == true).count(), 1);
    run(&site, "ls lines", 0);
}

#[test]
fn plans_and_what_was_applied_are_as_published() {
    let site = Site::demo("outputs-plan");
    let mut forms = Forms::of(&site, "apply");
    run(&site, "plan", 0);
    run(&site, "plan nobody", 8);
    let tank = "model = \"emd2a2q\"\naddress = 5\n";
    let settings = "[module.tank.settings]\ncalibration_voltage = \"4.00V\"\n";
    rewrite(&site, tank, &format!("{tank}{settings}"));
    let tank = &run(&site, "plan tank --exit-code", 10)[0]["plan"][0];
    assert_eq!(tank["state"], "change", "{tank}");
    let voltage = &tank["set"]["calibration_voltage"]["wanted"];
    assert_eq!(voltage, "4.00 V", "{tank}");
    forms.see(&run(&site, "apply", 2));
    forms.see(&run(&site, "apply -n", 0));
    forms.see(&run(&site, "apply --yes -O report.json", 0));
    let report = || Ran {
        code: 0,
        out: std::fs::read_to_string(site.folder.join("report.json")).expect("a file"),
        err: String::new(),
    };
    forms.see(&keeps_to(&site, "apply", &report()));
    forms.all_seen();
    // A module that does not answer, and the rest is left alone.
    let dead = format!("pty:{}", liar(|_| Vec::new()));
    let text = "model = \"erc8\"\naddress = 9\n";
    site.configure(&format!(
        "[line.main]\nport = \"{dead}\"\n[module.gone]\nline = \"main\"\n{text}"
    ));
    let gone = &run(&site, "--lang zh plan", 0)[0]["plan"][0];
    assert_eq!(gone["state"], "missing", "{gone}");
    run(&site, "apply --yes -O report.json", 3);
    let told = &keeps_to(&site, "apply", &report())[0]["applied"][0];
    assert_eq!(told["done"], false, "{told}");
    // A line that can't be opened: its modules are unknown.
    site.configure(&format!(
        "[line.main]\nport = \"/dev/none-such\"\n[module.gone]\nline = \"main\"\n{text}"
    ));
    run(&site, "plan", 7);
}

#[test]
fn every_form_of_scan_is_as_published() {
    let site = Site::demo("outputs-scan");
    let mut forms = Forms::of(&site, "scan");
    forms.see(&run(&site, "scan --addr 1-6 --timeout 200ms", 0));
    let stream = run(&site, "scan --addr 1,5 --timeout 200ms -o ndjson", 0);
    assert!(stream.len() > 2, "{stream:?}");
    forms.see(&stream);
    run(&site, "scan --addr 1-40 --max-time 1s", 11);
    run(&site, "scan --addr 1-40 --max-time 1s --follow", 11);
    run(&site, "scan --addr 5-1", 2);
    forms.all_seen();
    let port = liar(|_| vec![3, 0xFF, 0xFE, 0, 0, 0]);
    let two = run(
        &site,
        &format!("scan -l pty:{port} --addr 3 --proto rtu"),
        0,
    );
    assert_eq!(two[0]["found"][0]["verdict"], "garbled", "{two:?}");
}

#[test]
fn captures_read_and_replayed_are_as_published() {
    let site = Site::demo("outputs-captures");
    let file = captured(&site).display().to_string();
    for flags in ["", "-o ndjson ", "--lang zh "] {
        let heard = run(&site, &format!("{flags}sniff --read {file}"), 0);
        let events: Vec<_> = heard.iter().map(|one| one["event"].clone()).collect();
        assert!(events.contains(&"no_reply".into()), "{events:?}");
        let decoded = run(&site, &format!("{flags}decode -f {file}"), 0);
        assert_eq!(decoded.len(), heard.len());
    }
    run(&site, "sniff --read none.pcapng", 1);
    run(&site, "decode -f none.pcapng", 1);
    let asked = asked_of_the_demo(&site);
    let played = run(&site, &format!("replay {asked} --as-host"), 0);
    let results: Vec<_> = played.iter().map(|one| one["result"].clone()).collect();
    for result in ["same", "differs", "skipped"] {
        assert!(results.contains(&result.into()), "{results:?}");
    }
    run(&site, &format!("replay {asked} --as-host --exit-code"), 10);
    run(&site, &format!("replay {asked} --as-host --writes"), 2);
    run(&site, "replay none.pcapng --as-host", 1);
}

#[test]
fn every_form_of_set_is_as_published() {
    let site = Site::demo("outputs-set");
    let mut forms = Forms::of(&site, "set");
    forms.see(&run(&site, "set pump.do0 on", 0));
    forms.see(&run(&site, "set oven all=off -n", 0));
    let all = "set -l main --all-boards on";
    run(&site, all, 2);
    forms.see(&run(&site, &format!("{all} --confirm broadcast"), 0));
    forms.see(&run(&site, "set pump.do0=on tank.k9=on", 11));
    forms.all_seen();
}

/// Both run until they are stopped; what they serve is printed first, and nothing else on stdout.
#[test]
fn what_a_simulator_serves_is_as_published() {
    let site = Site::empty("outputs-sim");
    let modules = include_str!("modules.toml");
    site.configure(&format!("[line.main]\nport = \"/dev/none\"\n{modules}"));
    let pty = site.folder.join("line").display().to_string();
    for what in ["--demo", "railbus.toml"] {
        let arguments = ["sim", what, "-o", "json", "-v", "--pty", &pty];
        let tcp = ["--tcp", "127.0.0.1:0"];
        let (mut child, _) = listening(&site, &[&arguments[..], &tcp].concat(), "EVENT");
        child.kill().expect("it runs");
        let out = child.wait_with_output().expect("it ran").stdout;
        let ran = Ran {
            code: 0,
            out: String::from_utf8(out).expect("text"),
            err: String::new(),
        };
        let told = keeps_to(&site, "sim", &ran);
        assert_eq!(told.len(), 1, "{ran:?}");
        let line = &told[0]["lines"][0];
        assert_eq!(
            (&line["line"], &line["modules"]),
            (&"main".into(), &5.into())
        );
    }
}

/// With a daemon and without one: what is shown, what would be sent, what is done, and how it ends.
#[test]
fn groups_and_scenes_are_shown_tried_and_played() {
    const MORE: &str = "[group.night]\nmembers = [\"yard.k1\", \"oven.k2\", \"yard.k2\"]\n\
        [scene.evening]\nname = { en = \"Evening\", zh = \"傍晚\" }\nsteps = [\n\
        { set = \"yard.k1\", to = true }, { set = \"yard.k2\", to = true }, { wait = \"20ms\" },\n\
        { set = \"oven.k2\", to = true }]\n\
        [scene.guarded]\nsteps = [{ set = \"yard.k1\", to = false },\n\
        { set = \"pump.do0\", to = true }, { set = \"yard.k2\", to = false }]\n\
        [module.pump.point.do0]\nconfirm = \"hold\"\n";
    let mut site = Site::demo("outputs-scenes");
    let file = site.folder.join("railbus.toml");
    let text = std::fs::read_to_string(file).expect("a file");
    site.configure(&format!("{text}\n{MORE}"));
    for served in [false, true] {
        if served {
            site.serve();
        }
        let mut forms = Forms::of(&site, "scene");
        let asked = if served {
            format!("--socket {} ", site.socket())
        } else {
            String::new()
        };
        let run = |line: &str, code| run(&site, &format!("{asked}{line}"), code);
        let one = |line: &str, code| run(line, code).remove(0);

        let listed = one("scene list", 0);
        assert_eq!(listed["scenes"][0]["steps"][2]["wait_ms"], 20, "{listed}");
        assert_eq!(
            one("--lang zh scene list", 0)["scenes"][0]["name"]["zh"],
            "傍晚"
        );
        let frames = one("scene run evening -n", 0);
        let frames = frames["frames"].as_array().expect("a list").clone();
        let modules: Vec<_> = frames.iter().map(|frame| frame["module"].clone()).collect();
        assert_eq!(modules, ["yard", "oven"], "{frames:?}");
        assert_eq!(
            one("get yard.k1 --fresh", 0)["points"][0]["value"],
            served,
            "nothing was sent"
        );
        let played = one("scene run evening", 0);
        assert_eq!(played["set"].as_array().map(Vec::len), Some(3), "{played}");
        assert_eq!(played["set"][2]["confirmed"], "readback");

        // The frames that the group is shown to be sent in; toggled, all of it goes off.
        let off = one("set @night off -n", 0);
        assert_eq!(off["frames"].as_array().map(Vec::len), Some(2), "{off}");
        assert_eq!(one("set @night toggle -n", 0), off);
        assert_eq!(
            one("get oven.k2 --fresh", 0)["points"][0]["value"],
            true,
            "nothing was sent"
        );
        let refused = |line: &str| {
            let ran = site.run(&format!("-q -o json {asked}{line}"));
            (ran.code, ran.error()["code"].clone())
        };
        assert_eq!(refused("set @nobody off -n"), (8, "E0860".into()));

        // What follows the failed step is not done.
        let cut = run("scene run guarded", 11);
        let ends = cut[0]["set"].as_array().expect("a list").clone();
        assert_eq!(ends[0]["value"], false, "{cut:?}");
        assert_eq!(ends[1]["error"]["code"], "E0450", "{cut:?}");
        assert!(ends[2]["error"].is_object(), "{cut:?}");
        assert_eq!(one("get yard.k2", 0)["points"][0]["value"], true, "{cut:?}");
        run("scene run guarded --yes", 0);
        run("set yard k1=on k2=on", 0);
        for line in ["scene run nobody", "scene run nobody -n"] {
            assert_eq!(refused(line), (8, "E0861".into()), "{line}");
        }
        assert_eq!(refused("scene").0, 2);
        forms.see(&[listed, played, json!({"schema": 1, "frames": frames})]);
        forms.all_seen();
    }
    assert_eq!(site.run("complete -- scene run ev").out, "evening\n");
}

//! The files of a fleet: what is written where, and never over something else.

use crate::published::{Forms, keeps_to};
use crate::site::Site;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;

fn mode(path: &Path) -> u32 {
    let found = std::fs::metadata(path).expect("it is there");
    found.permissions().mode() & 0o777
}

#[test]
fn a_fleet_is_made_whole_and_left_alone_afterwards() {
    let site = Site::empty("fleet");
    let (acme, creds) = (site.folder.join("acme"), site.folder.join("plant7.creds"));
    let (at, to) = (acme.display().to_string(), creds.display().to_string());
    let mut forms = Forms::of(&site, "fleet");
    let mut one = |line: &str| {
        let line = format!("{line} -o json");
        let documents = keeps_to(&site, &line, &site.run(&line));
        forms.see(&documents);
        documents[0].clone()
    };
    let made = one(&format!("fleet init {at} --nats nats1,nats2,nats3:5000"));
    assert_eq!(made["folders"][4]["server"], "nats3:5000");
    let conf = std::fs::read_to_string(acme.join("server3/nats.conf")).expect("it is there");
    assert!(conf.contains("listen: \"0.0.0.0:5000\""), "{conf}");
    assert_eq!(mode(&acme), 0o700);
    assert_eq!(mode(&acme.join("hub/site-signing.nk")), 0o600);
    assert_eq!(mode(&acme.join("server1/nats.conf")), 0o644);

    let key = one(&format!("fleet creds {at} plant7 {to}"));
    assert_eq!(
        (&key["site"], &key["file"]),
        (&"plant7".into(), &to.as_str().into())
    );
    assert_eq!(mode(&creds), 0o600);
    // A new fleet has one.
    let key = one(&format!("fleet config-key {at}"));
    assert_eq!(key["made"], false);
    forms.all_seen();

    let before = std::fs::read_to_string(&creds).expect("it is there");
    for line in [
        format!("fleet init {at} --nats nats1"),
        format!("fleet creds {at} plant8 {to}"),
    ] {
        let again = site.run(&format!("{line} -o json"));
        assert_eq!((again.code, &again.error()["code"]), (1, &"E0160".into()));
        // It says which file, and tells no secret.
        let why = again.error()["why"][0].to_string();
        assert!(why.contains(&at) || why.contains(&to), "{why}");
        assert!(again.out.is_empty(), "{again:?}");
    }
    assert_eq!(
        std::fs::read_to_string(&creds).expect("it is there"),
        before
    );
    let left = std::fs::read_dir(&site.folder).expect("a folder");
    assert_eq!(left.count(), 2, "the fleet and the key");
}

#[test]
fn what_can_be_no_fleet_leaves_nothing_behind() {
    let site = Site::empty("fleet-refused");
    let acme = site.folder.join("acme");
    let at = acme.display().to_string();
    for nats in [
        "a,b",
        "a,a,b",
        "a:0",
        "a b",
        "",
        "a,b,c,d",
        "../a",
        "a,b,c,d,e,f,g",
    ] {
        let ran = site
            .command()
            .args(["fleet", "init", &at, "--nats", nats])
            .output();
        let ran = ran.expect("railbus starts");
        assert_eq!(ran.status.code(), Some(2), "{nats}: {ran:?}");
    }
    let none = site.run(&format!("fleet creds {at} plant7 {at}.creds -o json"));
    assert_eq!(none.error()["code"], "E0160", "{none:?}");
    assert_eq!(site.run(&format!("fleet init {at} --nats a")).code, 0);
    for name in ["Plant", "a.b", "*", "a/b"] {
        let ran = site.run(&format!("fleet creds {at} {name} {at}.creds"));
        assert_eq!(ran.code, 2, "{name}: {ran:?}");
    }
    // However a folder is written.
    let slash = format!("{}/", site.folder.join("other").display());
    assert_eq!(site.run(&format!("fleet init {slash} --nats a")).code, 0);
    assert!(site.folder.join("other/server1/nats.conf").is_file());
    std::fs::remove_dir_all(site.folder.join("other")).expect("it is there");
    // A key that is no key of a fleet.
    std::fs::write(acme.join("hub/site-signing.nk"), "SAAA\n").expect("it can be written");
    let broken = site.run(&format!("fleet creds {at} plant7 {at}.creds -o json"));
    assert_eq!(broken.error()["code"], "E0160", "{broken:?}");
    assert!(
        broken.error()["why"][0]
            .to_string()
            .contains("site-signing.nk")
    );
    let left = std::fs::read_dir(&site.folder).expect("a folder");
    assert_eq!(left.count(), 1, "the fleet alone");
}

#[test]
fn a_link_for_the_first_user_needs_a_centre_that_listens() {
    let site = Site::empty("fleet-link");
    let at = site.folder.join("acme").display().to_string();
    assert_eq!(site.run(&format!("fleet init {at} --nats a")).code, 0);
    let none = site.run(&format!("user setup-link --fleet {at} -o json"));
    assert_eq!(none.error()["code"], "E0109", "{none:?}");
    let try_it = none.error()["hint"][0].to_string();
    assert!(
        try_it.contains("railbus fleet serve") && try_it.contains("--listen"),
        "{try_it}"
    );
}

#[test]
fn a_fleet_without_a_key_for_configurations_gets_one_and_keeps_it() {
    let site = Site::empty("fleet-config-key");
    let acme = site.folder.join("acme");
    let at = acme.display().to_string();
    assert_eq!(site.run(&format!("fleet init {at} --nats a")).code, 0);
    let file = acme.join("hub/config-signing.nk");
    let line = format!("fleet config-key {at}");
    let first = site.run(&line);
    let is_key = |text: &str| text.len() == 57 && text.starts_with('V') && text.ends_with('\n');
    assert!(first.code == 0 && is_key(&first.out), "{first:?}");
    assert_eq!(first.err, "");

    std::fs::remove_file(&file).expect("it is there");
    let made = site.run(&line);
    assert!(made.code == 0 && is_key(&made.out), "{made:?}");
    assert_ne!(made.out, first.out);
    assert!(made.err.contains("the key is new"), "{made:?}");
    assert_eq!(mode(&file), 0o600);
    let seed = std::fs::read_to_string(&file).expect("it is there");
    for _ in 0..2 {
        let again = site.run(&line);
        assert_eq!((&again.out, again.err.as_str()), (&made.out, ""));
    }
    assert_eq!(std::fs::read_to_string(&file).expect("it is there"), seed);

    // What is no key is not replaced by one.
    let other = acme.join("hub/site-signing.nk");
    for text in [
        std::fs::read_to_string(other).expect("it is there"),
        String::new(),
    ] {
        std::fs::write(&file, &text).expect("it can be written");
        let broken = site.run(&format!("{line} -o json"));
        assert_eq!((broken.code, &broken.error()["code"]), (1, &"E0160".into()));
        let why = broken.error()["why"][0].to_string();
        assert!(why.contains("config-signing.nk"), "{why}");
        assert_eq!(std::fs::read_to_string(&file).expect("it is there"), text);
    }
    // Nor is one made where there is no fleet.
    let none = site.folder.join("none");
    let none_there = site.run(&format!("fleet config-key {}", none.display()));
    assert_eq!(none_there.code, 1, "{none_there:?}");
    assert!(!none.exists());
}

#[test]
fn two_commands_make_one_key() {
    let site = Site::empty("fleet-config-keys");
    let acme = site.folder.join("acme");
    let at = acme.display().to_string();
    assert_eq!(site.run(&format!("fleet init {at} --nats a")).code, 0);
    std::fs::remove_file(acme.join("hub/config-signing.nk")).expect("it is there");
    let begun: Vec<_> = (0..8)
        .map(|_| {
            let mut command = site.command();
            command.args(["fleet", "config-key", &at]);
            command.stdout(std::process::Stdio::piped());
            command.stderr(std::process::Stdio::piped());
            command.spawn().expect("railbus starts")
        })
        .collect();
    let keys: std::collections::BTreeSet<Vec<u8>> = begun
        .into_iter()
        .map(|child| child.wait_with_output().expect("it ends").stdout)
        .collect();
    assert_eq!(keys.len(), 1, "{keys:?}");
}

#[test]
fn what_is_no_order_for_a_configuration_asks_nobody() {
    let site = Site::empty("fleet-config");
    let file = site.folder.join("plant7.toml");
    std::fs::write(&file, "").expect("it can be written");
    let file = file.display().to_string();
    for line in [
        "fleet config".to_owned(),
        "fleet config Plant7".to_owned(),
        "fleet config a/b".to_owned(),
        "fleet config plant7 --replace 1a2b3c4d".to_owned(),
        "fleet config plant7 --no-wait".to_owned(),
        "fleet config plant7 --text --wanted".to_owned(),
        format!("fleet config plant7 {file} --text"),
        format!("fleet config plant7 {file} --wanted"),
        format!("fleet config plant7 {file} {file}"),
        format!("fleet config Plant7 {file}"),
        "fleet config-key".to_owned(),
    ] {
        let ran = site.run(&line);
        assert_eq!((ran.code, ran.out.as_str()), (2, ""), "{line}: {ran:?}");
    }
    // A file that can't be read, before a centre that is not there.
    let missing = site.run(&format!("fleet config plant7 {file}.none -o json"));
    assert_eq!(missing.error()["code"], "E0160", "{missing:?}");
    let socket = site.folder.join("none.sock").display().to_string();
    for line in [
        "fleet config plant7".to_owned(),
        "fleet config plant7 --text".to_owned(),
        format!("fleet config plant7 {file}"),
    ] {
        let ran = site.run(&format!("{line} --socket {socket} -o json"));
        assert_eq!(ran.error()["code"], "E0109", "{line}: {ran:?}");
        let hint = ran.error()["hint"][0].to_string();
        assert!(hint.contains("railbus fleet serve"), "{line}: {hint}");
    }
}

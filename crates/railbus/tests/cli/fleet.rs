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

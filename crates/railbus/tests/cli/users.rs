//! Users and tokens, where no daemon runs and where one does.

use crate::published::{Forms, keeps_to};
use crate::site::{Ran, Site};
use std::os::unix::fs::PermissionsExt;

const SITE: &str = "[line.main]\nport = \"/dev/railbus-test-nothing\"\n\
                    [module.oven]\nline = \"main\"\nmodel = \"erc8\"\naddress = 3\n";

/// A command with a password on its stdin, or none.
fn run(site: &Site, line: &str) -> Ran {
    let line = line.split(' ').collect::<Vec<_>>();
    site.run_with(&line, "correct horse battery\n")
}

fn walk(site: &Site, at: &str) {
    let mut users = Forms::of(site, "user");
    let mut tokens = Forms::of(site, "token");
    let steps = [
        ("user add li --role admin --password-file -", 0),
        (
            "user add wang --role operator --points pump.*,oven.k1 --password-file -",
            0,
        ),
        ("user add wang --role viewer --password-file -", 9),
        ("user lock wang", 0),
        ("user unlock wang", 0),
        ("user lock li", 9),
        ("user remove li", 9),
        ("user passwd wang --password-file -", 0),
        ("user passwd zhao --password-file -", 9),
        ("user setup-link", if at.is_empty() { 1 } else { 9 }),
        ("user list", 0),
        ("user remove wang", 0),
        ("token create ci --role viewer --expires 7d", 0),
        ("token create ci --role viewer", 9),
        ("token list", 0),
        ("token revoke ci", 0),
        ("token revoke ci", 9),
    ];
    for (step, code) in steps {
        let line = format!("{step} -o json{at}");
        let ran = run(site, &line);
        assert_eq!(ran.code, code, "{line}: {ran:?}");
        let all = format!("{}{}", ran.out, ran.err);
        assert!(
            !all.contains("correct horse") && !all.contains("$argon2id$"),
            "{all}"
        );
        let documents = keeps_to(site, &line, &ran);
        match step.starts_with("user") {
            true => users.see(&documents),
            false => tokens.see(&documents),
        }
        if step == "user list" {
            assert_eq!(documents[0]["users"][1]["points"][1], "oven.k1");
        }
    }
    tokens.all_seen();
    if !at.is_empty() {
        let fresh = Site::served("users-link");
        let line = format!("user setup-link -o json --socket {}", fresh.socket());
        users.see(&keeps_to(&fresh, &line, &fresh.run(&line)));
        users.all_seen();
    }
}

#[test]
fn without_a_daemon_the_file_is_changed_and_is_the_owners_alone() {
    let site = Site::empty("users-file");
    site.configure(SITE);
    walk(&site, "");
    let file = site.folder.join(".railbus/accounts.json");
    let mode = std::fs::metadata(&file)
        .expect("a file")
        .permissions()
        .mode();
    assert_eq!(mode & 0o777, 0o600);
    let kept = std::fs::read_to_string(file).expect("text");
    assert!(kept.contains("$argon2id$v=19$m=19456,t=2,p=1$"), "{kept}");
    assert!(
        !kept.contains("correct horse") && !kept.contains("rb_"),
        "{kept}"
    );
}

#[test]
fn with_a_daemon_it_is_asked_and_its_file_is_left_alone() {
    let mut site = Site::empty("users-daemon");
    site.configure(SITE);
    site.serve();
    let at = format!(" --socket {}", site.socket());
    walk(&site, &at);
    let direct = site.run("user list -o json");
    assert_eq!((direct.code, &direct.error()["code"]), (9, &"E0917".into()));
}

#[test]
fn passwords_are_asked_for_and_never_come_from_the_command_line() {
    let site = Site::empty("users-ask");
    site.configure(SITE);
    let weak = site.run_with(
        &[
            "user",
            "add",
            "li",
            "--role",
            "admin",
            "--password-file",
            "-",
        ],
        "short\n",
    );
    assert_eq!(weak.code, 9, "{weak:?}");
    assert!(weak.err.contains("E0913"), "{weak:?}");
    let argument = site.run("user add li --role admin --password correct-horse-battery");
    assert_eq!(argument.code, 2, "{argument:?}");
    let none = site.run("user add li --role boss --password-file -");
    assert_eq!(none.code, 2, "{none:?}");
    let token = run(&site, "token create ci --role viewer --expires 0d");
    assert_eq!(token.code, 2, "{token:?}");
}

#[test]
fn a_table_and_a_bare_token_are_for_people_and_scripts() {
    let site = Site::empty("users-table");
    site.configure(SITE);
    let made = run(&site, "token create ci --role operator --points pump.*");
    assert!(
        made.out.starts_with("rb_") && made.out.trim().len() == 67,
        "{made:?}"
    );
    assert!(
        made.err.starts_with("ci (operator), valid until "),
        "{made:?}"
    );
    let listed = run(&site, "token list --lang zh");
    assert!(
        listed.out.contains("ci") && listed.out.contains("pump.*"),
        "{listed:?}"
    );
    assert!(
        listed.out.contains("有效期至") && !listed.out.contains("rb_"),
        "{listed:?}"
    );
    let added = run(
        &site,
        "user add 李工 --role admin --password-file - --lang zh",
    );
    assert_eq!(added.out, "已添加 李工\n");
}

/// The suggested commands work: an account that does not exist yet has no password to change.
#[test]
fn without_a_terminal_the_same_command_is_told_with_a_file() {
    let site = Site::empty("users-no-terminal");
    site.configure("");
    for line in ["user add li --role admin", "user passwd li"] {
        let command = site.command();
        let mut alone = std::process::Command::new("setsid");
        alone
            .arg("-w")
            .arg(command.get_program())
            .args(line.split(' '));
        let variables = command
            .get_envs()
            .filter_map(|(name, value)| Some((name, value?)));
        alone.envs(variables).current_dir(&site.folder);
        let output = alone.stdin(std::process::Stdio::null()).output();
        let told = String::from_utf8(output.expect("it runs").stderr).expect("text");
        let way = format!("railbus {line} --password-file FILE");
        assert!(told.contains(&way), "{told}");
    }
}

//! Completion scripts in the shells they are for, and manual pages as `man` reads them. A shell
//! that is not installed is left out.

use crate::site::Site;
use std::path::Path;
use std::process::Command;

/// What a shell prints, with our program in its path; none where there is no such shell.
fn told(site: &Site, shell: &[&str], script: &str) -> Option<String> {
    let program = Path::new(env!("CARGO_BIN_EXE_railbus"));
    let folder = program.parent().expect("a folder").display();
    let path = std::env::var("PATH").unwrap_or_default();
    let (name, flags) = shell.split_first().expect("a shell");
    let mut command = Command::new(name);
    command.args(flags).arg(script).current_dir(&site.folder);
    command
        .env("PATH", format!("{folder}:{path}"))
        .env("HOME", &site.folder)
        .env("RAILBUS_RUN", site.folder.join("run"));
    command.env_remove("RAILBUS_CONFIG");
    let output = command.output().ok()?;
    assert!(output.status.success(), "{shell:?}: {output:?}");
    Some(String::from_utf8(output.stdout).expect("text"))
}

fn site(name: &str) -> Site {
    let site = Site::empty(name);
    site.configure(
        "[line.main]\nport = \"/dev/none-such\"\n\
         [module.pump]\nline = \"main\"\nmodel = \"eda9060a\"\naddress = 1\n\
         [module.oven]\nline = \"main\"\nmodel = \"erc8\"\naddress = 3\n",
    );
    site
}

#[test]
fn bash_completes_commands_flags_and_points() {
    let site = site("bash");
    let complete = |words: &str| {
        let script = format!(
            "source <(railbus completions bash); COMP_WORDS=(railbus {words}); \
             COMP_CWORD=$(( ${{#COMP_WORDS[@]}} - 1 )); \
             _railbus_named railbus \"${{COMP_WORDS[COMP_CWORD]}}\" \
             \"${{COMP_WORDS[COMP_CWORD-1]}}\"; printf '%s\\n' \"${{COMPREPLY[@]}}\""
        );
        told(&site, &["bash", "--norc", "-c"], &script)
    };
    let Some(commands) = complete("sc") else {
        return;
    };
    assert_eq!(
        commands.lines().collect::<Vec<_>>(),
        ["scan", "scene", "schema"]
    );
    let has = |words: &str, wanted: &[&str]| {
        let found = complete(words).expect("it was there a moment ago");
        for wanted in wanted {
            assert!(
                found.lines().any(|line| line == *wanted),
                "{words}: {wanted}: {found}"
            );
        }
    };
    has("get pum", &["pump", "pump.do0", "pump.di3"]);
    has("set pump.do", &["pump.do0", "pump.do3"]);
    has("get --fr", &["--fresh"]);
    has("explain D10", &["D102"]);
    has("-l ma", &["main"]);
    assert!(
        !complete("set pump.").expect("bash").contains("pump.di0"),
        "no input can be set"
    );
}

#[test]
fn other_shells_take_their_scripts() {
    let site = site("shells");
    let zsh = "autoload -U compinit; compinit -u; source <(railbus completions zsh); \
               whence -w _railbus_named";
    if let Some(said) = told(&site, &["zsh", "-f", "-c"], zsh) {
        assert_eq!(said, "_railbus_named: function\n");
    }
    let fish = "railbus completions fish | source; complete -C 'railbus get pump.do'";
    if let Some(said) = told(&site, &["fish", "--no-config", "-c"], fish) {
        assert!(
            said.lines().any(|line| line.starts_with("pump.do0")),
            "{said}"
        );
    }
}

/// Names are those of the daemon that the command would use, if it answers at once; otherwise those
/// of the file.
#[test]
fn names_are_asked_of_the_daemon() {
    let mut served = Site::served("complete");
    let socket = served.socket();
    let told = |site: &Site, words: &str| site.run(&format!("complete -- {words}")).out;
    let asked = format!("--socket {socket}");
    assert_eq!(
        told(&served, &format!("{asked} set tank.")),
        "tank.k1\ntank.k2\n"
    );
    assert_eq!(told(&served, &format!("{asked} config show ga")), "gate\n");
    assert_eq!(told(&served, &format!("{asked} -l ")), "main\n");
    // Without a flag, a daemon of another site is not asked.
    let own = site("complete-own");
    assert_eq!(told(&own, "set pump.do3"), "pump.do3\n");
    assert_eq!(told(&own, "get ga"), "");
    served.start(&["serve", "--demo", "--listen", "127.0.0.1:0"], "socket");
    assert_eq!(told(&served, "get gat").lines().next(), Some("gate"));
    // One that accepts the connection and never answers.
    let mute = own.folder.join("mute");
    let _mute = std::os::unix::net::UnixListener::bind(&mute).expect("a socket");
    let begun = std::time::Instant::now();
    let names = told(&own, &format!("--socket {} get ov", mute.display()));
    assert!(names.starts_with("oven\noven.k1\n"), "{names}");
    assert!(begun.elapsed() < std::time::Duration::from_secs(2));
}

#[test]
fn names_are_given_in_silence_whatever_is_wrong() {
    let site = Site::empty("silence");
    site.configure("[line.main\n");
    for words in ["get pu", "get --config nosuch.toml pu", "nosuch x", "-l ma"] {
        let ran = site.run(&format!("complete -- {words}"));
        assert_eq!(
            (ran.code, ran.out.as_str(), ran.err.as_str()),
            (0, "", ""),
            "{words}"
        );
    }
    let ran = site.run("complete --");
    assert_eq!((ran.code, ran.err.as_str()), (0, ""), "{ran:?}");
}

#[test]
fn scripts_and_pages_go_where_they_are_found() {
    let site = Site::empty("install");
    let run = |line: &str| {
        let mut command = site.command();
        command
            .args(line.split(' '))
            .env("XDG_DATA_HOME", site.folder.join("data"));
        let output = command
            .env("XDG_CONFIG_HOME", site.folder.join("set"))
            .output();
        let output = output.expect("it runs");
        assert!(output.status.success(), "{line}: {output:?}");
        String::from_utf8(output.stdout).expect("text")
    };
    for shell in ["bash", "zsh", "fish", "powershell", "elvish"] {
        let path = run(&format!("completions {shell} --install"));
        let text = std::fs::read_to_string(path.trim()).expect("a file");
        assert_eq!(text, run(&format!("completions {shell}")), "{shell}");
    }
    let pages = run("man --install");
    assert!(pages.contains("data/man/man1/railbus.1\n"), "{pages}");
    assert!(
        pages.contains("data/man/zh_CN/man1/railbus-config-check.1\n"),
        "{pages}"
    );
    let folder = site.folder.join("pages");
    assert_eq!(
        run(&format!("man --dir {}", folder.display()))
            .lines()
            .count(),
        pages.lines().count()
    );
    // A folder that can't be made.
    std::fs::write(site.folder.join("file"), "").expect("a file");
    let ran = site.run("man --dir file -o json");
    assert_eq!(
        (ran.code, ran.error()["code"].as_str()),
        (1, Some("E0195")),
        "{ran:?}"
    );
    // groff's messages about a page are none.
    for (lang, page) in [("en", "set"), ("zh", "doctor")] {
        let page = run(&format!("--lang {lang} man {page}"));
        std::fs::write(site.folder.join("page.1"), page).expect("a file");
        let groff = "groff -k -man -Tutf8 -ww -z page.1 2>&1";
        if Path::new("/usr/bin/groff").exists() {
            let said = told(&site, &["sh", "-c"], groff).unwrap_or_default();
            assert_eq!(said, "", "{lang}");
        }
    }
}

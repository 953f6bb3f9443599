//! `railbus completions`: scripts with which a shell completes commands, flags, and the names of
//! modules and points.

mod texts;

use super::install;
use crate::args;
use crate::cli;
use clap::{Arg, ArgAction, ArgMatches, Command};
use clap_complete::{Shell, generate};
use railbus_app::failure::Failure;
use railbus_app::render::out;
use railbus_words::Lang;
use std::path::PathBuf;
use texts::CompletionsText;

/// The name of the command.
pub(crate) const NAME: &str = "completions";

const SHELLS: [(&str, Shell); 5] = [
    ("bash", Shell::Bash),
    ("zsh", Shell::Zsh),
    ("fish", Shell::Fish),
    ("powershell", Shell::PowerShell),
    ("elvish", Shell::Elvish),
];

/// Its parser and help.
pub(crate) fn define(lang: Lang) -> Command {
    let usage = "railbus completions bash|zsh|fish|powershell|elvish [--install]";
    args::verb(lang, NAME, CompletionsText::About, usage)
        .before_help(args::examples(lang, CompletionsText::Examples))
        .arg(
            Arg::new("SHELL")
                .help(lang.get(CompletionsText::Shell))
                .value_parser(SHELLS.map(|(name, _)| name))
                .hide_possible_values(true)
                .required(true),
        )
        .arg(args::flag(lang, "install", CompletionsText::Install).action(ArgAction::SetTrue))
}

/// Prints the script, or installs it where the shell looks for it.
pub(crate) fn run(lang: Lang, matches: &ArgMatches) -> Result<(), Failure> {
    let name = matches.get_one::<String>("SHELL").map(String::as_str);
    let named = SHELLS.into_iter().find(|(known, _)| name == Some(*known));
    let (_, shell) = named.unwrap_or(SHELLS[0]);
    let script = script(lang, shell);
    if !matches.get_flag("install") {
        return out::result(lang, &script);
    }
    let (path, next) = place(shell);
    install::write(lang, &path, script.as_bytes())?;
    out::result(lang, &format!("{}\n", path.display()))?;
    if let Some(next) = next {
        let folder = path.parent().unwrap_or(&path).display().to_string();
        let line = next.replace("{folder}", &folder);
        let line = line.replace("{path}", &path.display().to_string());
        out::note(&lang.fill(CompletionsText::Next, &[("line", &line)]));
    }
    Ok(())
}

/// The script: commands and flags as they are now, and a call of `railbus complete` for the names
/// of the site.
fn script(lang: Lang, shell: Shell) -> String {
    let mut bytes = Vec::new();
    generate(shell, &mut cli::define(lang), "railbus", &mut bytes);
    let fixed = String::from_utf8_lossy(&bytes).into_owned();
    match shell {
        Shell::PowerShell => {
            // A shell runs one completer per program: ours has to be within it.
            let (at, names) = (
                "    $completions.Where{",
                include_str!("completions/names.ps1"),
            );
            fixed.replacen(at, &format!("{names}{at}"), 1)
        }
        Shell::Zsh => {
            let names = include_str!("completions/names.zsh");
            fixed
                .replace("compdef _railbus railbus", "compdef _railbus_named railbus")
                .replace("    _railbus \"$@\"\n", "    _railbus_named \"$@\"\n")
                .replacen(
                    "if [ \"$funcstack[1]\"",
                    &format!("{names}\nif [ \"$funcstack[1]\""),
                    1,
                )
        }
        Shell::Bash => fixed + include_str!("completions/names.bash"),
        Shell::Fish => fixed + include_str!("completions/names.fish"),
        _ => fixed + include_str!("completions/names.elv"),
    }
}

/// Where the shell looks for it, and the line for the shell's settings if it does not look there by
/// itself.
fn place(shell: Shell) -> (PathBuf, Option<&'static str>) {
    let (data, settings) = (install::data_folder(), install::settings_folder());
    match shell {
        Shell::Bash => (data.join("bash-completion/completions/railbus"), None),
        Shell::Zsh => (
            data.join("zsh/site-functions/_railbus"),
            Some("~/.zshrc: fpath=({folder} $fpath); autoload -U compinit; compinit"),
        ),
        Shell::Fish => (data.join("fish/vendor_completions.d/railbus.fish"), None),
        Shell::PowerShell => (
            settings.join("powershell/railbus.ps1"),
            Some("$PROFILE: . {path}"),
        ),
        _ => (
            settings.join("elvish/lib/railbus.elv"),
            Some("rc.elv: use railbus"),
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_script_knows_the_commands_and_asks_for_the_names() {
        for (name, shell) in SHELLS {
            for lang in [Lang::En, Lang::Zh] {
                let script = script(lang, shell);
                assert!(script.contains("railbus complete --"), "{name}");
                for command in ["scan", "pulse", "decode", "doctor"] {
                    assert!(script.contains(command), "{name}: {command}");
                }
            }
        }
    }
}

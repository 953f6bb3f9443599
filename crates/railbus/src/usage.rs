//! Errors of the parser, in the user's language.

use crate::texts::Text;
use clap::error::{ContextKind, ContextValue, ErrorKind};
use railbus_app::failure::Failure;
use railbus_site::config::resembles;
use railbus_words::Code;
use railbus_words::Lang;

/// The parser's error in texts of the catalogue. `verb` is the command that was called, if any.
pub(crate) fn failure(lang: Lang, error: &clap::Error, verb: Option<&str>) -> Failure {
    let of = |kind| error.get(kind).map(text).unwrap_or_default();
    let name = of(ContextKind::InvalidArg);
    let value = of(ContextKind::InvalidValue);
    let message = match error.kind() {
        ErrorKind::InvalidSubcommand => {
            let name = of(ContextKind::InvalidSubcommand);
            lang.fill(Text::NoSuchCommand, &[("name", &name)])
        }
        ErrorKind::UnknownArgument => lang.fill(Text::NoSuchArgument, &[("name", &name)]),
        ErrorKind::InvalidValue | ErrorKind::ValueValidation if value.is_empty() => {
            lang.fill(Text::NoValue, &[("name", &name)])
        }
        ErrorKind::InvalidValue | ErrorKind::ValueValidation => {
            lang.fill(Text::BadValue, &[("name", &name), ("value", &value)])
        }
        ErrorKind::MissingSubcommand => lang.get(Text::MissingCommand).to_owned(),
        ErrorKind::MissingRequiredArgument => lang.fill(Text::MissingArgument, &[("name", &name)]),
        ErrorKind::ArgumentConflict | ErrorKind::TooManyValues => {
            lang.fill(Text::Conflict, &[("name", &name)])
        }
        _ => lang.get(Text::BadArguments).to_owned(),
    };
    let meant = [
        (
            ContextKind::SuggestedSubcommand,
            ContextKind::InvalidSubcommand,
        ),
        (ContextKind::SuggestedArg, ContextKind::InvalidArg),
        (ContextKind::SuggestedValue, ContextKind::InvalidValue),
    ];
    // The parser also suggests words that are not similar at all.
    let meant = meant.into_iter().filter_map(|(suggested, said)| {
        let (suggested, said) = (of(suggested), of(said));
        let said = said.trim_start_matches('-');
        let near = |word: &&str| !word.is_empty() && resembles(word.trim_start_matches('-'), said);
        let near: Vec<&str> = suggested.split(' ').filter(near).collect();
        (!near.is_empty()).then(|| near.join(" "))
    });
    let valid = Some(of(ContextKind::ValidValue)).filter(|valid| !valid.is_empty());
    let help = match verb {
        Some(verb) => format!("railbus help {verb}"),
        None => "railbus help".to_owned(),
    };
    let mut failure = Failure::new(Code::Usage, message);
    if let Some(variable) = variable(&name, &value) {
        let values: &[(&str, &dyn std::fmt::Display)] =
            &[("variable", &variable), ("value", &value)];
        failure = failure.because(lang.fill(Text::FromEnvironment, values));
    }
    meant
        .chain(valid)
        .fold(failure, Failure::with_try)
        .with_try(help)
}

/// The environment variable that a wrong value of a flag comes from: it does not show on the
/// command line.
fn variable(flag: &str, value: &str) -> Option<String> {
    let flag = flag.split(' ').next()?.strip_prefix("--")?;
    let name = format!("RAILBUS_{}", flag.to_uppercase().replace('-', "_"));
    (!value.is_empty() && std::env::var(&name).ok()? == value).then_some(name)
}

fn text(value: &ContextValue) -> String {
    match value {
        ContextValue::String(text) => text.clone(),
        ContextValue::Strings(texts) => texts.join(" "),
        ContextValue::StyledStr(text) => text.to_string(),
        _ => String::new(),
    }
}

#[cfg(test)]
mod tests {
    use crate::cli;
    use railbus_words::Lang;
    use std::ffi::OsString;

    fn told(lang: Lang, line: &str) -> String {
        let arguments = line.split(' ').map(OsString::from).collect();
        let failure = cli::run(lang, arguments).err();
        failure
            .map(|failure| failure.render(lang))
            .unwrap_or_default()
    }

    #[test]
    fn wrong_arguments_are_named() {
        let told = |line| told(Lang::En, line);
        assert!(told("railbus simm").contains("no command \"simm\"\n  try:    sim"));
        assert!(told("railbus sim --demmo").contains("no argument \"--demmo\"\n  try:    --demo"));
        assert!(told("railbus sim --demo --seed x").contains("invalid value \"x\" for --seed"));
        assert!(told("railbus sim --demo --seed").contains("--seed"));
        // A word that is not similar is not suggested, and the help is that of the command.
        let far = told("railbus nosuch");
        assert_eq!(far.lines().count(), 2, "{far}");
        assert!(told("railbus get --nosuch").contains("try:    railbus help get"));
        assert!(told("railbus sim").contains("<FILE|--demo> is missing"));
        assert!(told("railbus").contains("a command is missing"));
        assert!(told("railbus sim --demo --lang fr").contains("try:    en zh"));
    }

    #[test]
    fn and_in_chinese() {
        let text = told(Lang::Zh, "railbus sim --demo --seed x");
        assert!(
            text.starts_with("错误[E0201]：\"x\" 不能作为 --seed"),
            "{text}"
        );
    }
}

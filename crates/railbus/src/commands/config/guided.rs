//! `railbus config calibrate` and `config factory`: guided step by step (EMD-2A2Q).

use super::config_context::{ConfigContext, state_flag};
use super::drive::{Driver, must_ask};
use super::set::{self, Changed, finish, tell};
use super::show::words;
use super::texts::ConfigText;
use crate::args;
use crate::commands::Context;
use clap::{Arg, ArgAction, ArgMatches, Command};
use railbus_app::failure::Failure;
use railbus_app::render::out;
use railbus_app::render::records::Records;
use railbus_app::render::table::Table;
use railbus_app::settings::outcome;
use railbus_app::settings::outcome::hindered;
use railbus_app::settings::target::Target;
use railbus_commission::settings::{Key, Wanted, Wrong, range};
use railbus_commission::{
    Calibrated, ChangeOrigin, Ended, Job, calibrate as calibration, restore_factory,
};
use railbus_wire::SerialSettings;
use railbus_words::Code;
use railbus_words::Lang;
use serde_json::json;

/// The names of the commands.
pub(super) const CALIBRATE: &str = "calibrate";
pub(super) const FACTORY: &str = "factory";

fn arguments(lang: Lang, command: Command) -> Command {
    command
        .arg(
            Arg::new("MODULE")
                .help(lang.get(ConfigText::Module))
                .required(true),
        )
        .arg(
            args::flag(lang, "yes", ConfigText::Yes)
                .short('y')
                .action(ArgAction::SetTrue),
        )
        .arg(state_flag(lang))
}

pub(super) fn define_calibrate(lang: Lang) -> Command {
    let usage = "railbus config calibrate MODULE [--voltage 5.00V]";
    let command = args::verb(lang, CALIBRATE, ConfigText::CalibrateAbout, usage)
        .before_help(args::examples(lang, ConfigText::CalibrateExamples));
    arguments(lang, command)
        .arg(args::flag(lang, "voltage", ConfigText::CalibrateVoltage).value_name("5.00V"))
}

pub(super) fn define_factory(lang: Lang) -> Command {
    let command = args::verb(
        lang,
        FACTORY,
        ConfigText::FactoryAbout,
        "railbus config factory MODULE",
    )
    .before_help(args::examples(lang, ConfigText::FactoryExamples));
    arguments(lang, command)
}

/// The module, and the work to do on it.
fn prepare(
    context: &Context,
    cfg: &ConfigContext,
    matches: &ArgMatches,
    by: ChangeOrigin,
) -> Result<(Target, Job), Failure> {
    let names = words(matches, "MODULE");
    let target = cfg.target(context, names.first().map_or("", String::as_str))?;
    if !target.setup.family.datasheet().is_calibrated() {
        let told = format!("{} ({})", target.name, target.setup.family);
        return Err(Failure::of(context.lang, Code::SettingFixed).because(told));
    }
    if !matches.get_flag("yes") {
        must_ask(context)?;
    }
    let job = Job {
        change: 0,
        line: target.line.clone(),
        module: target.name.clone(),
        setup: target.setup,
        wanted: Wanted::default(),
        neighbours: target.neighbours.clone(),
        by,
        undoes: None,
    };
    Ok((target, job))
}

/// Guides the user through a calibration.
pub(super) fn calibrate(lang: Lang, matches: &ArgMatches) -> Result<(), Failure> {
    let context = Context::of(lang, matches)?;
    let cfg = ConfigContext::of(&context, matches)?;
    let (target, job) = prepare(&context, &cfg, matches, ChangeOrigin::Calibrate)?;
    let text = matches
        .get_one::<String>("voltage")
        .map_or("5.00V", String::as_str);
    let mut wanted = Wanted::default();
    let setting = Key::CalibrationVoltage.to_string();
    wanted.set(&target.setup, &setting, text).map_err(|_| {
        let possible = range(&target.setup, Key::CalibrationVoltage);
        let wrong = Wrong::Value(Key::CalibrationVoltage, text.to_owned(), possible);
        outcome::wrong(context.lang, &target, &wrong)
    })?;
    let voltage = wanted.kept.voltage.unwrap_or_default();
    let (number, done) = context.block(async {
        let mut driver = Driver::open(&context, &target, Some(cfg.store(&context)?)).await?;
        driver.assume_yes(matches.get_flag("yes"));
        let number = driver.journal.next_change();
        let job = Job {
            change: number,
            ..job
        };
        let done = driver.run(calibration(job, voltage)).await;
        let done = done.map_err(|trouble| outcome::trouble(context.lang, &target, &trouble))?;
        Ok((number, done))
    })?;
    show(&context, &target, number, &done)?;
    match done.hindered {
        None => Ok(()),
        Some(why) => Err(hindered(context.lang, &target, why)),
    }
}

fn show(context: &Context, target: &Target, number: u64, done: &Calibrated) -> Result<(), Failure> {
    let lang = context.lang;
    let head = ["", "ai1", "ai2"];
    let mut table = Table::new(head);
    let volts = |hundredths: u16| format!("{}.{:02}", hundredths / 100, hundredths % 100);
    let steps = [
        (ConfigText::Before, done.before),
        (ConfigText::AfterZero, done.zero),
        (ConfigText::AfterSpan, done.span),
    ];
    for (step, readings) in steps {
        if let Some([first, second]) = readings {
            table.add([lang.get(step).to_owned(), volts(first), volts(second)]);
        }
    }
    let values = |readings: Option<[u16; 2]>| {
        readings.map(|both| both.map(|hundredths| f64::from(hundredths) / 100.0))
    };
    let row = json!({
        "module": target.name,
        "change": done.zero.map(|_| number),
        "before": values(done.before),
        "zero": values(done.zero),
        "span": values(done.span),
    });
    let columns = &["module", "change"];
    let records = Records {
        key: "calibrated",
        rows: vec![row],
        columns,
        value: "change",
        table,
    };
    out::result(lang, &records.render(context.format))
}

/// Resets a module to its factory settings.
pub(super) fn factory(lang: Lang, matches: &ArgMatches) -> Result<(), Failure> {
    let context = Context::of(lang, matches)?;
    let cfg = ConfigContext::of(&context, matches)?;
    let (target, job) = prepare(&context, &cfg, matches, ChangeOrigin::Factory)?;
    let changed = context.block(async {
        let mut driver = Driver::open(&context, &target, Some(cfg.store(&context)?)).await?;
        context.note(&lang.fill(ConfigText::FactoryWarning, &[("module", &target.name)]));
        let sure = matches.get_flag("yes") || driver.agreed(lang.get(ConfigText::GoOn)).await;
        if !sure {
            return Err(Failure::of(lang, Code::NotConfirmed));
        }
        let number = driver.journal.next_change();
        let before =
            railbus_commission::Kept::at(railbus_commission::BusAddress::of(&target.setup));
        set::follows_port(&context, &target, &driver, SerialSettings::FACTORY)?;
        let end = driver
            .run(restore_factory(Job {
                change: number,
                ..job
            }))
            .await;
        let end = end.map_err(|trouble| outcome::trouble(context.lang, &target, &trouble))?;
        finish(&context, &cfg, &mut driver, &target, number, &end).await?;
        Ok(match end {
            Ended::Done(found) => Some(Changed {
                target: target.clone(),
                number,
                found,
                before,
                same: false,
            }),
            _ => None,
        })
    })?;
    tell(&context, changed.into_iter().collect())
}

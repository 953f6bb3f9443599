//! Keeps the configuration file in step with the module.

use super::config_context::ConfigContext;
use super::drive::Driver;
use super::texts::ConfigText;
use crate::commands::Context;
use railbus_app::config_file::text_of;
use railbus_app::failure::Failure;
use railbus_app::settings::outcome::{not_followed, placed};
use railbus_commission::{BusAddress, JournalRecord, RecordState};
use railbus_site::config::edit;

/// Writes where the module is now into the configuration. Nothing to do if flags describe the
/// module, or if the file is right already.
pub(super) async fn follow(
    context: &Context,
    cfg: &ConfigContext,
    driver: &mut Driver<'_>,
    record: Option<JournalRecord>,
    module: &str,
    place: BusAddress,
) -> Result<(), Failure> {
    let lang = context.lang;
    let Some(file) = &cfg.file else {
        let hint = lang.fill(ConfigText::NoFile, &[("place", &placed(lang, place))]);
        context.note(&hint);
        return Ok(());
    };
    let configured = cfg.config.modules.get(module);
    if configured.is_some_and(|known| BusAddress::of(&known.setup) == place) {
        return Ok(());
    }
    let failed = |why: String| not_followed(lang, file, module, place, &why);
    let before = text_of(file).map_err(|problem| failed(problem.text("reason")))?;
    let text = edit::moved(&before, module, place);
    let text = text.ok_or_else(|| failed(lang.get(ConfigText::NotThere).to_owned()))?;
    edit::replace(file, Some(&before), &text).map_err(|error| failed(error.to_string()))?;
    context.note(&lang.fill(ConfigText::Filed, &[("file", &file.display())]));
    if let Some(record) = record {
        // The file is right already: if this fails, a recovery will only confirm that.
        let state = RecordState::Filed;
        driver.journal.keep(JournalRecord { state, ..record }).await;
    }
    Ok(())
}

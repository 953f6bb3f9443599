//! The configuration follows the module.

use super::drive::Driver;
use super::ground::Ground;
use super::texts::ConfigText;
use crate::commands::Context;
use railbus_app::config_file::text_of;
use railbus_app::failure::Failure;
use railbus_app::settings::outcome::{not_followed, placed};
use railbus_commission::{Place, Record, State};
use railbus_site::config::edit;

/// Puts the module where it is heard now. Nothing is to be done where flags name it, or where the
/// file says so already.
pub(super) fn follow(
    context: &Context,
    ground: &Ground,
    driver: &mut Driver<'_>,
    record: Option<Record>,
    module: &str,
    place: Place,
) -> Result<(), Failure> {
    let lang = context.lang;
    let Some(file) = &ground.file else {
        let hint = lang.fill(ConfigText::NoFile, &[("place", &placed(lang, place))]);
        context.note(&hint);
        return Ok(());
    };
    let configured = ground.config.modules.get(module);
    if configured.is_some_and(|known| Place::of(&known.setup) == place) {
        return Ok(());
    }
    let failed = |why: String| not_followed(lang, file, module, place, &why);
    let before = text_of(file).map_err(|problem| failed(problem.text("reason")))?;
    let text = edit::moved(&before, module, place);
    let text = text.ok_or_else(|| failed(lang.get(ConfigText::NotThere).to_owned()))?;
    edit::replace(file, Some(&before), &text).map_err(|error| failed(error.to_string()))?;
    context.note(&lang.fill(ConfigText::Filed, &[("file", &file.display())]));
    if let Some(record) = record {
        // The file is right already: should this fail, a recovery only finds that it is.
        let _ = driver.keep(Record {
            state: State::Filed,
            ..record
        });
    }
    Ok(())
}

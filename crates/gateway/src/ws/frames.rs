//! The frames of a line with their meaning. Nothing is sent on the line for it, and without
//! subscribers it does no work.

use super::{Gone, Out};
use crate::frame_listener::{FrameListener, modules};
use railbus_app::api::convert;
use railbus_app::frames::{Facts, as_json};
use railbus_host::Tap;
use railbus_site::{Service, Update};
use railbus_wire::SerialSettings;
use railbus_words::Lang;
use serde_json::Value;

/// How many frames are sent at once; more wait at the line, which drops the oldest.
const BATCH_MAX: usize = 64;

/// Follows a line through all its ports.
pub(super) async fn follow(
    service: Service,
    line: String,
    lang: Lang,
    mut out: Out,
) -> Result<(), Gone> {
    let mut updates = service.subscribe();
    out.snapshot(&[0; 0]).await?;
    loop {
        if let Ok((now, tap)) = service.tap(&line).await {
            let settings = service.line(&line).map(|status| status.serial);
            let mut listener = FrameListener::new(
                convert::start_of(now),
                settings.unwrap_or(SerialSettings::FACTORY),
            );
            listen(&service, (&line, lang), tap, &mut listener, &mut out).await?;
        }
        // Its port is closed: it may be lent, or come back with another configuration.
        loop {
            match updates.next().await {
                None => return Ok(()),
                Some(Update::Line(name)) if name == line => break,
                Some(Update::Reloaded | Update::Gap(_)) => break,
                Some(_) => {}
            }
        }
    }
}

/// Until the line is closed.
async fn listen(
    service: &Service,
    (line, lang): (&str, Lang),
    mut tap: Tap,
    listener: &mut FrameListener,
    out: &mut Out,
) -> Result<(), Gone> {
    let mut heard = Vec::new();
    loop {
        let due = listener.hear(&mut heard);
        tokio::select! {
            biased;
            passed = tap.next(), if heard.len() < BATCH_MAX => match passed {
                None => return Ok(()),
                Some(Ok(passed)) => listener.take(&passed, &mut heard),
                Some(Err(count)) => {
                    out.dropped(count).await?;
                    out.snapshot(&[0; 0]).await?;
                }
            },
            () = out.paced(), if !heard.is_empty() => {
                let modules = modules(service, line);
                let records: Vec<Value> = heard
                    .drain(..)
                    .map(|heard| as_json(lang, line, &heard, &Facts::of(&heard, &modules)))
                    .collect();
                out.delta("frames", &records).await?;
            }
            () = listener.until(due) => listener.timeout(),
        }
    }
}

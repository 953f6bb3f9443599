//! The state of points, modules and lines, and its changes.

use super::print::View;
use super::{Gone, Out};
use crate::site::Site;
use railbus_site::News;

/// Sends the complete state, then changes, at the pace of the site's own stream.
pub(super) async fn follow(site: &Site, view: View, mut out: Out) -> Result<(), Gone> {
    let mut follower = site.service.follow();
    while let Some(news) = follower.next().await {
        let text = site.printer.of(&news).text(&site.service, &view);
        match (news, text) {
            (News::Picture(_), Some(text)) => {
                if follower.missed() > 0 {
                    out.dropped(follower.missed()).await?;
                }
                out.tell("snapshot", "data", &text).await?;
            }
            (News::Batch(_), Some(text)) => out.tell("delta", view.key(), &text).await?,
            (_, None) => {}
        }
    }
    Ok(())
}

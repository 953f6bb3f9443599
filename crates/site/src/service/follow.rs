//! The stream of a site, for whoever follows it.

use super::{Inner, Service};
use crate::core::{News, Picture};
use std::sync::{Arc, Weak};
use tokio::sync::broadcast::{
    Receiver,
    error::{RecvError, TryRecvError},
};

/// How many batches wait for a slow follower before it gets a picture instead.
pub(super) const NEWS_MAX: usize = 256;

/// A follower of a site. It does not keep the site from ending.
#[derive(Debug)]
pub struct Follower {
    site: Weak<Inner>,
    news: Receiver<News>,
    /// What comes first.
    picture: Option<Arc<Picture>>,
    seq: u64,
    changes: u64,
    missed: u64,
}

impl Service {
    /// How everything is, and then what changes: made once for all who follow.
    #[must_use]
    pub fn follow(&self) -> Follower {
        let (picture, news) = self.inner.follow();
        Follower {
            site: Arc::downgrade(&self.inner),
            news,
            seq: picture.seq,
            changes: picture.changes,
            picture: Some(picture),
            missed: 0,
        }
    }
}

impl Follower {
    /// The next of it: a picture first, and again with another configuration and after a gap
    /// ([`Follower::missed`]); none once the site has gone. Can be dropped and called again
    /// without losing anything.
    pub async fn next(&mut self) -> Option<News> {
        self.missed = 0;
        loop {
            if let Some(picture) = self.picture.take() {
                return Some(self.begin_with(picture));
            }
            match self.news.recv().await {
                // It is in the picture already.
                Ok(news) if news.seq() <= self.seq => {}
                Ok(news) => {
                    (self.seq, self.changes) = (news.seq(), news.changes());
                    return Some(news);
                }
                Err(RecvError::Lagged(_)) => {
                    let (picture, news) = self.site.upgrade()?.follow();
                    (self.picture, self.news) = (Some(picture), news);
                }
                Err(RecvError::Closed) => return None,
            }
        }
    }

    /// What has changed by now and was not yet told, without waiting for the pace of the stream;
    /// none where there is nothing more. A follower that calls this until then knows the effect of
    /// every command that had ended before.
    pub fn next_now(&mut self) -> Option<News> {
        self.missed = 0;
        let site = self.site.upgrade()?;
        site.drive(|core, now| core.finish_stream(now));
        loop {
            if let Some(picture) = self.picture.take() {
                return Some(self.begin_with(picture));
            }
            match self.news.try_recv() {
                Ok(news) if news.seq() <= self.seq => {}
                Ok(news) => {
                    (self.seq, self.changes) = (news.seq(), news.changes());
                    return Some(news);
                }
                Err(TryRecvError::Lagged(_)) => {
                    let (picture, news) = site.follow();
                    (self.picture, self.news) = (Some(picture), news);
                }
                Err(TryRecvError::Empty | TryRecvError::Closed) => return None,
            }
        }
    }

    fn begin_with(&mut self, picture: Arc<Picture>) -> News {
        self.missed = picture.changes.saturating_sub(self.changes);
        (self.seq, self.changes) = (picture.seq, picture.changes);
        News::Picture(picture)
    }

    /// How many changes this follower missed before the picture that it was given last, because it
    /// was too slow; 0 where it missed none.
    #[must_use]
    pub const fn missed(&self) -> u64 {
        self.missed
    }
}

impl Inner {
    /// How everything is, and what is told after that.
    fn follow(self: &Arc<Inner>) -> (Arc<Picture>, Receiver<News>) {
        // What is told before the lock is given back is in the picture.
        self.drive(|core, now| (core.follow(now), self.news.subscribe()))
    }
}

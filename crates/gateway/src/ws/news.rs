//! How points, modules and lines are, and what of that changes.

use super::{Gone, Out};
use railbus_api::types::{LineInfo, ModuleInfo, PointInfo};
use railbus_app::api::{ask, convert, paths};
use railbus_site::{Service, Update, Updates};
use serde::Serialize;
use std::collections::BTreeMap;
use std::time::Duration;
use tokio::time::{MissedTickBehavior, interval};

/// How often a client's view is compared with what is known: values grow old and counters count
/// without anything being told of it.
const LOOK: Duration = Duration::from_secs(1);

/// What is looked at.
#[derive(Clone, Debug)]
pub(super) enum View {
    /// The points that one of these selects; all without any.
    Points(Vec<String>),
    Modules,
    Lines,
}

/// One of it, as it is.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
enum Item {
    Point(PointInfo),
    Module(ModuleInfo),
    Line(LineInfo),
}

impl Item {
    fn name(&self) -> &str {
        match self {
            Item::Point(point) => &point.path,
            Item::Module(module) => &module.module,
            Item::Line(line) => &line.line,
        }
    }

    /// Without what changes all the time, and can be reckoned by who was told before.
    fn lasting(&self) -> Item {
        match self {
            Item::Point(point) => Item::Point(PointInfo {
                age_ms: None,
                time: None,
                ..point.clone()
            }),
            other => other.clone(),
        }
    }
}

impl View {
    const fn key(&self) -> &'static str {
        match self {
            View::Points(_) => "points",
            View::Modules => "modules",
            View::Lines => "lines",
        }
    }

    fn all(&self, service: &Service) -> Vec<Item> {
        match self {
            View::Points(selectors) => {
                let points = ask::points(service, selectors).into_iter();
                points.map(Item::Point).collect()
            }
            View::Modules => ask::modules(service)
                .into_iter()
                .map(Item::Module)
                .collect(),
            View::Lines => ask::lines(service).into_iter().map(Item::Line).collect(),
        }
    }

    /// What an update concerns.
    fn touched(&self, service: &Service, update: &Update) -> Vec<Item> {
        match (self, update) {
            (View::Points(selectors), Update::Point(change)) => {
                let point = service.point(&change.module, change.point);
                let point = point.map(convert::point);
                let wanted =
                    point.filter(|point| paths::selects(selectors, &point.module, &point.label));
                wanted.map(Item::Point).into_iter().collect()
            }
            // All its points are good or bad with it.
            (View::Points(_), Update::Module(_) | Update::Line(_)) => self.all(service),
            (View::Modules, Update::Point(change)) => module(service, &change.module),
            (View::Modules, Update::Module(name)) => module(service, name),
            (View::Modules, Update::Line(_)) => self.all(service),
            (View::Lines, Update::Line(name)) => {
                let line = service.line(name).map(convert::line);
                line.map(Item::Line).into_iter().collect()
            }
            _ => Vec::new(),
        }
    }
}

fn module(service: &Service, name: &str) -> Vec<Item> {
    let status = service.module(name);
    let module = status.map(|status| convert::module(service, status));
    module.map(Item::Module).into_iter().collect()
}

/// What a client was told, and what it will be told next. Bounded by what the site has.
#[derive(Default)]
struct Known {
    told: BTreeMap<String, Item>,
    waiting: BTreeMap<String, Item>,
}

impl Known {
    fn learn(&mut self, items: Vec<Item>) {
        for item in items {
            let lasting = item.lasting();
            if self.told.get(item.name()) != Some(&lasting) {
                self.told.insert(item.name().to_owned(), lasting);
                self.waiting.insert(item.name().to_owned(), item);
            }
        }
    }

    fn begin(&mut self, items: &[Item]) {
        let told = items
            .iter()
            .map(|item| (item.name().to_owned(), item.lasting()));
        self.told = told.collect();
        self.waiting.clear();
    }
}

/// Tells how everything is, and then what changes.
pub(super) async fn follow(service: Service, view: View, mut out: Out) -> Result<(), Gone> {
    let mut updates = service.subscribe();
    let mut known = Known::default();
    let mut look = interval(LOOK);
    look.set_missed_tick_behavior(MissedTickBehavior::Delay);
    look.tick().await;
    begin(&service, &view, &mut known, &mut out).await?;
    loop {
        tokio::select! {
            // What has come is told together: one reply may change many points.
            biased;
            update = updates.next() => match update {
                None => return Ok(()),
                Some(Update::Reloaded) => begin(&service, &view, &mut known, &mut out).await?,
                Some(Update::Gap(count)) => {
                    let count = count.saturating_add(pass_over(&mut updates).await);
                    out.dropped(count).await?;
                    begin(&service, &view, &mut known, &mut out).await?;
                }
                Some(update) => known.learn(view.touched(&service, &update)),
            },
            () = out.paced(), if !known.waiting.is_empty() => {
                let waiting = std::mem::take(&mut known.waiting);
                let items: Vec<Item> = waiting.into_values().collect();
                out.delta(view.key(), &items).await?;
            }
            _ = look.tick() => known.learn(view.all(&service)),
        }
    }
}

async fn begin(
    service: &Service,
    view: &View,
    known: &mut Known,
    out: &mut Out,
) -> Result<(), Gone> {
    let items = view.all(service);
    known.begin(&items);
    out.snapshot(&items).await
}

/// Passes over what is waiting, which a snapshot makes needless; says how much it was.
async fn pass_over(updates: &mut Updates) -> u64 {
    let mut count = 0;
    while let Ok(Some(_)) = tokio::time::timeout(Duration::ZERO, updates.next()).await {
        count += 1;
    }
    count
}

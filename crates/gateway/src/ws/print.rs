//! News of the site in words of the API, made once for all clients that hear the same.

use railbus_app::api::convert;
use railbus_device::PointKind;
use railbus_site::{News, PointStatus, Service, paths};
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

/// How many news are remembered. A client that is further behind has them made for itself.
const NEWS_MAX: usize = 16;

/// What is looked at.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum View {
    /// The points that one of these selects; all without any.
    Points(Vec<String>),
    Modules,
    Lines,
}

impl View {
    pub(super) const fn key(&self) -> &'static str {
        match self {
            View::Points(_) => "points",
            View::Modules => "modules",
            View::Lines => "lines",
        }
    }
}

/// What was made of the newest news.
#[derive(Debug, Default)]
pub(crate) struct Printer(Mutex<VecDeque<Arc<Printed>>>);

impl Printer {
    /// These news, in words.
    pub(super) fn of(&self, news: &News) -> Arc<Printed> {
        let mut newest = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(printed) = newest.iter().find(|printed| is_same(&printed.news, news)) {
            return Arc::clone(printed);
        }
        let printed = Arc::new(Printed {
            news: news.clone(),
            points: OnceLock::new(),
            texts: Mutex::default(),
        });
        if newest.len() >= NEWS_MAX {
            newest.pop_front();
        }
        newest.push_back(Arc::clone(&printed));
        printed
    }
}

/// Whether it is one and the same: the picture of a site in which nothing happens has the same
/// number again and again, but other ages.
fn is_same(a: &News, b: &News) -> bool {
    match (a, b) {
        (News::Picture(a), News::Picture(b)) => Arc::ptr_eq(a, b),
        (News::Batch(a), News::Batch(b)) => Arc::ptr_eq(a, b),
        _ => false,
    }
}

/// A text that is made on first use; `None` if there is nothing to send.
type Text = Arc<OnceLock<Option<Arc<str>>>>;

/// News, and what was made of them.
#[derive(Debug)]
pub(super) struct Printed {
    news: News,
    points: OnceLock<Vec<Point>>,
    texts: Mutex<BTreeMap<View, Text>>,
}

/// A point as JSON.
#[derive(Debug)]
struct Point {
    module: String,
    label: String,
    json: String,
}

impl Printed {
    /// What of the news one view shows, as an array in JSON; none where that is nothing new.
    pub(super) fn text(&self, service: &Service, view: &View) -> Option<Arc<str>> {
        let text = {
            let mut texts = self.texts.lock().unwrap_or_else(PoisonError::into_inner);
            match texts.get(view) {
                Some(text) => Arc::clone(text),
                None => Arc::clone(texts.entry(view.clone()).or_default()),
            }
        };
        text.get_or_init(|| self.print(service, view)).clone()
    }

    fn print(&self, service: &Service, view: &View) -> Option<Arc<str>> {
        let items: Vec<String> = match view {
            View::Points(selectors) => {
                let points = self.points().iter();
                let points =
                    points.filter(|point| paths::selects(selectors, &point.module, &point.label));
                return array(&self.news, points.map(|point| point.json.as_str()));
            }
            View::Modules => {
                let named = |name| Some(json(&convert::module(service, service.module(name)?)));
                self.modules().into_iter().filter_map(named).collect()
            }
            View::Lines => {
                let lines = match &self.news {
                    News::Picture(picture) => &picture.lines,
                    News::Batch(batch) => &batch.lines,
                };
                // The last of each is how it is.
                let lines = lines.iter().map(|line| (&line.name, line));
                let lines = lines.collect::<BTreeMap<_, _>>().into_values();
                lines
                    .map(|line| json(&convert::line(line.clone())))
                    .collect()
            }
        };
        array(&self.news, items.iter().map(String::as_str))
    }

    /// The points of the news, each as it is in the end.
    fn points(&self) -> &[Point] {
        self.points.get_or_init(|| match &self.news {
            News::Picture(picture) => picture.points.iter().map(print_point).collect(),
            News::Batch(batch) => {
                let points = batch.points.iter().map(|reading| &reading.status);
                let newest = points.map(|status| ((&status.module, status.point), status));
                let newest: BTreeMap<_, _> = newest.collect();
                newest.into_values().map(print_point).collect()
            }
        })
    }

    /// The names of the modules that may be shown otherwise: what their outputs and inputs are is
    /// a part of that.
    fn modules(&self) -> BTreeSet<&str> {
        match &self.news {
            News::Picture(picture) => picture.modules.iter().map(|m| m.name.as_str()).collect(),
            News::Batch(batch) => {
                let shown = |kind| matches!(kind, PointKind::Output | PointKind::Input);
                let points = batch.points.iter().map(|reading| &reading.status);
                let points = points.filter(|status| shown(status.point.kind));
                let modules = batch.modules.iter().chain(&batch.figures);
                let modules = modules.map(|module| module.name.as_str());
                modules
                    .chain(points.map(|point| point.module.as_str()))
                    .collect()
            }
        }
    }
}

fn print_point(status: &PointStatus) -> Point {
    Point {
        module: status.module.clone(),
        label: status.label.clone(),
        json: json(&convert::point(status.clone())),
    }
}

fn json(item: &impl Serialize) -> String {
    serde_json::to_string(item).unwrap_or_default()
}

/// All of them; none of a batch is no news.
fn array<'a>(news: &News, items: impl Iterator<Item = &'a str>) -> Option<Arc<str>> {
    let mut text = String::from("[");
    for item in items {
        if text.len() > 1 {
            text.push(',');
        }
        text.push_str(item);
    }
    let is_nothing = text.len() == 1 && matches!(news, News::Batch(_));
    text.push(']');
    (!is_nothing).then(|| text.into())
}

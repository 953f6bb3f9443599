//! A node, a host that holds what hosts may rely on, and what happens between them.

use super::super::super::payload::{PropertyKind, PropertySet};
use super::super::*;
use railbus_host::Presence;
use railbus_site::{
    Batch, Config, Picture, PointQuality, PointReading, PointStatus, PointValue, Role, Service,
};
use railbus_store::outbox::{EntryKind, OutboxEntry};
use std::collections::BTreeSet;
use std::time::SystemTime;

pub(super) const SITE: &str = "[line.main]\nport = \"/dev/ttyS99\"\n\
    [module.oven]\nline = \"main\"\n\
    model = \"erc8\"\naddress = 3\n[module.pump]\nline = \"main\"\nmodel = \"eda9060a\"\n\
    address = 4\n";
/// The time at which everything begins.
pub(super) const BEGIN: u64 = 1_700_000_000_000;

/// How a site with this configuration is at its beginning.
pub(super) async fn picture(text: &str) -> Arc<Picture> {
    let config = Config::parse(text).unwrap();
    let service = Service::start(config).unwrap();
    match service.follow().next().await.unwrap() {
        News::Picture(picture) => picture,
        News::Batch(_) => panic!("a picture comes first"),
    }
}

pub(super) fn wall_time(millis: u64) -> SystemTime {
    SystemTime::UNIX_EPOCH + Duration::from_millis(millis)
}

/// A host application: it holds what a host may rely on.
#[derive(Debug, Default)]
pub(super) struct HostJudge {
    pub(super) seq: Option<u64>,
    /// The metrics of each birth, by device; `""` is the node.
    pub(super) born: BTreeMap<String, BTreeSet<String>>,
    /// Every message as `DDATA oven k1=true`.
    pub(super) told: Vec<String>,
    pub(super) bd_seq: Option<u64>,
    /// Between which times changes may be missing.
    pub(super) missing: Option<(Option<u64>, u64)>,
    /// The times of `k1`, as they were told.
    pub(super) times: Vec<u64>,
}

impl HostJudge {
    pub(super) fn heard(&mut self, message: &Message) {
        assert!(!message.is_retained);
        let levels: Vec<&str> = message.topic.split('/').collect();
        assert_eq!((levels[0], levels[1], levels[3]), ("spBv1.0", "g", "n"));
        let (kind, device) = (levels[2], levels.get(4).copied().unwrap_or_default());
        let payload = Payload::parse(&message.payload).unwrap();
        let names: BTreeSet<String> = payload
            .metrics
            .iter()
            .map(|metric| metric.name.clone().unwrap())
            .collect();
        if kind == "NDEATH" {
            assert!(message.is_sure && payload.seq.is_none());
            assert_eq!(value(&payload, "bdSeq"), self.bd_seq.map(MetricValue::Long));
            self.born.clear();
            self.told.push("NDEATH".to_owned());
            return;
        }
        assert!(!message.is_sure, "{kind}");
        let seq = payload.seq.unwrap();
        match kind {
            "NBIRTH" => {
                assert_eq!(seq, 0);
                self.born.clear();
                let Some(MetricValue::Long(number)) = value(&payload, "bdSeq") else {
                    panic!("no bdSeq");
                };
                self.bd_seq = Some(number);
            }
            _ => assert_eq!(seq, (self.seq.unwrap() + 1) % 256, "{}", message.topic),
        }
        self.seq = Some(seq);
        let time = |name: &str| match value(&payload, name) {
            Some(MetricValue::Long(time)) => Some(time),
            _ => None,
        };
        let mut live = payload.metrics.iter();
        let k1 = live.find(|metric| metric.name.as_deref() == Some("k1"));
        let k1 = k1.filter(|metric| metric.is_historical.is_none());
        self.times.extend(k1.and_then(|metric| metric.timestamp));
        if let Some(until) = time("Missing/Until") {
            self.missing = Some((time("Missing/From"), until));
        }
        match kind {
            "NBIRTH" | "DBIRTH" => {
                let is_new = self.born.insert(device.to_owned(), names).is_none();
                assert!(is_new, "{device} lives already");
                payload.metrics.iter().for_each(typed);
            }
            "NDATA" | "DDATA" => {
                let born = self.born.get(device).expect("it is born");
                assert!(names.is_subset(born), "{names:?}");
                let has_type = |metric: &Metric| metric.datatype.is_some();
                assert!(!payload.metrics.iter().any(has_type), "{kind}");
            }
            "DDEATH" => assert!(self.born.remove(device).is_some(), "{device} is dead"),
            other => panic!("{other}"),
        }
        payload.metrics.iter().for_each(complete);
        let live = payload.metrics.iter();
        let live = live.filter(|metric| metric.is_historical.is_none());
        assert!(live.map(|metric| metric.timestamp.unwrap()).is_sorted());
        let metrics: Vec<String> = match kind {
            "DDATA" | "NDATA" => payload.metrics.iter().map(brief).collect(),
            _ => Vec::new(),
        };
        let words = [kind, device].into_iter().filter(|word| !word.is_empty());
        let words = words.map(str::to_owned).chain(metrics);
        self.told.push(words.collect::<Vec<_>>().join(" "));
    }
}

/// The type of a metric in a birth is a known one, and that of its value.
fn typed(metric: &Metric) {
    let datatype = metric.datatype.unwrap();
    let right: &[u32] = match &metric.value {
        None => &[4, 10, 11, 12, 13],
        Some(MetricValue::Long(_)) => &[4, 13],
        Some(MetricValue::Double(_)) => &[10],
        Some(MetricValue::Boolean(_)) => &[11],
        Some(MetricValue::Text(_)) => &[12],
        Some(MetricValue::Int(_) | MetricValue::Float(_)) => &[],
    };
    assert!(right.contains(&datatype), "{metric:?}");
}

/// A metric has a time, and a value or null instead; its properties have a type and a value each.
fn complete(metric: &Metric) {
    assert!(metric.timestamp.is_some_and(|at| at > 0), "{metric:?}");
    let is_null = metric.value.is_none().then_some(true);
    assert_eq!(metric.is_null, is_null, "{metric:?}");
    let set = metric.properties.clone().unwrap_or_default();
    assert_eq!(set.keys.len(), set.values.len(), "{metric:?}");
    for (key, property) in set.keys.iter().zip(&set.values) {
        let is_quality = key == "Quality";
        let is_right = match (property.datatype, &property.value) {
            (Some(3), Some(PropertyKind::Int(0 | 192 | 500))) => is_quality,
            (Some(11), Some(PropertyKind::Boolean(_)))
            | (Some(12), Some(PropertyKind::Text(_))) => !is_quality,
            _ => false,
        };
        assert!(is_right, "{metric:?}");
    }
}

/// A metric as `k1=true`, with its quality where it has one, and with its time if it is past.
pub(super) fn brief(metric: &Metric) -> String {
    let value = match &metric.value {
        None => "null".to_owned(),
        Some(MetricValue::Boolean(on)) => on.to_string(),
        Some(MetricValue::Long(number)) => number.to_string(),
        Some(MetricValue::Text(text)) => format!("{text:?}"),
        Some(other) => format!("{other:?}"),
    };
    let mut brief = format!("{}={value}", metric.name.as_deref().unwrap());
    if let Some(PropertyKind::Int(quality)) = property(metric, "Quality") {
        brief += &format!("/{quality}");
    }
    if metric.is_historical == Some(true) {
        brief += &format!("@{}", metric.timestamp.unwrap() - BEGIN);
    }
    brief
}

pub(super) fn property(metric: &Metric, key: &str) -> Option<PropertyKind> {
    let PropertySet { keys, values } = metric.properties.as_ref()?;
    let at = keys.iter().position(|known| known == key)?;
    values[at].value.clone()
}

pub(super) fn value(payload: &Payload, name: &str) -> Option<MetricValue> {
    let mut all = payload.metrics.iter();
    all.find(|metric| metric.name.as_deref() == Some(name))?
        .value
        .clone()
}

/// A node, and a host behind a broker that takes everything at once.
pub(super) struct Stage {
    pub(super) node: Node,
    pub(super) judge: HostJudge,
    pub(super) picture: Arc<Picture>,
    pub(super) now: u64,
    pub(super) jobs: Vec<Job>,
    pub(super) wrong: Vec<String>,
    pub(super) asked: usize,
    /// The times of what is only in memory.
    pub(super) held: Option<(u64, u64)>,
    /// It was told that the primary host is away.
    pub(super) is_host_away: bool,
    pub(super) last: u64,
    pub(super) delivered: Vec<u64>,
    /// How many entries are read at a time.
    pub(super) piece: usize,
    /// What is in the outbox.
    pub(super) entries: Vec<OutboxEntry>,
}

impl Stage {
    pub(super) async fn new(host: Option<&str>, has_outbox: bool) -> Stage {
        Stage::with(host, has_outbox, None).await
    }

    /// One after a run that lost what it held between these times.
    pub(super) async fn after(lost: Option<(u64, u64)>) -> Stage {
        let mut stage = Stage::with(None, true, lost).await;
        stage.held = lost;
        stage
    }

    async fn with(host: Option<&str>, has_outbox: bool, lost: Option<(u64, u64)>) -> Stage {
        let picture = picture(SITE).await;
        let node = Node::new(Setup {
            site: "plant".to_owned(),
            topics: Topics {
                group: "g".to_owned(),
                node: "n".to_owned(),
                host: host.map(str::to_owned),
                modules: BTreeSet::new(),
            },
            rights: Rights {
                role: Role::Operator,
                points: vec!["oven.k1".to_owned()].into(),
            },
            has_outbox,
            lost,
        });
        let mut stage = Stage {
            node,
            judge: HostJudge::default(),
            picture: Arc::clone(&picture),
            now: BEGIN,
            jobs: Vec::new(),
            wrong: Vec::new(),
            asked: 0,
            held: None,
            is_host_away: false,
            last: 0,
            delivered: Vec::new(),
            piece: 3,
            entries: Vec::new(),
        };
        let mut first = picture;
        Arc::get_mut(&mut first);
        stage.news(&News::Picture(Arc::new(Picture {
            seq: first.seq,
            changes: first.changes,
            at: wall_time(BEGIN),
            config: Arc::clone(&first.config),
            points: first.points.clone(),
            modules: first.modules.clone(),
            lines: first.lines.clone(),
        })));
        stage
    }

    pub(super) fn now(&self) -> Now {
        Now {
            steady: Duration::from_millis(self.now - BEGIN),
            wall: self.now,
        }
    }

    pub(super) fn handle(&mut self, input: Input<'_>) {
        let now = self.now();
        self.node.handle(now, input);
    }

    pub(super) fn connect(&mut self, bd_seq: u8) {
        self.handle(Input::Connected(bd_seq));
        self.handle(Input::Subscribed);
    }

    /// The next message only, and its number.
    pub(super) fn one(&mut self) -> (String, u64) {
        loop {
            match self.node.poll(self.now()).expect("a message") {
                Output::Publish(number, message) => {
                    self.judge.heard(&message);
                    self.last = number;
                    return (message.topic, number);
                }
                Output::Delivered(_, to) => self.delivered.push(to),
                _ => {}
            }
        }
    }

    /// Outputs are switched, each a little later, and told in one batch.
    pub(super) fn together(&mut self, values: &[(&str, bool)]) {
        let mut points = Vec::new();
        for (path, on) in values {
            self.now += 1;
            let mut status = self.status(path);
            (status.value, status.quality) = (Some(PointValue::Bool(*on)), PointQuality::Good);
            status.time = Some(wall_time(self.now));
            let entry = self.entry(path, *on, "good", self.now);
            self.entries.push(entry);
            let at = wall_time(self.now);
            points.push(PointReading { at, status });
        }
        let batch = self.batch(points.into(), &[]);
        self.news(&News::Batch(Arc::new(batch)));
    }

    /// The same for one output, and whether modules answer.
    pub(super) fn happens_with(&mut self, path: &str, on: bool, online: &[(&str, bool)]) {
        self.now += 1;
        let mut status = self.status(path);
        (status.value, status.quality) = (Some(PointValue::Bool(on)), PointQuality::Good);
        status.time = Some(wall_time(self.now));
        let entry = self.entry(path, on, "good", self.now);
        self.entries.push(entry);
        let at = wall_time(self.now);
        let batch = self.batch([PointReading { at, status }].into(), online);
        self.news(&News::Batch(Arc::new(batch)));
    }

    /// A point is read.
    pub(super) fn reading(&mut self, status: PointStatus) {
        self.now += 1;
        let at = wall_time(self.now);
        let batch = self.batch([PointReading { at, status }].into(), &[]);
        self.news(&News::Batch(Arc::new(batch)));
    }

    /// What is compared now and then: whether modules answer while their line comes or goes.
    pub(super) fn figures(&mut self, online: &[(&str, bool)]) {
        self.now += 1;
        let mut batch = self.batch(Box::default(), online);
        batch.figures = std::mem::take(&mut batch.modules);
        self.news(&News::Batch(Arc::new(batch)));
    }

    /// The outbox says that changes are missing.
    pub(super) fn gap(&mut self, from: u64, until: u64) {
        self.entries.push(OutboxEntry {
            at: i64::try_from(BEGIN + until).unwrap(),
            what: EntryKind::Gap {
                from: Some(i64::try_from(BEGIN + from).unwrap()),
                reason: "overrun".to_owned(),
            },
        });
    }

    pub(super) fn news(&mut self, news: &News) {
        self.handle(Input::News(news));
    }

    /// Does everything that it wants done; gives back what the host heard.
    pub(super) fn settle(&mut self) -> Vec<String> {
        while let Some(output) = self.node.poll(self.now()) {
            match output {
                Output::Publish(number, message) => {
                    self.judge.heard(&message);
                    self.last = number;
                    self.handle(Input::Went(number));
                }
                Output::Carry(job) => self.jobs.push(job),
                Output::Wrong(why) => self.wrong.push(why),
                Output::Ask => self.asked += 1,
                Output::Read(after) => {
                    let first = after + 1;
                    let rest = self.entries.iter().skip(usize::try_from(after).unwrap());
                    let entries: Vec<_> = rest.take(self.piece).cloned().collect();
                    let piece = (!entries.is_empty()).then_some(Piece {
                        first,
                        entries,
                        missing: None,
                    });
                    self.handle(Input::Read(piece.map(|piece| (Arc::from("e"), piece))));
                }
                Output::Delivered(epoch, to) => {
                    assert_eq!(&*epoch, "e");
                    self.delivered.push(to);
                }
                Output::Hold(held) => self.held = held,
                Output::HostAway => self.is_host_away = true,
                Output::Online => self.is_host_away = false,
                Output::Subscribe(_) => {}
            }
        }
        std::mem::take(&mut self.judge.told)
    }

    /// The broker answers that everything arrived.
    pub(super) fn answer(&mut self) {
        self.now += 2_000;
        self.settle();
        let last = self.last;
        self.handle(Input::Arrived(last));
        self.settle();
    }

    pub(super) fn status(&self, path: &str) -> PointStatus {
        let is_it = |status: &&PointStatus| format!("{}.{}", status.module, status.label) == path;
        self.picture.points.iter().find(is_it).unwrap().clone()
    }

    /// What happens: a point, and whether modules answer. It goes to the outbox as well.
    pub(super) fn happens(&mut self, path: &str, on: bool, quality: PointQuality) {
        self.now += 1;
        let mut status = self.status(path);
        (status.value, status.quality) = (Some(PointValue::Bool(on)), quality);
        status.time = Some(wall_time(self.now));
        let at = wall_time(self.now);
        let word = match quality {
            PointQuality::Good => "good",
            PointQuality::Stale => "stale",
            PointQuality::Bad(_) => "bad",
        };
        let entry = self.entry(path, on, word, self.now);
        self.entries.push(entry);
        let point = PointReading { at, status };
        self.news(&News::Batch(Arc::new(self.batch([point].into(), &[]))));
    }

    /// So a point was, one after the other; the node only gets a picture of the end.
    pub(super) fn skipped(&mut self, path: &str, values: &[(bool, u64)]) {
        let mut points = self.picture.points.clone();
        for (on, at) in values {
            let entry = self.entry(path, *on, "good", *at);
            self.entries.push(entry);
            for status in &mut points {
                if format!("{}.{}", status.module, status.label) == path {
                    (status.value, status.quality) =
                        (Some(PointValue::Bool(*on)), PointQuality::Good);
                    status.time = Some(wall_time(*at));
                }
            }
        }
        let mut modules = self.picture.modules.clone();
        for module in &mut modules {
            if path.starts_with(&module.name) {
                module.presence = Presence::Online;
            }
        }
        self.news(&News::Picture(Arc::new(Picture {
            seq: 9,
            changes: 9,
            at: wall_time(self.now),
            config: Arc::clone(&self.picture.config),
            points,
            modules,
            lines: self.picture.lines.clone(),
        })));
    }

    fn entry(&self, path: &str, on: bool, word: &str, at: u64) -> OutboxEntry {
        OutboxEntry {
            at: i64::try_from(at).unwrap(),
            what: EntryKind::Reading {
                path: path.to_owned(),
                value: Some(on.to_string()).filter(|_| word != "bad"),
                quality: word.to_owned(),
                reason: None,
                time: Some(i64::try_from(at).unwrap()),
            },
        }
    }

    pub(super) fn modules(&mut self, online: &[(&str, bool)]) {
        self.now += 1;
        let batch = self.batch(Box::default(), online);
        self.news(&News::Batch(Arc::new(batch)));
    }

    pub(super) fn batch(&self, points: Box<[PointReading]>, online: &[(&str, bool)]) -> Batch {
        let modules = online.iter().map(|(name, is_online)| {
            let mut all = self.picture.modules.iter();
            let mut module = all.find(|module| module.name == *name).unwrap().clone();
            module.presence = match is_online {
                true => Presence::Online,
                false => Presence::Silent,
            };
            module
        });
        Batch {
            seq: 1,
            changes: 1,
            at: wall_time(self.now),
            config: Arc::clone(&self.picture.config),
            points,
            modules: modules.collect(),
            figures: Box::default(),
            lines: Box::default(),
        }
    }

    pub(super) fn stored(&mut self) {
        let state = OutboxState {
            epoch: Arc::from("e"),
            newest: self.entries.len() as u64,
            before: 0,
            delivered: 0,
            is_failing: false,
        };
        self.handle(Input::Stored(state));
    }

    pub(super) fn command(&mut self, topic: &str, payload: &Payload) {
        self.handle(Input::Received(Received {
            topic: format!("spBv1.0/g/{topic}"),
            payload: payload.bytes(),
            ..Received::default()
        }));
    }

    pub(super) fn order(&mut self, name: &str, value: MetricValue) {
        let payload = Payload {
            timestamp: Some(self.now),
            ..Payload::new(vec![Metric::new(name, self.now, Some(value))])
        };
        self.command("DCMD/n/oven", &payload);
    }

    pub(super) fn state(&mut self, online: bool, timestamp: u64) {
        self.handle(Input::Received(Received {
            topic: "spBv1.0/STATE/scada".to_owned(),
            payload: format!("{{\"online\":{online},\"timestamp\":{timestamp}}}").into_bytes(),
            ..Received::default()
        }));
    }

    /// One whose oven answers and was read, and that is connected.
    pub(super) async fn connected(has_outbox: bool) -> Stage {
        let mut stage = Stage::new(None, has_outbox).await;
        stage.modules(&[("oven", true)]);
        stage.happens("oven.k1", false, PointQuality::Good);
        stage.handle(Input::Connected(7));
        stage.handle(Input::Subscribed);
        assert_eq!(stage.settle(), ["NBIRTH", "DBIRTH oven"]);
        stage
    }
}

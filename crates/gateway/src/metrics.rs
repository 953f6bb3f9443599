//! `/metrics`, in the OpenMetrics format.

use super::answer;
use super::northbound::{self, OutletFigures};
use super::route::{Answer, Asked};
use super::site::Site;
use axum::extract::State;
use axum::http::StatusCode;
use prometheus_client::collector::Collector;
use prometheus_client::encoding::{DescriptorEncoder, NoLabelSet, text};
use prometheus_client::metrics::MetricType;
use prometheus_client::registry::Registry;
use railbus_api::types::{ModuleInfo, ModuleState, PortState, Value};
use railbus_app::api::ask;
use railbus_site::{Counts, STEPS, Service};
use std::collections::BTreeMap;
use std::fmt::Error;

const FORM: &str = "application/openmetrics-text; version=1.0.0; charset=utf-8";

/// `GET /metrics`; with `?points=1` also the values of points.
pub(super) async fn metrics(State(site): State<Site>, asked: Asked) -> Answer {
    let mut registry = Registry::default();
    registry.register_collector(Box::new(Scrape {
        counts: site.service.counts(),
        modules: ask::modules(&site.service),
        outlets: site.northbound.figures(),
        points: asked.get("points").is_some_and(|value| value == "1"),
        service: site.service,
    }));
    let mut text = String::new();
    // Writing into a String does not fail.
    let _ = text::encode(&mut text, &registry);
    answer::with(StatusCode::OK, FORM, text)
}

/// All metrics at one moment.
#[derive(Debug)]
struct Scrape {
    service: Service,
    counts: BTreeMap<String, Counts>,
    modules: Vec<ModuleInfo>,
    outlets: Vec<OutletFigures>,
    points: bool,
}

impl Collector for Scrape {
    fn encode(&self, mut to: DescriptorEncoder<'_>) -> Result<(), Error> {
        self.requests(&mut to)?;
        self.seconds(&mut to)?;
        self.frames(&mut to)?;
        self.lines(&mut to)?;
        self.up(&mut to)?;
        self.outlets(&mut to)?;
        if self.points {
            self.values(&mut to)?;
        }
        self.process(&mut to)
    }
}

impl Scrape {
    /// The modules, and the counters of their exchanges.
    fn counted(&self) -> impl Iterator<Item = (&ModuleInfo, &Counts)> {
        let modules = self.modules.iter();
        modules.filter_map(|module| Some((module, self.counts.get(&module.module)?)))
    }

    fn requests(&self, to: &mut DescriptorEncoder<'_>) -> Result<(), Error> {
        let about = "Exchanges with modules, by how they ended";
        let name = "railbus_requests";
        let mut family = to.encode_descriptor(name, about, None, MetricType::Counter)?;
        for (module, counts) in self.counted() {
            let failed = counts.failed.iter().map(|(why, count)| (*why, *count));
            for (result, count) in std::iter::once(("ok", counts.replies)).chain(failed) {
                let labels = [
                    ("line", module.line.as_str()),
                    ("module", &module.module),
                    ("protocol", &module.protocol),
                    ("result", result),
                ];
                let mut one = family.encode_family(&labels)?;
                one.encode_counter::<NoLabelSet, u64, u64>(&count, None)?;
            }
        }
        Ok(())
    }

    fn seconds(&self, to: &mut DescriptorEncoder<'_>) -> Result<(), Error> {
        let about = "From the beginning of a request to the end of its reply";
        let name = "railbus_request_seconds";
        let mut family = to.encode_descriptor(name, about, None, MetricType::Histogram)?;
        for (module, counts) in self.counted() {
            let labels = [
                ("line", module.line.as_str()),
                ("module", &module.module),
                ("protocol", &module.protocol),
            ];
            let ends = STEPS.iter().map(|end| match end.0 {
                u64::MAX => f64::INFINITY,
                micros => micros as f64 / 1e6,
            });
            let steps: Vec<(f64, u64)> = ends.zip(counts.steps).collect();
            let time = counts.time.0 as f64 / 1e6;
            let mut one = family.encode_family(&labels)?;
            one.encode_histogram::<NoLabelSet>(time, counts.replies, &steps, None)?;
        }
        Ok(())
    }

    fn frames(&self, to: &mut DescriptorEncoder<'_>) -> Result<(), Error> {
        let about = "Replies that were spoilt, or came too late";
        let name = "railbus_frames_bad";
        let mut family = to.encode_descriptor(name, about, None, MetricType::Counter)?;
        for (module, counts) in self.counted() {
            let garbled = counts.failed.get("garbled").copied().unwrap_or_default();
            for (kind, count) in [("garbled", garbled), ("late", counts.late)] {
                let labels = [
                    ("line", module.line.as_str()),
                    ("module", &module.module),
                    ("kind", kind),
                ];
                let mut one = family.encode_family(&labels)?;
                one.encode_counter::<NoLabelSet, u64, u64>(&count, None)?;
            }
        }
        Ok(())
    }

    fn lines(&self, to: &mut DescriptorEncoder<'_>) -> Result<(), Error> {
        let lines = ask::lines(&self.service);
        let about = "Share of the last minute taken by exchanges that were answered";
        let name = "railbus_line_busy_ratio";
        let mut family = to.encode_descriptor(name, about, None, MetricType::Gauge)?;
        for line in &lines {
            let busy = self.service.busy(&line.line).unwrap_or_default();
            let labels = [("line", line.line.as_str())];
            let mut one = family.encode_family(&labels)?;
            one.encode_gauge(&busy)?;
        }
        let about = "Whether the port of a line is open";
        let mut family = to.encode_descriptor("railbus_line_up", about, None, MetricType::Gauge)?;
        for line in &lines {
            let labels = [("line", line.line.as_str())];
            let mut one = family.encode_family(&labels)?;
            one.encode_gauge(&i64::from(line.state == PortState::Up))?;
        }
        Ok(())
    }

    fn up(&self, to: &mut DescriptorEncoder<'_>) -> Result<(), Error> {
        let about = "Whether a module answers, and is the model of the configuration";
        let name = "railbus_module_up";
        let mut family = to.encode_descriptor(name, about, None, MetricType::Gauge)?;
        for module in &self.modules {
            let labels = [("line", module.line.as_str()), ("module", &module.module)];
            let mut one = family.encode_family(&labels)?;
            one.encode_gauge(&i64::from(module.state == ModuleState::Online))?;
        }
        Ok(())
    }

    /// By kind, so that the name of an outlet is a label under the name of its kind.
    fn outlets(&self, to: &mut DescriptorEncoder<'_>) -> Result<(), Error> {
        for kind in northbound::kinds() {
            let its = || self.outlets.iter().filter(|outlet| outlet.kind == kind);
            let about = "What was to be delivered, by what became of it";
            let name = format!("railbus_{kind}_deliveries");
            let mut family = to.encode_descriptor(&name, about, None, MetricType::Counter)?;
            for outlet in its() {
                for (result, count) in outlet.results {
                    let labels = [(kind, outlet.name.as_str()), ("result", result)];
                    let mut one = family.encode_family(&labels)?;
                    one.encode_counter::<NoLabelSet, u64, u64>(&count, None)?;
                }
            }
            let about = "What waits to be delivered";
            let name = format!("railbus_{kind}_queue");
            let mut family = to.encode_descriptor(&name, about, None, MetricType::Gauge)?;
            for outlet in its() {
                let labels = [(kind, outlet.name.as_str())];
                let mut one = family.encode_family(&labels)?;
                one.encode_gauge(&i64::try_from(outlet.queue).unwrap_or(i64::MAX))?;
            }
        }
        let about = "Who is connected to an integration that listens";
        let name = "railbus_outlet_clients";
        let mut family = to.encode_descriptor(name, about, None, MetricType::Gauge)?;
        for outlet in &self.outlets {
            let Some(clients) = outlet.clients else {
                continue;
            };
            let labels = [("kind", outlet.kind), ("outlet", outlet.name.as_str())];
            let mut one = family.encode_family(&labels)?;
            one.encode_gauge(&i64::try_from(clients).unwrap_or(i64::MAX))?;
        }
        let about = "Whether an integration works";
        let name = "railbus_outlet_up";
        let mut family = to.encode_descriptor(name, about, None, MetricType::Gauge)?;
        for outlet in &self.outlets {
            let Some(is_up) = outlet.is_up else {
                continue;
            };
            let labels = [("kind", outlet.kind), ("outlet", outlet.name.as_str())];
            let mut one = family.encode_family(&labels)?;
            one.encode_gauge(&i64::from(is_up))?;
        }
        Ok(())
    }

    /// Only good values are included: a gap says more than an old number.
    fn values(&self, to: &mut DescriptorEncoder<'_>) -> Result<(), Error> {
        let about = "The value of a point while it is good";
        let name = "railbus_point_value";
        let mut family = to.encode_descriptor(name, about, None, MetricType::Gauge)?;
        for point in ask::points(&self.service, &[]) {
            if point.quality.name() != "good" {
                continue;
            }
            let value = match point.value {
                Some(Value::Bool(on)) => f64::from(u8::from(on)),
                Some(Value::Number(number)) => f64::from(number),
                Some(Value::Analog(value)) => value,
                None => continue,
            };
            let labels = [("module", point.module.as_str()), ("point", &point.label)];
            let mut one = family.encode_family(&labels)?;
            one.encode_gauge(&value)?;
        }
        Ok(())
    }

    fn process(&self, to: &mut DescriptorEncoder<'_>) -> Result<(), Error> {
        let about = "How long the daemon has run";
        let name = "railbus_uptime_seconds";
        let mut one = to.encode_descriptor(name, about, None, MetricType::Gauge)?;
        one.encode_gauge(&(self.service.age().0 as f64 / 1e6))?;
        let about = "Whether the audit log is written";
        let name = "railbus_audit_up";
        let works = self
            .service
            .audit_log()
            .is_some_and(|log| !log.is_failing());
        let mut one = to.encode_descriptor(name, about, None, MetricType::Gauge)?;
        one.encode_gauge(&i64::from(works))?;
        let about = "Memory in use";
        let name = "process_resident_memory_bytes";
        if let Some(bytes) = super::about::resident() {
            let mut one = to.encode_descriptor(name, about, None, MetricType::Gauge)?;
            one.encode_gauge(&(bytes as f64))?;
        }
        let labels = [("version", env!("CARGO_PKG_VERSION"))];
        let mut one = to.encode_descriptor("railbus", "The program", None, MetricType::Info)?;
        one.encode_info(&labels)
    }
}

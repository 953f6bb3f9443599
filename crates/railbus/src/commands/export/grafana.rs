//! Grafana: a dashboard of a site, over what Prometheus has of it.

use super::File;
use super::asked::{Asked, id};
use super::quote::quoted;
use super::texts::ExportText;
use railbus_device::{Point, PointKind};
use railbus_gateway::offered::{home_class, shown};
use railbus_site::config::ModuleConfig;
use serde_json::{Value, json};
use std::collections::BTreeMap;

/// The width of a dashboard, in its own measure.
const WIDTH: u64 = 24;
/// The version of the format: that of Grafana 10.
const SCHEMA: u64 = 38;

/// Panels in rows, from the top.
#[derive(Default)]
struct Board {
    panels: Vec<Value>,
    x: u64,
    y: u64,
}

impl Board {
    /// Adds a panel to the row, or to the next one if it does not fit.
    fn add(&mut self, (width, height): (u64, u64), mut panel: Value) {
        if self.x + width > WIDTH {
            self.y += height;
            self.x = 0;
        }
        panel["id"] = (self.panels.len() + 1).into();
        panel["gridPos"] = json!({ "x": self.x, "y": self.y, "w": width, "h": height });
        self.x += width;
        self.panels.push(panel);
    }

    /// Ends a row of this height, and begins one with a title.
    fn row(&mut self, height: u64, title: &str) {
        (self.x, self.y) = (0, self.y + height);
        self.add(
            (WIDTH, 1),
            json!({
                "type": "row", "title": title, "collapsed": false, "panels": [],
            }),
        );
        (self.x, self.y) = (0, self.y + 1);
    }
}

/// Where the numbers come from.
fn source() -> Value {
    json!({ "type": "prometheus", "uid": "${datasource}" })
}

fn query(expr: &str, legend: &str) -> Value {
    json!({
        "refId": "A", "datasource": source(), "expr": expr, "legendFormat": legend,
        "range": true,
    })
}

/// A number that is good or not, as it is now: the last one that there was is none.
fn stat(title: &str, expr: &str, colours: Value, mappings: Value) -> Value {
    let mut query = query(expr, "");
    (query["range"], query["instant"]) = (false.into(), true.into());
    json!({
        "type": "stat", "title": title, "datasource": source(),
        "targets": [query],
        "fieldConfig": {
            "defaults": {
                "thresholds": { "mode": "absolute", "steps": colours },
                "mappings": mappings,
            },
            "overrides": [],
        },
        "options": {
            "colorMode": "background", "graphMode": "none", "justifyMode": "auto",
            "orientation": "auto", "textMode": "value", "wideLayout": true,
            "percentChangeColorMode": "standard", "showPercentChange": false,
            "reduceOptions": { "calcs": ["lastNotNull"], "fields": "", "values": false },
        },
    })
}

/// Curves of numbers. `overrides` say what single ones are called.
fn curves(title: &str, (expr, legend): (&str, &str), field: Value, overrides: Value) -> Value {
    json!({
        "type": "timeseries", "title": title, "datasource": source(),
        "targets": [query(expr, legend)],
        "fieldConfig": { "defaults": field, "overrides": overrides },
        "options": {
            "legend": { "displayMode": "list", "placement": "bottom", "showLegend": true,
                "calcs": [] },
            "tooltip": { "mode": "multi", "sort": "none" },
        },
    })
}

/// Stretches of time in which something is on or off; a gap where that is not known.
fn states(
    title: &str,
    (expr, legend): (&str, &str),
    words: [(&str, &str); 2],
    overrides: Value,
) -> Value {
    json!({
        "type": "state-timeline", "title": title, "datasource": source(),
        "targets": [query(expr, legend)],
        "fieldConfig": {
            "defaults": {
                "color": { "mode": "thresholds" },
                "mappings": mapped(words),
                "custom": { "fillOpacity": 70, "lineWidth": 0, "spanNulls": false },
            },
            "overrides": overrides,
        },
        "options": {
            "mergeValues": true, "showValue": "never", "alignValue": "left", "rowHeight": 0.8,
            "legend": { "displayMode": "list", "placement": "bottom", "showLegend": true,
                "calcs": [] },
            "tooltip": { "mode": "single", "sort": "none" },
        },
    })
}

/// Words and colours of 0 and 1.
fn mapped(words: [(&str, &str); 2]) -> Value {
    let [off, on] = words.map(|(text, color)| json!({ "text": text, "color": color }));
    json!([{ "type": "value", "options": { "0": off, "1": on } }])
}

/// Green, and this colour from 1 on.
fn bad_from_one(colour: &str) -> Value {
    json!([{ "color": "green", "value": null }, { "color": colour, "value": 1 }])
}

/// The dashboard.
pub(super) fn file(asked: &Asked<'_>) -> File {
    let text = |text: ExportText| asked.lang.get(text);
    let of = asked.of_site();
    let mut board = Board::default();
    overview(asked, &of, &mut board);
    board.row(8, text(ExportText::GrafanaValues));
    values(asked, &of, &mut board);
    let dashboard = json!({
        // It stays the same, so that a new dashboard replaces the old one.
        "uid": format!("railbus-{}", id(&asked.site, "dashboard")),
        "title": format!("railbus {}", asked.site),
        "description": text(ExportText::GrafanaAbout),
        "tags": ["railbus"],
        "timezone": "browser",
        "editable": true,
        "graphTooltip": 1,
        "schemaVersion": SCHEMA,
        "refresh": "30s",
        "time": { "from": "now-6h", "to": "now" },
        "templating": { "list": [{
            "type": "datasource", "name": "datasource", "label": "Prometheus",
            "query": "prometheus", "refresh": 1, "hide": 0, "includeAll": false, "multi": false,
            "options": [], "skipUrlSync": false,
        }] },
        "annotations": { "list": [] },
        "panels": board.panels,
    });
    // Objects of texts and numbers are always valid JSON.
    let json = serde_json::to_string_pretty(&dashboard).unwrap_or_default();
    File {
        text: json + "\n",
        notes: vec![text(ExportText::GrafanaImport).to_owned()],
    }
}

/// The site as a whole.
fn overview(asked: &Asked<'_>, of: &str, board: &mut Board) {
    let text = |text: ExportText| asked.lang.get(text);
    let yes_no = [
        (text(ExportText::No), "red"),
        (text(ExportText::Yes), "green"),
    ];
    let good = json!([{ "color": "red", "value": null }, { "color": "green", "value": 1 }]);
    // A daemon that does not answer says nothing of what it had said before, and not 0 either.
    let up = format!("up{{job=\"railbus\",{of}}}");
    let count = |metric: &str, of: &str| {
        format!("(count({metric}{{{of}}} == 0) or vector(0)) and on () ({up} == 1)")
    };
    let one = (4, 4);
    for (title, expr, colours, mappings) in [
        (ExportText::GrafanaDaemon, up.clone(), &good, mapped(yes_no)),
        (
            ExportText::GrafanaAudit,
            format!("railbus_audit_up{{{of}}}"),
            &good,
            mapped(yes_no),
        ),
        (
            ExportText::GrafanaOnline,
            format!("sum(railbus_module_up{{{of}}})"),
            &good,
            json!([]),
        ),
        (
            ExportText::GrafanaOffline,
            count("railbus_module_up", &asked.of_polled()),
            &bad_from_one("orange"),
            json!([]),
        ),
        (
            ExportText::GrafanaLines,
            count("railbus_line_up", of),
            &bad_from_one("red"),
            json!([]),
        ),
        (
            ExportText::GrafanaOutlets,
            count("railbus_outlet_up", of),
            &bad_from_one("orange"),
            json!([]),
        ),
    ] {
        board.add(one, stat(text(title), &expr, colours.clone(), mappings));
    }
    (board.x, board.y) = (0, board.y + 4);
    let half = (WIDTH / 2, 8);
    let no_names = json!([]);
    board.add(
        half,
        states(
            text(ExportText::GrafanaModules),
            (&format!("railbus_module_up{{{of}}}"), "{{module}}"),
            yes_no,
            no_names.clone(),
        ),
    );
    board.add(
        half,
        curves(
            text(ExportText::GrafanaBusy),
            (&format!("railbus_line_busy_ratio{{{of}}}"), "{{line}}"),
            json!({ "unit": "percentunit", "min": 0, "max": 1 }),
            no_names.clone(),
        ),
    );
    let rate = |metric: &str, more: &str| format!("rate({metric}{{{of}{more}}}[$__rate_interval])");
    let failed = rate("railbus_requests_total", ",result!=\"ok\"");
    board.add(
        half,
        curves(
            text(ExportText::GrafanaErrors),
            (
                &format!("sum by (module, result) ({failed}) > 0"),
                "{{module}} {{result}}",
            ),
            json!({ "unit": "reqps", "min": 0 }),
            no_names.clone(),
        ),
    );
    let mean = format!(
        "sum by (module) ({}) / sum by (module) ({})",
        rate("railbus_request_seconds_sum", ""),
        rate("railbus_request_seconds_count", ""),
    );
    board.add(
        half,
        curves(
            text(ExportText::GrafanaRoundTrip),
            (&mean, "{{module}}"),
            json!({ "unit": "s", "min": 0 }),
            no_names.clone(),
        ),
    );
    board.add(
        half,
        states(
            text(ExportText::GrafanaOutletStates),
            (&format!("railbus_outlet_up{{{of}}}"), "{{outlet}}"),
            yes_no,
            no_names.clone(),
        ),
    );
    board.add(
        half,
        curves(
            text(ExportText::GrafanaQueues),
            (
                &format!("{{__name__=~\"railbus_.+_queue\",{of}}}"),
                "__auto",
            ),
            json!({ "min": 0 }),
            no_names,
        ),
    );
}

/// The points: numbers of one unit in one panel, and the states of each module.
fn values(asked: &Asked<'_>, of: &str, board: &mut Board) {
    let text = |text: ExportText| asked.lang.get(text);
    let on_off = [
        (text(ExportText::Off), "#5a6069"),
        (text(ExportText::On), "green"),
    ];
    let mut by_unit: BTreeMap<&str, Vec<(&str, String, String)>> = BTreeMap::new();
    let full = (WIDTH, 8);
    for (name, module) in &asked.config.modules {
        for (label, point) in shown(module) {
            let unit = match point.kind {
                PointKind::Analog => home_class(&module.range_of(point).unit).1,
                PointKind::Variable => "",
                PointKind::Output | PointKind::Input => continue,
            };
            let called = called(asked, (name, module), (&label, point));
            by_unit.entry(unit).or_default().push((name, label, called));
        }
    }
    for (unit, points) in by_unit {
        let each = |(module, label, _): &(&str, String, String)| {
            format!(
                "railbus_point_value{{{of},module={},point={}}}",
                quoted(module),
                quoted(label)
            )
        };
        let expr: Vec<String> = points.iter().map(each).collect();
        let names = points
            .iter()
            .map(|(module, label, called)| (format!("{module}.{label}"), called.clone()));
        // A unit that Grafana does not know follows the number as it is.
        let field = json!({ "unit": if unit.is_empty() { "short".to_owned() } else {
            format!("suffix: {unit}")
        } });
        let title = match unit {
            "" => text(ExportText::GrafanaNumbers).to_owned(),
            unit => format!("{} ({unit})", text(ExportText::GrafanaNumbers)),
        };
        let curves = curves(
            &title,
            (&expr.join(" or "), "{{module}}.{{point}}"),
            field,
            named(names),
        );
        board.add(full, curves);
    }
    for (name, module) in &asked.config.modules {
        let is_state = |point: Point| matches!(point.kind, PointKind::Output | PointKind::Input);
        let points: Vec<(String, Point)> = shown(module)
            .filter(|(_, point)| is_state(*point))
            .collect();
        if points.is_empty() {
            continue;
        }
        let labels: Vec<&str> = points.iter().map(|(label, _)| &**label).collect();
        let expr = format!(
            "railbus_point_value{{{of},module={},point=~\"{}\"}}",
            quoted(name),
            labels.join("|"),
        );
        let names = points.iter().filter_map(|(label, point)| {
            let called = asked.point_name(module, *point)?;
            Some((label.clone(), format!("{label} {called}")))
        });
        let title = asked.module_name(name, module);
        board.add(
            full,
            states(title, (&expr, "{{point}}"), on_off, named(names)),
        );
    }
}

/// What a number is called in a panel with those of other modules.
fn called(
    asked: &Asked<'_>,
    (name, module): (&str, &ModuleConfig),
    (label, point): (&str, Point),
) -> String {
    let own = asked.point_name(module, point);
    own.map_or_else(
        || format!("{name}.{label}"),
        |own| format!("{own} ({name}.{label})"),
    )
}

/// Names in place of what a query says.
fn named(names: impl Iterator<Item = (String, String)>) -> Value {
    let each = |(said, name)| {
        json!({
            "matcher": { "id": "byName", "options": said },
            "properties": [{ "id": "displayName", "value": name }],
        })
    };
    names.map(each).collect()
}

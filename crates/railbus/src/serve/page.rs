//! The status page: what there is and how it is, as plain HTML without a script.

use super::answer;
use super::routes::Site;
use crate::api::ask;
use crate::api::types::{
    Kind, LineInfo, ModuleInfo, ModuleState, PointInfo, PortState, Quality, Reason, Value,
};
use crate::i18n::Lang;
use crate::render::{time, values};
use crate::texts::Text;
use axum::body::Body;
use axum::extract::{Query, State};
use axum::http::header::ACCEPT_LANGUAGE;
use axum::http::{HeaderMap, Response, StatusCode};
use std::collections::BTreeMap;
use std::fmt::Write;

/// `GET /style.css`.
pub(super) async fn style() -> Response<Body> {
    let style: &'static [u8] = include_bytes!("page.css");
    answer::with(StatusCode::OK, "text/css; charset=utf-8", style)
}

/// `GET /`.
pub(super) async fn status(
    State(site): State<Site>,
    asked: Query<BTreeMap<String, String>>,
    headers: HeaderMap,
) -> Response<Body> {
    let accepted = headers
        .get(ACCEPT_LANGUAGE)
        .and_then(|value| value.to_str().ok());
    let asked = asked.get("lang").map(String::as_str);
    let lang = asked.or(accepted).map_or(site.lang, language);
    let page = Page {
        lang,
        demo: site.demo,
        lines: ask::lines(&site.service),
        modules: ask::modules(&site.service),
        points: ask::points(&site.service, &[]),
    };
    answer::with(StatusCode::OK, "text/html; charset=utf-8", page.html())
}

/// The first language of a list that is one of ours.
fn language(list: &str) -> Lang {
    let mut known = list.split(',').map(str::trim).filter_map(|name| {
        let is = |code: &str| {
            name.get(..2)
                .is_some_and(|head| head.eq_ignore_ascii_case(code))
        };
        match () {
            () if is("zh") => Some(Lang::Zh),
            () if is("en") => Some(Lang::En),
            () => None,
        }
    });
    known.next().unwrap_or(Lang::En)
}

struct Page {
    lang: Lang,
    demo: bool,
    lines: Vec<LineInfo>,
    modules: Vec<ModuleInfo>,
    points: Vec<PointInfo>,
}

impl Page {
    fn html(&self) -> String {
        let lang = self.lang;
        let t = |text: Text| lang.get(text);
        let (code, other, other_name) = match lang {
            Lang::En => ("en", "zh", "中文"),
            Lang::Zh => ("zh-CN", "en", "English"),
        };
        let mut html = format!(
            "<!doctype html>\n<html lang=\"{code}\">\n<head>\n<meta charset=\"utf-8\">\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
             <meta http-equiv=\"refresh\" content=\"5\">\n<title>railbus</title>\n\
             <link rel=\"stylesheet\" href=\"/style.css\">\n</head>\n<body>\n<header>\n\
             <h1>railbus</h1>\n<a href=\"/?lang={other}\" lang=\"{other}\" hreflang=\"{other}\">\
             {other_name}</a>\n</header>\n<main>\n"
        );
        if self.demo {
            push(
                &mut html,
                format_args!("<p class=\"note\">{}</p>\n", t(Text::PageDemo)),
            );
        }
        for line in &self.lines {
            self.line(&mut html, line);
        }
        push(
            &mut html,
            format_args!(
                "</main>\n<footer>{} · <a href=\"/api/v1/points\">API</a> · railbus {}</footer>\n\
                 </body>\n</html>\n",
                t(Text::PageRefresh),
                env!("CARGO_PKG_VERSION")
            ),
        );
        html
    }

    fn line(&self, html: &mut String, line: &LineInfo) {
        let t = |text: Text| self.lang.get(text);
        let state = t(match line.state {
            PortState::Opening => Text::PortOpening,
            PortState::Up => Text::PortUp,
            PortState::Absent => Text::PortAbsent,
            PortState::Busy => Text::PortBusy,
            PortState::Closed => Text::PortClosed,
        });
        let why = line.holder.as_ref().or(line.reason.as_ref());
        let why = why
            .map(|why| format!(" ({})", escaped(why)))
            .unwrap_or_default();
        let babble = if line.babble { t(Text::PageBabble) } else { "" };
        push(
            html,
            format_args!(
                "<section>\n<h2>{} {}</h2>\n<p class=\"where\">{} · {} {} · <b>{state}</b>{why} \
                 <b>{babble}</b></p>\n",
                t(Text::PageLine),
                escaped(&line.line),
                escaped(&line.port),
                line.baud,
                line.format,
            ),
        );
        for module in self
            .modules
            .iter()
            .filter(|module| module.line == line.line)
        {
            self.module(html, module);
        }
        html.push_str("</section>\n");
    }

    fn module(&self, html: &mut String, module: &ModuleInfo) {
        let t = |text: Text| self.lang.get(text);
        let (class, state) = match module.state {
            ModuleState::Online => ("good", Text::Online),
            ModuleState::Offline => ("bad", Text::Offline),
            ModuleState::Unheard => ("unknown", Text::Unheard),
        };
        let rtt = module
            .rtt_ms
            .map(|rtt| time::duration(self.lang, rtt.round() as u64))
            .map(|rtt| format!(" · {rtt}"))
            .unwrap_or_default();
        push(
            html,
            format_args!(
                "<article>\n<h3>{} <small>{}</small></h3>\n<p><b class=\"{class}\">{}</b>{rtt} · \
                 {} {} · {} · {}</p>\n<table>\n<thead><tr><th>{}<th>{}<th>{}<th>{}</tr>\
                 </thead>\n<tbody>\n",
                escaped(&module.module),
                escaped(&module.title),
                t(state),
                t(Text::PageAddress),
                module.address,
                escaped(&module.protocol),
                self.lang
                    .fill(Text::PageErrors, &[("count", &module.errors_1h)]),
                t(Text::PagePoint),
                t(Text::PageValue),
                t(Text::PageQuality),
                t(Text::PageAge),
            ),
        );
        for point in self
            .points
            .iter()
            .filter(|point| point.module == module.module)
        {
            self.point(html, point);
        }
        html.push_str("</tbody>\n</table>\n</article>\n");
    }

    fn point(&self, html: &mut String, point: &PointInfo) {
        let class = match (point.quality, point.reason) {
            (Quality::Good, _) => "good",
            (Quality::Bad, Some(Reason::NeverRead)) => "unknown",
            (Quality::Stale | Quality::Bad, _) => "bad",
        };
        let name = point
            .name
            .get(self.lang.name())
            .or(point.name.values().next());
        let name = name.map(|name| format!(" <small>{}</small>", escaped(name)));
        let age = point
            .age_ms
            .map_or_else(|| "–".to_owned(), |millis| age(self.lang, millis));
        push(
            html,
            format_args!(
                "<tr><th scope=\"row\">{}{}{}<td>{}<td class=\"{class}\">{}<td>{age}</tr>\n",
                escaped(&point.label),
                name.unwrap_or_default(),
                if point.locked { " 🔒" } else { "" },
                escaped(&self.value(point)),
                values::quality(self.lang, point),
            ),
        );
    }

    fn value(&self, point: &PointInfo) -> String {
        let t = |text: Text| self.lang.get(text).to_owned();
        match (point.value, point.kind) {
            (None, _) => "–".to_owned(),
            (Some(Value::Bool(true)), Kind::Output) => t(Text::On),
            (Some(Value::Bool(false)), Kind::Output) => t(Text::Off),
            (Some(Value::Bool(high)), _) => u8::from(high).to_string(),
            (Some(Value::Number(number)), _) => number.to_string(),
            (Some(Value::Analog(value)), _) => {
                let decimals = usize::from(point.decimals.unwrap_or(2));
                let unit = point.unit.as_deref().unwrap_or_default();
                format!("{value:.decimals$} {unit}")
            }
        }
    }
}

/// Writing into a String does not fail.
fn push(html: &mut String, text: std::fmt::Arguments<'_>) {
    let _ = html.write_fmt(text);
}

fn age(lang: Lang, millis: u64) -> String {
    match millis {
        0..60_000 => time::duration(lang, millis),
        _ => time::span(lang, millis / 1_000),
    }
}

/// A text that stands for itself in HTML, inside and outside of quotes.
fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for letter in text.chars() {
        match letter {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            other => out.push(other),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_escaped() {
        assert_eq!(escaped("<b>\"&'"), "&lt;b&gt;&quot;&amp;&#39;");
    }

    #[test]
    fn the_first_known_language_is_spoken() {
        assert_eq!(language("zh-CN,en;q=0.5"), Lang::Zh);
        assert_eq!(language("fr, en-US;q=0.8, zh;q=0.1"), Lang::En);
        assert_eq!(language("fr"), Lang::En);
        assert_eq!(language("é"), Lang::En);
    }
}

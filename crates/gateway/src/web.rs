//! The web pages, embedded in the program: built by `cargo xtask web`, each file in three encodings
//! (plain, gzip, brotli), so that nothing is compressed at run time.

use super::route::Answer;
use super::site::Site;
use super::{answer, language};
use crate::texts::GatewayText;
use axum::body::{Body, Bytes};
use axum::extract::State;
use axum::http::header::{
    ACCEPT_ENCODING, CACHE_CONTROL, CONTENT_ENCODING, CONTENT_SECURITY_POLICY, CONTENT_TYPE,
    HeaderName, HeaderValue, VARY,
};
use axum::http::{HeaderMap, Method, Response, StatusCode, Uri};
use railbus_api::problem::{Problem, codes};
use railbus_words::Lang;
use std::borrow::Cow;

/// The output of `npm run build`. A debug build reads it from the folder each time.
#[derive(rust_embed::Embed)]
#[folder = "../../web/dist/"]
#[allow_missing = true]
struct Dist;

/// What the pages may do: load our resources, and connect to us. The markup contains neither script
/// nor style, so nothing injected into it runs.
const POLICY: &str = "default-src 'self'; script-src 'self'; style-src 'self'; img-src 'self'; \
                      connect-src 'self'; object-src 'none'; base-uri 'none'; \
                      form-action 'none'; frame-ancestors 'none'";

/// The only HTML page; its script decides what it shows.
const INDEX: &str = "index.html";

/// The folder of files with a content hash in their names.
const HASHED: &str = "assets/";

/// A file by its name.
type Find<'f> = &'f dyn Fn(&str) -> Option<Cow<'static, [u8]>>;

/// Everything that is not a path of the API.
pub(super) async fn page(
    State(site): State<Site>,
    method: Method,
    uri: Uri,
    headers: HeaderMap,
) -> Answer {
    let path = uri.path().trim_start_matches('/');
    // Below `s` a centre has the pages of its sites, and they would take this for one.
    let first = path.split('/').next().unwrap_or_default();
    if ["api", "s"].contains(&first) || !matches!(method, Method::GET | Method::HEAD) {
        return answer::problem(&Problem::new(codes::NO_SUCH_PAGE));
    }
    shown(path, (&headers, site.lang), ["railbus ls", "railbus watch"])
}

/// A file of this build, or the page for any other path. If it was built without pages, why there
/// are none, and which commands work all the same.
pub(super) fn shown(path: &str, (headers, lang): (&HeaderMap, Lang), works: [&str; 2]) -> Answer {
    let built = |name: &str| Dist::get(name).map(|file| file.data);
    let answer = served(path, headers, &built);
    answer.unwrap_or_else(|| missing(language::spoken(headers, lang), works))
}

/// A file, or the page for any other path; none if the program was built without it.
fn served(path: &str, headers: &HeaderMap, find: Find<'_>) -> Option<Answer> {
    let name = match path {
        "" => INDEX,
        name => name,
    };
    let encodings = headers
        .get(ACCEPT_ENCODING)
        .and_then(|value| value.to_str().ok())
        .unwrap_or_default();
    if let Some(answer) = file(name, encodings, find) {
        return Some(answer);
    }
    if name.starts_with(HASHED) {
        return Some(answer::problem(&Problem::new(codes::NO_SUCH_PAGE)));
    }
    file(INDEX, encodings, find)
}

/// A file in the best encoding that the browser accepts.
fn file(name: &str, encodings: &str, find: Find<'_>) -> Option<Answer> {
    let kind = content_type(name)?;
    let plain = find(name)?;
    let coded = [("br", "br"), ("gzip", "gz")]
        .into_iter()
        .filter(|(encoding, _)| takes(encodings, encoding))
        .find_map(|(encoding, ending)| Some((encoding, find(&format!("{name}.{ending}"))?)));
    let (encoding, bytes) = match coded {
        Some((encoding, bytes)) => (Some(encoding), bytes),
        None => (None, plain),
    };
    let kept = match name {
        INDEX => "no-store",
        name if name.starts_with(HASHED) => "public, max-age=31536000, immutable",
        _ => "no-cache",
    };
    let mut response = Response::new(Body::from(match bytes {
        Cow::Borrowed(bytes) => Bytes::from_static(bytes),
        Cow::Owned(bytes) => Bytes::from(bytes),
    }));
    let encoding = encoding.map(|encoding| (CONTENT_ENCODING, encoding));
    let always: [(HeaderName, &'static str); 4] = [
        (CONTENT_TYPE, kind),
        (CACHE_CONTROL, kept),
        (VARY, "Accept-Encoding"),
        (CONTENT_SECURITY_POLICY, POLICY),
    ];
    for (header, value) in always.into_iter().chain(encoding) {
        let value = HeaderValue::from_static(value);
        response.headers_mut().insert(header, value);
    }
    Some(response)
}

/// The type of a file; the pages have no others.
fn content_type(name: &str) -> Option<&'static str> {
    Some(match name.rsplit_once('.')?.1 {
        "html" => "text/html; charset=utf-8",
        "js" => "text/javascript; charset=utf-8",
        "css" => "text/css; charset=utf-8",
        "svg" => "image/svg+xml",
        "webmanifest" => "application/manifest+json",
        _ => return None,
    })
}

/// Whether a list such as `gzip, br;q=0.9` contains an encoding and does not forbid it.
pub(super) fn takes(list: &str, encoding: &str) -> bool {
    list.split(',').any(|one| {
        let (name, weight) = one.split_once(';').unwrap_or((one, ""));
        let weight = weight.trim().strip_prefix("q=");
        let never = weight.is_some_and(|q| q.parse() == Ok(0.0_f32));
        name.trim().eq_ignore_ascii_case(encoding) && !never
    })
}

/// `GET /style.css`: of the page that says that the pages are missing.
pub(super) async fn style() -> Answer {
    let style: &'static [u8] = include_bytes!("page.css");
    answer::with(StatusCode::OK, "text/css; charset=utf-8", style)
}

/// The program was built without the pages: what to do about it, and which commands work all the
/// same.
fn missing(lang: Lang, commands: [&str; 2]) -> Answer {
    let code = match lang {
        Lang::En => "en",
        Lang::Zh => "zh-CN",
    };
    let t = |text: GatewayText| lang.get(text);
    let html = format!(
        "<!doctype html>\n<html lang=\"{code}\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <title>railbus</title>\n<link rel=\"stylesheet\" href=\"/style.css\">\n</head>\n<body>\n\
         <h1>railbus {version}</h1>\n<p class=\"note\">{no_pages}</p>\n<p>{build}</p>\n\
         <pre>cargo xtask demo</pre>\n<p>{works}</p>\n<pre>{commands}</pre>\n\
         <p><a href=\"/api/v1/session\">/api/v1</a> · <a href=\"/healthz\">/healthz</a></p>\n\
         </body>\n</html>\n",
        version = env!("CARGO_PKG_VERSION"),
        no_pages = t(GatewayText::PageMissing),
        build = t(GatewayText::PageBuild),
        works = t(GatewayText::PageWorks),
        commands = commands.join("\n"),
    );
    answer::with(StatusCode::OK, "text/html; charset=utf-8", html)
}

#[cfg(test)]
mod tests {
    use super::*;
    use axum::http::header::ACCEPT_LANGUAGE;

    /// One page, one script in all forms, and one picture.
    fn find(name: &str) -> Option<Cow<'static, [u8]>> {
        let files: [(&str, &'static [u8]); 5] = [
            ("index.html", b"<page>"),
            ("assets/a-1f.js", b"script"),
            ("assets/a-1f.js.br", b"brotli"),
            ("assets/a-1f.js.gz", b"gzip"),
            ("icon.svg", b"<svg>"),
        ];
        let found = files.into_iter().find(|file| file.0 == name)?;
        Some(Cow::Borrowed(found.1))
    }

    fn asked(path: &str, header: (HeaderName, &'static str)) -> Answer {
        let headers = [(header.0, HeaderValue::from_static(header.1))];
        served(path, &headers.into_iter().collect(), &find).unwrap()
    }

    async fn body(answer: Answer) -> String {
        use http_body_util::BodyExt;
        let body = answer.into_body().collect().await.unwrap().to_bytes();
        String::from_utf8(body.to_vec()).unwrap()
    }

    fn told(answer: &Answer, header: HeaderName) -> &str {
        let value = answer.headers().get(header);
        value.map_or("", |value| value.to_str().unwrap())
    }

    #[tokio::test]
    async fn a_script_comes_in_the_form_the_browser_takes_and_is_kept() {
        for (encodings, wanted) in [
            ("gzip, deflate, br, zstd", "br"),
            ("gzip", "gzip"),
            ("br;q=0, gzip;q=0.5", "gzip"),
            ("identity", ""),
        ] {
            let answer = asked("assets/a-1f.js", (ACCEPT_ENCODING, encodings));
            assert_eq!(told(&answer, CONTENT_ENCODING), wanted, "{encodings}");
            assert!(told(&answer, CACHE_CONTROL).contains("immutable"));
            assert!(told(&answer, CONTENT_TYPE).starts_with("text/javascript"));
        }
        let answer = asked("assets/a-1f.js", (ACCEPT_ENCODING, "br"));
        assert_eq!(body(answer).await, "brotli");
    }

    #[tokio::test]
    async fn every_other_address_is_the_page() {
        for path in [
            "",
            "module/pump/live",
            "setup",
            "index.html",
            "no.such.thing",
        ] {
            let answer = asked(path, (ACCEPT_ENCODING, ""));
            assert_eq!(told(&answer, CACHE_CONTROL), "no-store", "{path}");
            assert_eq!(told(&answer, CONTENT_SECURITY_POLICY), POLICY);
            assert_eq!(body(answer).await, "<page>", "{path}");
        }
        let gone = asked("assets/a-2e.js", (ACCEPT_ENCODING, ""));
        assert_eq!(gone.status(), StatusCode::NOT_FOUND, "of an older build");
    }

    #[tokio::test]
    async fn without_pages_it_is_said_what_to_do() {
        let nothing = |_: &str| None;
        assert!(served("trends", &HeaderMap::new(), &nothing).is_none());
        for (asked, lang, word) in [
            ("zh-CN,en;q=0.5", Lang::En, "zh-CN"),
            ("fr, en-US;q=0.8, zh;q=0.1", Lang::Zh, "\"en\""),
            ("fr", Lang::Zh, "zh-CN"),
            ("é", Lang::En, "\"en\""),
        ] {
            let value = HeaderValue::from_str(asked).unwrap();
            let headers = [(ACCEPT_LANGUAGE, value)].into_iter().collect();
            let lang = language::spoken(&headers, lang);
            let page = body(missing(lang, ["railbus ls", "railbus watch"])).await;
            assert!(page.contains(word), "{asked}: {page}");
            assert!(page.contains("cargo xtask demo") && page.contains("railbus watch"));
        }
    }

    #[test]
    fn nothing_inline_is_allowed() {
        assert!(!POLICY.contains("unsafe") && !POLICY.contains("data:"));
    }
}

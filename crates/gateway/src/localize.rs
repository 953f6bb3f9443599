//! Problems in the language of the request. Codes and keys are the same in every language; with
//! `Accept-Language` there are texts, too: `detail` says what happened, `help` the likely causes
//! and what to do.

use super::answer;
use super::language::spoken;
use axum::body::to_bytes;
use axum::extract::{Request, State};
use axum::http::StatusCode;
use axum::http::header::{ACCEPT_LANGUAGE, ALLOW, CONTENT_LENGTH, CONTENT_TYPE};
use axum::middleware::Next;
use axum::response::Response;
use railbus_api::problem::{Problem, codes};
use railbus_app::failure::Failure;
use railbus_app::texts::AppText;
use railbus_words::Lang;

/// Problems are short: a longer body is none of ours.
const PROBLEM_MAX: usize = 64 << 10;

/// A response of another machine, whose problems have their texts from there.
#[derive(Clone, Copy, Debug)]
pub(super) struct ToldElsewhere;

/// Adds the texts to each problem in a response.
pub(super) async fn problems(State(lang): State<Lang>, request: Request, next: Next) -> Response {
    let lang = request
        .headers()
        .contains_key(ACCEPT_LANGUAGE)
        .then(|| spoken(request.headers(), lang));
    let response = next.run(request).await;
    let kind = response.headers().get(CONTENT_TYPE);
    let is_own = response.extensions().get::<ToldElsewhere>().is_none();
    let is_problem = is_own && kind.is_some_and(|kind| kind == "application/problem+json");
    match lang {
        Some(lang) if is_problem => in_words(lang, response).await,
        _ => response,
    }
}

/// Errors that occur before a handler runs, such as a body that is too long, are reported as
/// problems like all others.
pub(super) async fn only_problems(request: Request, next: Next) -> Response {
    let response = next.run(request).await;
    let status = response.status();
    let kind = response.headers().get(CONTENT_TYPE);
    let is_problem = kind.is_some_and(|kind| kind == "application/problem+json");
    if is_problem || !(status.is_client_error() || status.is_server_error()) {
        return response;
    }
    let reason = status.canonical_reason().unwrap_or_default();
    let kind = match status {
        StatusCode::METHOD_NOT_ALLOWED | StatusCode::NOT_FOUND => codes::NO_SUCH_PAGE,
        _ if status.is_server_error() => codes::INTERNAL,
        _ => codes::BAD_REQUEST,
    };
    let problem = Problem {
        status: status.as_u16(),
        ..Problem::new(kind)
    };
    let mut told = answer::problem(&problem.with("reason", reason));
    // `Allow`, if the method is wrong.
    if let Some(allowed) = response.headers().get(ALLOW) {
        told.headers_mut().insert(ALLOW, allowed.clone());
    }
    *told.extensions_mut() = response.into_parts().0.extensions;
    told
}

async fn in_words(lang: Lang, response: Response) -> Response {
    let (head, body) = response.into_parts();
    let read = to_bytes(body, PROBLEM_MAX).await.ok();
    let problem = read.and_then(|body| serde_json::from_slice::<Problem>(&body).ok());
    let Some(problem) = problem else {
        return answer::problem(&Problem::new(codes::INTERNAL).perhaps_acted(true));
    };
    let mut response = answer::problem(&told(lang, problem));
    // What is said of the request besides.
    *response.extensions_mut() = head.extensions;
    for (name, value) in &head.headers {
        // `Retry-After` and the like; headers about the body are those of the new one.
        if name != CONTENT_LENGTH && name != CONTENT_TYPE {
            response.headers_mut().append(name, value.clone());
        }
    }
    response
}

/// A problem with its texts.
pub(super) fn told(lang: Lang, problem: Problem) -> Problem {
    let failure = Failure::of_problem(lang, &problem);
    let acted = lang.get(AppText::MayHaveActed);
    let why = failure.why().iter().map(String::as_str);
    // This is `may_have_acted`: clients show that themselves, in a place of its own.
    let mut help: Vec<&str> = why.filter(|line| *line != acted).collect();
    help.extend([
        failure.code().page().likely(lang),
        failure.code().page().next(lang),
    ]);
    let detail = failure.message();
    problem.with("detail", detail).with("help", help)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn that_a_module_may_have_acted_is_said_once() {
        let problem = Problem {
            may_have_acted: true,
            ..Problem::new(codes::NO_REPLY)
        };
        for lang in [Lang::En, Lang::Zh] {
            let told = told(lang, problem.clone());
            let help = told.with.get("help").map(ToString::to_string);
            assert!(told.may_have_acted);
            assert!(!help.is_some_and(|help| help.contains(lang.get(AppText::MayHaveActed))));
        }
    }

    #[test]
    fn a_problem_is_told_in_the_language_asked_for() {
        let problem = || {
            let problem = Problem::new(codes::NO_SUCH_POINT);
            problem.with("module", "pump").with("name", "do9")
        };
        let english = told(Lang::En, problem());
        assert!(english.text("detail").contains("pump.do9"));
        let chinese = told(Lang::Zh, problem());
        assert_ne!(english.text("detail"), chinese.text("detail"));
        assert_eq!((english.code, english.title), (chinese.code, chinese.title));
        assert!(chinese.with.get("help").is_some_and(|help| help[1] != ""));
    }
}

//! The API's own document [OpenAPI 3.1], generated from the routes and their types.

use super::access::{Need, Role};
use super::answer;
use super::doc::{Doc, Shapes};
use super::route::{Answer, BASE, Route};
use super::routes::all;
use axum::http::StatusCode;
use axum::routing::get;
use railbus_api::problem::Problem;
use std::sync::LazyLock;
use utoipa::openapi::path::{
    Operation, OperationBuilder, Parameter, ParameterBuilder, ParameterIn,
};
use utoipa::openapi::request_body::RequestBodyBuilder;
use utoipa::openapi::security::{
    ApiKey, ApiKeyValue, HttpAuthScheme, HttpBuilder, SecurityRequirement, SecurityScheme,
};
use utoipa::openapi::{
    ComponentsBuilder, ContentBuilder, HttpMethod, InfoBuilder, LicenseBuilder, ObjectBuilder,
    OneOfBuilder, OpenApi, OpenApiBuilder, PathItem, PathsBuilder, Ref, RefOr, Required,
    ResponseBuilder, Schema, ServerBuilder, Type,
};
use utoipa::{PartialSchema, ToSchema};

/// The routes of this file.
pub(super) const ROUTES: &[Route] =
    &[
        Route::new("GET", "/openapi.json", Need::Nothing, || get(document))
            .doc(Doc::new("This document")),
    ];

/// An API, as its document tells of it.
pub(super) struct ApiAbout {
    pub(super) title: &'static str,
    pub(super) about: &'static str,
    /// What stands before every path; nothing if the paths are whole.
    pub(super) base: Option<&'static str>,
}

const SITE: ApiAbout = ApiAbout {
    title: "railbus",
    about: "Lines, modules and points of a site, as they are, and commands to them. \
            Fields are only ever added; readers ignore what they do not know.",
    base: Some(BASE),
};

/// The document does not change while the program runs.
static TEXT: LazyLock<String> = LazyLock::new(|| text(&SITE, all().map(|route| ("", route))));

async fn document() -> Answer {
    answer::with(StatusCode::OK, "application/json", TEXT.as_str())
}

/// The document of an API with these routes, each with what its path begins with.
pub(super) fn text(
    api: &ApiAbout,
    routes: impl Iterator<Item = (&'static str, &'static Route)>,
) -> String {
    make(api, routes).to_json().unwrap_or_default()
}

fn make(api: &ApiAbout, routes: impl Iterator<Item = (&'static str, &'static Route)>) -> OpenApi {
    let mut shapes = Shapes::new();
    let mut paths = PathsBuilder::new();
    for (prefix, route) in routes {
        if let (Some(doc), Some(method)) = (&route.doc, method(route.method)) {
            let path = format!("{prefix}{}", route.path);
            let item = PathItem::new(method, operation((&path, route), doc, &mut shapes));
            paths = paths.path(path, item);
        }
    }
    Problem::schemas(&mut shapes);
    shapes.push((Problem::name().into_owned(), Problem::schema()));
    let problem = ContentBuilder::new().schema(Some(Ref::from_schema_name(Problem::name())));
    let problem = ResponseBuilder::new()
        .description("Why it was not done [RFC 9457]; `code` is stable")
        .content("application/problem+json", problem.build());
    let components = ComponentsBuilder::new()
        .schemas_from_iter(shapes)
        .response("Problem", problem.build())
        .security_scheme("cookie", cookie())
        .security_scheme("bearer", bearer());
    OpenApiBuilder::new()
        .info(
            InfoBuilder::new()
                .title(api.title)
                .version(env!("CARGO_PKG_VERSION"))
                .description(Some(api.about))
                .license(Some(
                    LicenseBuilder::new()
                        .name("MIT OR Apache-2.0")
                        .identifier(Some("MIT OR Apache-2.0"))
                        .build(),
                )),
        )
        .servers(
            api.base
                .map(|base| [ServerBuilder::new().url(base).build()]),
        )
        .paths(paths)
        .components(Some(components.build()))
        .build()
}

fn cookie() -> SecurityScheme {
    let about = "A session; what changes something needs the header X-CSRF-Token as well. Its \
                 name ends with the daemon's own number: `railbus_session_0a1b2c3d`";
    SecurityScheme::ApiKey(ApiKey::Cookie(ApiKeyValue::with_description(
        "railbus_session",
        about,
    )))
}

fn bearer() -> SecurityScheme {
    let http = HttpBuilder::new().scheme(HttpAuthScheme::Bearer);
    SecurityScheme::Http(http.description(Some("A token: `rb_…`")).build())
}

fn method(name: &str) -> Option<HttpMethod> {
    Some(match name {
        "GET" => HttpMethod::Get,
        "PUT" => HttpMethod::Put,
        "POST" => HttpMethod::Post,
        "PATCH" => HttpMethod::Patch,
        "DELETE" => HttpMethod::Delete,
        _ => return None,
    })
}

fn operation((path, route): (&str, &Route), doc: &Doc, shapes: &mut Shapes) -> Operation {
    let mut content = ContentBuilder::new();
    if let Some(shape) = doc.answer {
        content = content.schema(Some(shape(shapes)));
    }
    // With one status for both, it is one or the other.
    if let (Some(shape), Some(plan), "200") = (doc.answer, doc.plan, doc.status) {
        let either = OneOfBuilder::new().item(shape(shapes)).item(plan(shapes));
        content = content.schema(Some(either));
    }
    let done = ResponseBuilder::new().description(doc.summary);
    let done = match doc.status {
        "101" | "204" => done.build(),
        _ => {
            let content = content.build();
            let media = doc.media.iter();
            media
                .fold(done, |done, media| done.content(*media, content.clone()))
                .build()
        }
    };
    let mut operation = OperationBuilder::new()
        .operation_id(Some(operation_id(route.method, path)))
        .tag(tag(route.path))
        .summary(Some(doc.summary))
        .description(Some(role(route.need)))
        .response(doc.status, done)
        .response("default", Ref::from_response_name("Problem"));
    if let Some(shape) = doc.plan.filter(|_| doc.status != "200") {
        let content = ContentBuilder::new().schema(Some(shape(shapes))).build();
        let plan = ResponseBuilder::new().description("What it would do. Nothing was done");
        let plan = plan.content("application/json", content).build();
        operation = operation.response("200", plan);
    }
    for parameter in parameters(path, doc) {
        operation = operation.parameter(parameter);
    }
    if let Some(shape) = doc.takes {
        let shape = shape(shapes);
        let required = must_say_something(&shape, shapes);
        let content = ContentBuilder::new().schema(Some(shape));
        let body = RequestBodyBuilder::new()
            .content("application/json", content.build())
            .required(Some(required));
        operation = operation.request_body(Some(body.build()));
    }
    if route.need != Need::Nothing {
        for scheme in ["cookie", "bearer"] {
            operation = operation.security(SecurityRequirement::new(scheme, [""; 0]));
        }
    }
    operation.build()
}

/// A body may be omitted if all its fields may be.
fn must_say_something(shape: &RefOr<Schema>, shapes: &Shapes) -> Required {
    let shape = match shape {
        RefOr::Ref(to) => {
            let name = to.ref_location.rsplit('/').next().unwrap_or_default();
            let found = shapes.iter().find(|(known, _)| known == name);
            found.map(|(_, shape)| shape)
        }
        RefOr::T(_) => Some(shape),
    };
    match shape {
        Some(RefOr::T(Schema::Object(object))) if object.required.is_empty() => Required::False,
        _ => Required::True,
    }
}

/// `get_points_module_label`.
fn operation_id(method: &str, path: &str) -> String {
    let words = path.split(|c: char| !c.is_ascii_alphanumeric());
    let words = words.filter(|word| !word.is_empty());
    words.fold(method.to_ascii_lowercase(), |id, word| id + "_" + word)
}

/// The first segment of the path.
fn tag(path: &str) -> &str {
    let path = path.trim_start_matches('/');
    path.split(['/', '.']).next().unwrap_or(path)
}

const fn role(need: Need) -> &'static str {
    match need {
        Need::Nothing => "Anybody may.",
        Need::Role(Role::Viewer) => "Viewers may.",
        Need::Role(Role::Operator) => "Operators may.",
        Need::Role(Role::Engineer) => "Engineers may.",
        Need::Role(Role::Admin) => "Admins may.",
        Need::Owner => "Only over the socket of the daemon's own user.",
    }
}

fn parameters(path: &str, doc: &Doc) -> Vec<Parameter> {
    let text = || Some(ObjectBuilder::new().schema_type(Type::String).build());
    let named = path.split('/').filter_map(|part| {
        let name = part.strip_prefix('{')?.strip_suffix('}')?;
        let parameter = ParameterBuilder::new().name(name);
        let parameter = parameter.parameter_in(ParameterIn::Path);
        Some(parameter.required(Required::True).schema(text()).build())
    });
    let asked = doc.query.iter().map(|(name, about)| {
        let parameter = ParameterBuilder::new().name(*name);
        let parameter = parameter.parameter_in(ParameterIn::Query);
        parameter.description(Some(*about)).schema(text()).build()
    });
    named.chain(asked).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::Value;
    use std::collections::BTreeSet;

    type Routes = Vec<(&'static str, &'static Route)>;

    /// Each document, and the routes that it is made of.
    fn documents() -> Vec<(Value, Routes)> {
        let of_site: Routes = all().map(|route| ("", route)).collect();
        let parsed = |text: &str| serde_json::from_str(text).unwrap();
        vec![
            (parsed(&TEXT), of_site),
            #[cfg(feature = "fleet")]
            (
                parsed(&crate::hub::DOCUMENT),
                crate::hub::documented().collect(),
            ),
        ]
    }

    #[test]
    fn every_route_is_in_its_document_and_nothing_else_is() {
        for (document, routes) in documents() {
            let (mut told, mut ids) = (BTreeSet::new(), BTreeSet::new());
            for (path, item) in document["paths"].as_object().unwrap() {
                for (method, operation) in item.as_object().unwrap() {
                    told.insert(format!("{} {path}", method.to_ascii_uppercase()));
                    let id = operation["operationId"].as_str().unwrap().to_owned();
                    assert!(ids.insert(id), "{method} {path}");
                }
            }
            let served: BTreeSet<String> = routes
                .iter()
                .map(|(prefix, route)| format!("{} {prefix}{}", route.method, route.path))
                .collect();
            assert_eq!(told, served, "each Route needs its .doc(Doc::new(…))");
        }
    }

    /// Readers of the document do not see the Rust code, so it must contain no links to items.
    #[test]
    fn no_description_links_to_code() {
        fn descriptions<'a>(value: &'a Value, all: &mut Vec<&'a str>) {
            match value {
                Value::Object(fields) => {
                    let own = fields.get("description").and_then(Value::as_str);
                    all.extend(own);
                    fields.values().for_each(|field| descriptions(field, all));
                }
                Value::Array(items) => items.iter().for_each(|item| descriptions(item, all)),
                _ => {}
            }
        }
        let documents = documents();
        let mut all = Vec::new();
        for (document, _) in &documents {
            descriptions(document, &mut all);
        }
        assert!(all.len() > 200, "{} are found", all.len());
        all.retain(|text| {
            ["[`", "`]", "crate::"]
                .iter()
                .any(|link| text.contains(link))
        });
        assert_eq!(all, Vec::<&str>::new());
    }

    #[test]
    fn every_shape_it_names_is_in_it() {
        for (document, _) in documents() {
            let text = document.to_string();
            for name in text.split("\"#/components/").skip(1) {
                let name = name.split('"').next().unwrap();
                let found = document.pointer(&format!("/components/{name}"));
                assert!(found.is_some_and(|shape| !shape.is_null()), "{name}");
            }
            assert_eq!(document["openapi"], "3.1.0");
        }
    }

    #[test]
    fn no_two_types_share_a_name() {
        let mut shapes = Shapes::new();
        // Pages take the shapes of both.
        let routes = documents().into_iter().flat_map(|(_, routes)| routes);
        for doc in routes.filter_map(|(_, route)| route.doc) {
            for shape in [doc.takes, doc.answer, doc.plan].into_iter().flatten() {
                shape(&mut shapes);
            }
        }
        let mut known = std::collections::BTreeMap::new();
        for (name, shape) in shapes {
            let shape = serde_json::to_value(shape).unwrap();
            let before = known.insert(name.clone(), shape.clone());
            assert!(before.is_none_or(|before| before == shape), "{name}");
        }
    }
}

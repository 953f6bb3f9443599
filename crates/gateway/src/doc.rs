//! The documentation of a route for the OpenAPI document: written beside the route, as data.

use utoipa::ToSchema;
use utoipa::openapi::{ObjectBuilder, Ref, RefOr, Schema, Type};

/// Schemas by name.
pub(super) type Shapes = Vec<(String, RefOr<Schema>)>;

/// Adds a schema to the others, and returns a reference to it.
type Shape = fn(&mut Shapes) -> RefOr<Schema>;

/// The documentation of one route. Permission and path parameters are known from the route itself.
#[derive(Clone, Copy, Debug)]
pub(super) struct Doc {
    /// What it does, in a few English words.
    pub(super) summary: &'static str,
    /// Query parameters, with descriptions.
    pub(super) query: &'static [(&'static str, &'static str)],
    /// The body; none if it takes none.
    pub(super) takes: Option<Shape>,
    /// The status of success.
    pub(super) status: &'static str,
    /// The media types of the answer, the default first.
    pub(super) media: &'static [&'static str],
    /// The answer's schema; none for any text.
    pub(super) answer: Option<Shape>,
    /// The answer to `?dry_run=1`, with status 200; none if that is not supported.
    pub(super) plan: Option<Shape>,
}

impl Doc {
    /// Takes nothing and answers with some JSON.
    pub(super) const fn new(summary: &'static str) -> Doc {
        Doc {
            summary,
            query: &[],
            takes: None,
            status: "200",
            media: &["application/json"],
            answer: None,
            plan: None,
        }
    }

    /// Takes a JSON body of this shape.
    pub(super) const fn takes<T: ToSchema>(mut self) -> Doc {
        self.takes = Some(shape::<T>);
        self
    }

    /// Takes a JSON body whose fields are described elsewhere: those of a table of the
    /// configuration.
    pub(super) const fn takes_object(mut self) -> Doc {
        self.takes = Some(object);
        self
    }

    /// Answers with JSON of this schema; for a stream it is the schema of each event.
    pub(super) const fn answers<T: ToSchema>(mut self) -> Doc {
        self.answer = Some(shape::<T>);
        self
    }

    /// Answers `?dry_run=1` with 200 and JSON of this schema.
    pub(super) const fn plans<T: ToSchema>(mut self) -> Doc {
        self.plan = Some(shape::<T>);
        self
    }

    /// Answers with something else than JSON, or with one of several types.
    pub(super) const fn media(mut self, media: &'static [&'static str]) -> Doc {
        self.media = media;
        self
    }

    /// The status of success, if it is not 200.
    pub(super) const fn status(mut self, status: &'static str) -> Doc {
        self.status = status;
        self
    }

    /// Query parameters, with descriptions.
    pub(super) const fn query(mut self, query: &'static [(&'static str, &'static str)]) -> Doc {
        self.query = query;
        self
    }
}

fn object(_: &mut Shapes) -> RefOr<Schema> {
    ObjectBuilder::new().schema_type(Type::Object).into()
}

fn shape<T: ToSchema>(shapes: &mut Shapes) -> RefOr<Schema> {
    T::schemas(shapes);
    shapes.push((T::name().into_owned(), T::schema()));
    Ref::from_schema_name(T::name()).into()
}

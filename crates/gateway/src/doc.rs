//! What the API's own document says of a route: written beside the route, as data.

use utoipa::ToSchema;
use utoipa::openapi::{ObjectBuilder, Ref, RefOr, Schema, Type};

/// The shapes of values, by name.
pub(super) type Shapes = Vec<(String, RefOr<Schema>)>;

/// Adds the shape of a value to those there are, and says where it is.
type Shape = fn(&mut Shapes) -> RefOr<Schema>;

/// What is said of one route. Who may use it and what its address holds, the route knows itself.
#[derive(Clone, Copy, Debug)]
pub(super) struct Doc {
    /// What it does, in a few English words.
    pub(super) summary: &'static str,
    /// What may follow the `?`: names, and what each means.
    pub(super) query: &'static [(&'static str, &'static str)],
    /// The body it takes; none where it takes none.
    pub(super) takes: Option<Shape>,
    /// The status of success.
    pub(super) status: &'static str,
    /// As what the answer comes: what it is where nobody says, and what else it can be.
    pub(super) media: &'static [&'static str],
    /// The answer's shape; none for any text.
    pub(super) answer: Option<Shape>,
    /// What 200 answers where `?dry_run=1` asks what would be done; none where nobody can ask.
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

    /// Takes a JSON body whose keys are told elsewhere: those of a table of the configuration.
    pub(super) const fn takes_object(mut self) -> Doc {
        self.takes = Some(object);
        self
    }

    /// Answers with JSON of this shape; of a stream it is the shape of each event.
    pub(super) const fn answers<T: ToSchema>(mut self) -> Doc {
        self.answer = Some(shape::<T>);
        self
    }

    /// Says with 200 and JSON of this shape what it would do, where `?dry_run=1` asks for it.
    pub(super) const fn plans<T: ToSchema>(mut self) -> Doc {
        self.plan = Some(shape::<T>);
        self
    }

    /// Answers with something else than JSON, or with one of several.
    pub(super) const fn media(mut self, media: &'static [&'static str]) -> Doc {
        self.media = media;
        self
    }

    /// Another status than 200 is success.
    pub(super) const fn status(mut self, status: &'static str) -> Doc {
        self.status = status;
        self
    }

    /// What may follow the `?`: names, and what each means.
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

//! What can be wrong with a configuration, as data: whoever shows it finds the words.

use super::FaultError;
use railbus_device::SetupError;
use railbus_host::NameError;
use railbus_wire::Micros;

/// A problem and its place.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Problem {
    /// The line in the text, from 1.
    pub line: usize,
    /// The column in characters, from 1.
    pub column: usize,
    /// The table and key it is about, as `module.pump.address`; empty for the whole text.
    pub path: String,
    /// What is wrong.
    pub kind: Kind,
}

/// What is wrong.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Kind {
    /// The text is no TOML; the parser's own words.
    Syntax(String),
    /// A key that does not exist here, and the one that may be meant.
    UnknownKey(Option<&'static str>),
    /// A key that must be there.
    MissingKey(&'static str),
    /// A value of another kind than the one named.
    WrongType(&'static str),
    /// A value that is none of these.
    NotOneOf(Vec<&'static str>),
    /// A number outside these bounds.
    OutOfRange(i64, i64),
    /// A name that is not made of `a-z`, `0-9` and `_`, 1 to 32 characters.
    BadName,
    /// Not a length of time with its unit, such as `200ms`.
    BadDuration,
    /// Not a range of an analog input.
    BadRange,
    /// Not the name of a port.
    BadPort(NameError),
    /// Another line is plugged into the same port.
    PortTaken(String),
    /// A line that is not there.
    NoSuchLine,
    /// A module that is not there.
    NoSuchModule,
    /// A point that the module does not have.
    NoSuchPoint,
    /// A point, named with its module, that is not there.
    NoSuchPath,
    /// A point that is no output.
    NotAnOutput,
    /// An output that is to exclude itself.
    InterlockSelf,
    /// A point that was named before in the same list.
    NamedTwice,
    /// A list longer than this.
    TooMany(usize),
    /// No time at all, or a longer one than this.
    TooLong(Micros),
    /// Neither `{ set = …, to = … }` nor `{ wait = … }`.
    BadStep,
    /// Not a condition of a rule.
    BadCondition,
    /// Not a time of day such as `06:30`.
    BadTime,
    /// Not something that a rule can do.
    BadAction,
    /// A text that is empty, or longer than so many characters.
    BadText(usize),
    /// An output that a person has to confirm, which a rule can't.
    NeedsPerson,
    /// A unit that is not the one of the point.
    OtherUnit(String),
    /// A point that is no input.
    NotAnInput,
    /// What the family says to the module.
    Setup(SetupError),
    /// Not a list of faults to simulate.
    BadFault(FaultError),
    /// A setting that the module does not have, or that stands elsewhere; those it has here.
    NoSuchSetting(Vec<String>),
    /// A setting that can't be this; what it can be.
    BadSetting(String),
    /// Not the address of a receiver of events.
    BadUrl,
    /// Another module on the same line has the same address in the same protocol.
    AddressTaken(String),
}

impl Kind {
    /// The stable code of this kind of problem; its first two digits are the exit code.
    #[must_use]
    pub const fn code(&self) -> &'static str {
        match self {
            Kind::Syntax(_) => "E0811",
            Kind::UnknownKey(_) => "E0812",
            Kind::MissingKey(_) => "E0813",
            Kind::WrongType(_) => "E0814",
            Kind::NotOneOf(_) => "E0815",
            Kind::OutOfRange(..) => "E0816",
            Kind::BadName => "E0817",
            Kind::BadDuration => "E0818",
            Kind::BadRange => "E0819",
            Kind::NoSuchLine => "E0820",
            Kind::NoSuchModule => "E0801",
            Kind::NoSuchPoint => "E0821",
            Kind::Setup(_) => "E0822",
            Kind::AddressTaken(_) => "E0823",
            Kind::NoSuchSetting(_) => "E0840",
            Kind::BadSetting(_) => "E0841",
            Kind::BadPort(_) => "E0825",
            Kind::PortTaken(_) => "E0826",
            Kind::BadFault(_) => "E0890",
            Kind::NoSuchPath => "E0821",
            Kind::NotAnOutput => "E0865",
            Kind::InterlockSelf => "E0866",
            Kind::NamedTwice => "E0867",
            Kind::TooMany(_) | Kind::TooLong(_) => "E0868",
            Kind::BadStep => "E0869",
            Kind::BadCondition | Kind::BadTime => "E0871",
            Kind::BadAction | Kind::BadText(_) => "E0872",
            Kind::NeedsPerson => "E0873",
            Kind::OtherUnit(_) => "E0874",
            Kind::BadUrl => "E0876",
            Kind::NotAnInput => "E0893",
        }
    }
}

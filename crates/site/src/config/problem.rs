//! Problems of a configuration as data: the text is made where they are shown.

use super::FaultError;
use railbus_device::SetupError;
use railbus_host::NameError;
use railbus_wire::Micros;

/// A problem and its position.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Problem {
    /// The line in the text, from 1.
    pub line: usize,
    /// The column in characters, from 1.
    pub column: usize,
    /// The path of the table or key, as `module.pump.address`; empty for the whole text.
    pub path: String,
    /// What is wrong.
    pub kind: Kind,
}

/// What is wrong.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Kind {
    /// The text is no TOML; the parser's own message.
    Syntax(String),
    /// An unknown key, and the one probably meant.
    UnknownKey(Option<&'static str>),
    /// A missing key.
    MissingKey(&'static str),
    /// A value of another type than this.
    WrongType(&'static str),
    /// A value that is none of these.
    NotOneOf(Vec<&'static str>),
    /// A number out of this range.
    OutOfRange(i64, i64),
    /// A name that is not 1 to 32 characters of `a-z`, `0-9` and `_`.
    BadName,
    /// Not a duration with its unit, such as `200ms`.
    BadDuration,
    /// Not a range of an analog input.
    BadRange,
    /// Not the name of a port.
    BadPort(NameError),
    /// Another line has the same port.
    PortTaken(String),
    /// An unknown line.
    NoSuchLine,
    /// An unknown module.
    NoSuchModule,
    /// A point that the module does not have.
    NoSuchPoint,
    /// The path of an unknown point.
    NoSuchPath,
    /// A point that is no output.
    NotAnOutput,
    /// An output in its own interlock.
    InterlockSelf,
    /// A point that is in the same list twice.
    NamedTwice,
    /// A list longer than this.
    TooMany(usize),
    /// A duration of zero, or a longer one than this.
    TooLong(Micros),
    /// Neither `{ set = …, to = … }` nor `{ wait = … }`.
    BadStep,
    /// Not a condition of a rule.
    BadCondition,
    /// Not a time of day such as `06:30`.
    BadTime,
    /// Not an action of a rule.
    BadAction,
    /// A text that is empty, or longer than this many characters.
    BadText(usize),
    /// An output that needs a person's confirmation, which a rule can't give.
    NeedsPerson,
    /// A unit other than that of the point.
    OtherUnit(String),
    /// A point that is no input.
    NotAnInput,
    /// The family rejects the module's setup.
    Setup(SetupError),
    /// Not a list of faults to simulate.
    BadFault(FaultError),
    /// A setting that the module does not have, or that has its own key elsewhere; those it has
    /// here.
    NoSuchSetting(Vec<String>),
    /// A value that this setting can't have; those it can.
    BadSetting(String),
    /// Not a valid receiver address.
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

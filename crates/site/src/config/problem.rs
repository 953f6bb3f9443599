//! Problems of a configuration as data: the text is made where they are shown.

use super::FaultError;
use railbus_device::SetupError;
use railbus_host::NameError;
use railbus_wire::Micros;

/// A problem and its position.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ConfigProblem {
    /// The line in the text, from 1.
    pub line: usize,
    /// The column in characters, from 1.
    pub column: usize,
    /// The path of the table or key, as `module.pump.address`; empty for the whole text.
    pub path: String,
    /// What is wrong.
    pub kind: Invalid,
}

/// What is wrong.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Invalid {
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
    /// Not an address with a port.
    BadListen,
    /// Not a network of addresses.
    BadNetwork,
    /// Not a part of a topic.
    BadTopic,
    /// Another outlet publishes at the same topics of the same broker.
    TopicsTaken(String),
    /// Not a module with its Modbus unit.
    BadUnit,
    /// A module whose address can't be a Modbus unit.
    NeedsUnit(String),
    /// A Modbus unit of two modules.
    UnitTaken(u8, [String; 2]),
    /// A server without a password that is open to other machines, and does not say which.
    Unguarded,
    /// Not a role with the outputs that it may switch.
    BadRole,
    /// Not the thumbprint of a certificate.
    BadThumbprint,
    /// These are not the servers of a fleet.
    BadServers,
    /// Not the public key of a centre that signs configurations.
    BadConfigKey,
    /// Another outlet takes the configuration from a centre already.
    ManagedBy(String),
    /// Outputs for clients without a role, where clients have roles.
    RolesOnly,
    /// Another module on the same line has the same address in the same protocol.
    AddressTaken(String),
}

impl Invalid {
    /// The stable code of this kind of problem; its first two digits are the exit code.
    #[must_use]
    pub const fn code(&self) -> &'static str {
        match self {
            Invalid::Syntax(_) => "E0811",
            Invalid::UnknownKey(_) => "E0812",
            Invalid::MissingKey(_) => "E0813",
            Invalid::WrongType(_) => "E0814",
            Invalid::NotOneOf(_) => "E0815",
            Invalid::OutOfRange(..) => "E0816",
            Invalid::BadName => "E0817",
            Invalid::BadDuration => "E0818",
            Invalid::BadRange => "E0819",
            Invalid::NoSuchLine => "E0820",
            Invalid::NoSuchModule => "E0801",
            Invalid::NoSuchPoint => "E0821",
            Invalid::Setup(_) => "E0822",
            Invalid::AddressTaken(_) => "E0823",
            Invalid::NoSuchSetting(_) => "E0840",
            Invalid::BadSetting(_) => "E0841",
            Invalid::BadPort(_) => "E0825",
            Invalid::PortTaken(_) => "E0826",
            Invalid::BadFault(_) => "E0890",
            Invalid::NoSuchPath => "E0821",
            Invalid::NotAnOutput => "E0865",
            Invalid::InterlockSelf => "E0866",
            Invalid::NamedTwice => "E0867",
            Invalid::TooMany(_) | Invalid::TooLong(_) => "E0868",
            Invalid::BadStep => "E0869",
            Invalid::BadCondition | Invalid::BadTime => "E0871",
            Invalid::BadAction | Invalid::BadText(_) => "E0872",
            Invalid::NeedsPerson => "E0873",
            Invalid::OtherUnit(_) => "E0874",
            Invalid::BadTopic | Invalid::TopicsTaken(_) => "E0855",
            Invalid::BadUrl => "E0876",
            Invalid::BadListen | Invalid::BadNetwork => "E0885",
            Invalid::BadUnit | Invalid::NeedsUnit(_) => "E0886",
            Invalid::UnitTaken(..) => "E0887",
            Invalid::Unguarded => "E0888",
            Invalid::BadRole | Invalid::RolesOnly => "E0889",
            Invalid::BadThumbprint => "E0834",
            Invalid::BadServers => "E0835",
            Invalid::BadConfigKey | Invalid::ManagedBy(_) => "E0945",
            Invalid::NotAnInput => "E0893",
        }
    }
}

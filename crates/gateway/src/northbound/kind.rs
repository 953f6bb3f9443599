//! What a kind of outlet is: its name, its settings as data, and its functions.

use super::offered::OfferWay;
use super::outlet::Outlet;
use crate::access::secret::Secret;
use railbus_api::problem::{Problem, ProblemType as ProblemKind, codes};
use railbus_site::config::Invalid;
use railbus_site::config::change::Keys;
use railbus_site::{Config, Events};
use railbus_words::Lang;
use std::net::SocketAddr;
use std::path::Path;
use std::pin::Pin;
use std::sync::Arc;

/// A text in English and in Simplified Chinese.
pub(crate) type Pair = [&'static str; 2];

/// The work of an outlet, on its own thread.
pub(crate) type Work<T> = Pin<Box<dyn Future<Output = T>>>;

/// Accepts an invitation, on the threads of the daemon.
pub(crate) type Join = fn(Invited) -> Pin<Box<dyn Future<Output = Result<Joined, Problem>> + Send>>;

/// An invitation for the outlet of this name, which may not be there yet.
#[cfg_attr(
    not(feature = "fleet"),
    expect(dead_code, reason = "the other kinds have no invitations")
)]
pub(crate) struct Invited {
    /// What it is to be called.
    pub(crate) name: String,
    /// What was handed over.
    pub(crate) invitation: Secret,
    /// The other side may say the configuration of this site.
    pub(crate) managed: bool,
    /// The settings of the outlet, if it is there.
    pub(crate) settings: Option<Keys>,
    /// The state folder.
    pub(crate) folder: Arc<Path>,
}

/// What came of an invitation.
pub(crate) struct Joined {
    /// The settings that it gives the outlet.
    pub(crate) settings: Keys,
    /// What the site is called at the other side.
    pub(crate) called: String,
    /// Until when that is valid, in seconds since 1970; none where it does not end.
    pub(crate) until: Option<i64>,
}

/// The table of the configuration in which outlets stand by name, each with its `type`. Only what
/// is older than it has a table of its own.
pub(crate) const TABLE: &str = "outlet";

/// The key of every outlet that says whether it runs; it does if it is left out.
pub(crate) const ENABLED: &str = "enabled";

/// The kinds of events, for outlets that tell some of them.
pub(crate) const EVENTS: &[(&str, Pair)] = &[
    ("write", ["Switching", "操作"]),
    ("module", ["Modules", "模块"]),
    ("line", ["Lines", "总线"]),
    ("config", ["Configuration", "配置"]),
    ("login", ["Users and signing in", "用户与登录"]),
    ("alarm", ["Alarms", "报警"]),
    ("rule", ["Rules", "规则"]),
    ("system", ["Program", "程序"]),
];

/// A kind of outlet.
pub(crate) struct OutletKind {
    /// As the configuration and the API have it: `a-z`, `0-9` and `_`.
    pub(crate) name: &'static str,
    /// What it is called.
    pub(crate) title: Pair,
    /// What it is for, in a sentence or two.
    pub(crate) about: Pair,
    /// What is to be known at the other side, a paragraph each.
    pub(crate) notes: &'static [Pair],
    /// Its settings, in the order of the form.
    pub(crate) fields: &'static [Field],
    /// Does its work until it is to stop, or until it can't go on; then it is started again after
    /// a while. It gets what happens at the site, from before it was started.
    pub(crate) run: fn(Outlet, Events) -> Work<Result<(), Problem>>,
    /// Tries once whether it works, and says what the other side answered.
    pub(crate) test: fn(Outlet) -> Work<Result<String, Problem>>,
    /// Accepts an invitation of the other side; none where there are none.
    pub(crate) join: Option<Join>,
    /// Where each point stands at the other side; none where that is not fixed.
    pub(crate) map: Option<AddressMap>,
    /// What the outlet of this name at this site offers other programs; none where there is
    /// nothing that the command line exports.
    pub(crate) offer: fn(&str, &Keys, site: &str, &Config) -> Option<OfferWay>,
    /// The outlet of this kind that the demo has.
    pub(crate) demo: Option<DemoOutlet>,
    /// Whether others connect to it, so that it counts them.
    pub(crate) has_clients: bool,
    /// What becomes of a running outlet when its settings change.
    pub(crate) on_change: OnChange,
    /// The table of the configuration in which its outlets stand: [`TABLE`].
    pub(crate) table: &'static str,
    /// Its outlets in a configuration, and their settings.
    pub(crate) outlets: fn(&OutletKind, &Config) -> Vec<(String, Keys)>,
    /// How the codes of events about its outlets begin: `outlet` of `outlet_fails`.
    pub(crate) events: &'static str,
    /// The problem where there is no outlet of a name.
    pub(crate) missing: ProblemKind,
    /// What is wrong with the settings of the outlet of this name beyond their shapes, each with
    /// the key.
    pub(crate) check: fn(&str, &Keys, &Config) -> Vec<(&'static str, Invalid)>,
    /// Refuses destinations that only the owner of the daemon may add.
    pub(crate) may_lead: fn(old: &Config, new: &Config) -> Result<(), Problem>,
    /// Undoes what one has left half done in the configuration file, in this state folder, before
    /// the file is read.
    pub(crate) recover: fn(config: &Path, state: &Path) -> Result<(), Problem>,
}

impl std::fmt::Debug for OutletKind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name)
    }
}

/// An outlet with no settings but its type, which the demo has while its port is free.
#[derive(Clone, Copy, Debug)]
pub(crate) struct DemoOutlet {
    /// Its name.
    pub(crate) name: &'static str,
    /// Where it listens.
    pub(crate) listen: SocketAddr,
    /// What is said of it on the terminal, where programs can be connected.
    pub(crate) about: Pair,
}

/// Where each point stands at the other side, as a table.
#[derive(Clone, Copy, Debug)]
pub(crate) struct AddressMap {
    /// What its columns are called.
    pub(crate) columns: &'static [Pair],
    /// Its rows for an outlet with these settings: a cell for each column.
    pub(crate) rows: fn(&Keys, &Config, Lang) -> Vec<Vec<String>>,
}

/// What becomes of a running outlet when its settings change.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum OnChange {
    /// It is stopped, and started with the new ones.
    Restart,
    /// It takes them over while it runs ([`Outlet::settings`]), and loses nothing that waits.
    HandOver,
}

/// The outputs that an outlet may switch, of kinds that give commands.
pub(crate) const WRITE: Field = Field::new(
    "write",
    ["Outputs that may be switched", "允许操作的输出"],
    Shape::Points,
)
.with_hint([
    "Outputs such as oven.k1, oven or *; nothing if left empty",
    "输出，如 oven.k1、oven 或 *；留空则均不可操作",
]);

/// A setting of an outlet.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Field {
    /// Its key in the configuration.
    pub(crate) key: &'static str,
    /// What it is called.
    pub(crate) title: Pair,
    /// What is to be known of it; empty where the title says it all.
    pub(crate) hint: Pair,
    /// What it can be.
    pub(crate) shape: Shape,
    /// It must be there.
    pub(crate) is_required: bool,
}

/// What a setting can be.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(
    not(any(test, feature = "opcua")),
    expect(dead_code, reason = "the kind of the tests has all of them")
)]
pub(crate) enum Shape {
    /// A text of 1 to so many bytes.
    Text(usize),
    /// An address with `http` or `https`, of so many bytes at most.
    Url(usize),
    /// Whether or not; not, where it is left out.
    Flag,
    /// A whole number from the first to the second; the third where it is left out.
    Number(i64, i64, i64),
    /// One of these words; the first where it is left out.
    Choice(&'static [(&'static str, Pair)]),
    /// Some of these words; empty for all of them.
    Choices(&'static [(&'static str, Pair)]),
    /// A list of texts; the kind says what they can be ([`OutletKind::check`]).
    Texts,
    /// The name of a line of the site.
    Line,
    /// Names of lines of the site; empty for all of them.
    Lines,
    /// Names of modules of the site; empty for all of them.
    Modules,
    /// Selectors of points, such as `oven.*`.
    Points,
    /// A text of these lengths in bytes that is kept in the state folder, not in the
    /// configuration, and never shown.
    Secret(usize, usize),
}

impl Field {
    /// A setting that can be left out and needs no explanation.
    pub(crate) const fn new(key: &'static str, title: Pair, shape: Shape) -> Field {
        Field {
            key,
            title,
            hint: ["", ""],
            shape,
            is_required: false,
        }
    }

    /// The same, but it must be there.
    pub(crate) const fn required(self) -> Field {
        Field {
            is_required: true,
            ..self
        }
    }

    /// The same, with what is to be known of it.
    pub(crate) const fn with_hint(self, hint: Pair) -> Field {
        Field { hint, ..self }
    }
}

impl OutletKind {
    /// A kind whose outlets stand in the table `[outlet.NAME]` and are restarted when their
    /// settings change.
    pub(crate) const fn new(
        name: &'static str,
        (title, about): (Pair, Pair),
        fields: &'static [Field],
        run: fn(Outlet, Events) -> Work<Result<(), Problem>>,
        test: fn(Outlet) -> Work<Result<String, Problem>>,
    ) -> OutletKind {
        OutletKind {
            name,
            title,
            about,
            notes: &[],
            fields,
            run,
            test,
            join: None,
            map: None,
            offer: |_, _, _, _| None,
            demo: None,
            has_clients: false,
            on_change: OnChange::Restart,
            table: TABLE,
            outlets: of_its_type,
            events: TABLE,
            missing: codes::NO_SUCH_OUTLET,
            check: |_, _, _| Vec::new(),
            may_lead: |_, _| Ok(()),
            recover: |_, _| Ok(()),
        }
    }

    /// The code of an event about one of its outlets, by its last word: `fails`, `works`,
    /// `secret_changed`, `secrets_lost`.
    pub(crate) fn event(&self, what: &str) -> String {
        format!("{}_{what}", self.events)
    }

    /// The lengths that its secret may have in bytes; none if it has no secret.
    pub(crate) fn secret(&self) -> Option<(usize, usize)> {
        self.fields.iter().find_map(|field| match field.shape {
            Shape::Secret(least, most) => Some((least, most)),
            _ => None,
        })
    }
}

/// The texts of a list among the settings.
pub(crate) fn texts<'s>(settings: &'s Keys, key: &str) -> impl Iterator<Item = &'s str> {
    let list = settings.get(key).and_then(|value| value.as_array());
    list.into_iter().flatten().filter_map(|item| item.as_str())
}

/// The tables `[outlet.NAME]` of this type.
fn of_its_type(kind: &OutletKind, config: &Config) -> Vec<(String, Keys)> {
    let all = config.outlets.iter();
    let its = all.filter(|(_, outlet)| outlet.kind == kind.name);
    its.map(|(name, outlet)| (name.clone(), outlet.settings.clone()))
        .collect()
}

//! Writes and calls of methods: commands of the site, each answered with its true end.

use crate::known::{KnownSite, is_output};
use crate::login::OpcuaUser;
use crate::status::OrderEnd;
use opcua::server::node_manager::ParsedWriteValue;
use opcua::types::{AttributeId, NumericRange, StatusCode, Variant};
use railbus_app::api::failures;
use railbus_device::Point;
use railbus_site::{
    By, CommandError, Config, Pulse, Service, ToggleTerms, Within, WriteDone, WriteTerms,
};
use railbus_wire::Micros;
use std::collections::BTreeMap;
use std::sync::Arc;

/// A write that can be a command: to this output.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct AskedOutput {
    pub(crate) module: String,
    pub(crate) point: Point,
    pub(crate) on: bool,
}

/// What a method does.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum MethodOrder {
    /// Gives a pulse, as long as this or as the module has it.
    Pulse(String, Option<Micros>),
    Toggle(String),
    AllOff,
}

/// The names of the methods of a module.
pub(crate) const PULSE: &str = "Pulse";
pub(crate) const TOGGLE: &str = "Toggle";
pub(crate) const ALL_OFF: &str = "AllOff";

/// What a write asks for; the status if it can't be a command.
pub(crate) fn asked(
    known: &KnownSite,
    user: &OpcuaUser,
    name: Option<&str>,
    write: &ParsedWriteValue,
) -> Result<AskedOutput, StatusCode> {
    if write.attribute_id != AttributeId::Value {
        return Err(StatusCode::BadNotWritable);
    }
    let status = name.and_then(|name| known.point(name));
    // Of what else there is, nothing can be written.
    let status = status.ok_or(StatusCode::BadNotWritable)?;
    if !is_output(status.point) || status.config.locked {
        return Err(StatusCode::BadNotWritable);
    }
    let may = user.rights.may_switch(&status.module, &status.label);
    may.map_err(|_| StatusCode::BadUserAccessDenied)?;
    if write.index_range != NumericRange::None {
        return Err(StatusCode::BadIndexRangeNoData);
    }
    // A value with a status that is not good switches nothing.
    if write.value.status.is_some_and(|status| !status.is_good()) {
        return Err(StatusCode::BadWriteNotSupported);
    }
    match write.value.value {
        Some(Variant::Boolean(on)) => Ok(AskedOutput {
            module: status.module.clone(),
            point: status.point,
            on,
        }),
        _ => Err(StatusCode::BadTypeMismatch),
    }
}

/// The writes of one request, as commands: those to one module go together, in as many commands as
/// an output is in twice. Each with the places of its writes in the request.
pub(crate) fn commands(asked: Vec<(usize, AskedOutput)>) -> Vec<Vec<ModuleWrite>> {
    let mut modules: BTreeMap<String, Vec<ModuleWrite>> = BTreeMap::new();
    for (place, output) in asked {
        let writes = modules.entry(output.module.clone()).or_default();
        let is_new = |write: &ModuleWrite| {
            let mut outputs = write.set.iter();
            outputs.all(|(point, _)| *point != output.point)
        };
        if !writes.last().is_some_and(is_new) {
            writes.push(ModuleWrite {
                module: output.module,
                set: Vec::new(),
                places: Vec::new(),
            });
        }
        if let Some(write) = writes.last_mut() {
            write.set.push((output.point, output.on));
            write.places.push(place);
        }
    }
    modules.into_values().collect()
}

/// A command to outputs of one module.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct ModuleWrite {
    pub(crate) module: String,
    pub(crate) set: Vec<(Point, bool)>,
    /// The places of these writes in their request.
    pub(crate) places: Vec<usize>,
}

/// Carries a write out, at the board that had this name when it was asked for.
pub(crate) async fn write(
    service: &Service,
    since: &Arc<Config>,
    write: &ModuleWrite,
    within: Within,
) -> OrderEnd {
    let terms = WriteTerms {
        within,
        ..WriteTerms::default()
    };
    let done = service.write_since(since, &write.module, &write.set, terms);
    ended(service, &write.module, done.await, write.set.len())
}

/// What a call of a method asks for; else what is wrong with each argument, or nothing where there
/// are too few. Too many are what the library refuses.
pub(crate) fn order(method: &str, arguments: &[Variant]) -> Result<MethodOrder, Vec<StatusCode>> {
    let label = |value: &Variant| match value {
        Variant::String(label) if !label.is_empty() => Ok(label.to_string()),
        _ => Err(StatusCode::BadTypeMismatch),
    };
    match (method, arguments) {
        (ALL_OFF, []) => Ok(MethodOrder::AllOff),
        (TOGGLE, [output]) => match label(output) {
            Ok(label) => Ok(MethodOrder::Toggle(label)),
            Err(why) => Err(vec![why]),
        },
        (PULSE, [output, width]) => {
            let width = match width {
                // As the module has it.
                Variant::UInt32(0) => Ok(None),
                Variant::UInt32(millis) => Ok(Some(Micros::from_millis(u64::from(*millis)))),
                _ => Err(StatusCode::BadTypeMismatch),
            };
            match (label(output), width) {
                (Ok(label), Ok(width)) => Ok(MethodOrder::Pulse(label, width)),
                (label, width) => {
                    let of = |why: Option<StatusCode>| why.unwrap_or(StatusCode::Good);
                    Err(vec![of(label.err()), of(width.err())])
                }
            }
        }
        _ => Err(Vec::new()),
    }
}

/// Carries a method out.
pub(crate) async fn call(
    service: &Service,
    module: &str,
    order: MethodOrder,
    within: Within,
) -> OrderEnd {
    match order {
        MethodOrder::Pulse(label, width) => {
            let pulse = Pulse {
                width,
                by: By::Auto,
                off: false,
                confirm: false,
                within,
            };
            let done = service.pulse_labelled((module, &label), pulse).await;
            match done {
                Ok(done) => OrderEnd::done(done.confirmed, &done.audit),
                Err(failure) => not_done(service, module, &failure, false),
            }
        }
        MethodOrder::Toggle(label) => {
            let terms = ToggleTerms {
                within,
                ..ToggleTerms::default()
            };
            let done = service.toggle_labelled((module, &label), terms).await;
            ended(service, module, done, 1)
        }
        MethodOrder::AllOff => {
            let config = service.config();
            let set = all_off(&config, module);
            let terms = WriteTerms {
                within,
                ..WriteTerms::default()
            };
            let done = service.write_since(&config, module, &set, terms).await;
            ended(service, module, done, set.len())
        }
    }
}

/// All outputs of a module that can be switched, off.
fn all_off(config: &Config, module: &str) -> Vec<(Point, bool)> {
    let Some(module) = config.modules.get(module) else {
        return Vec::new();
    };
    let points = module.setup.points().filter(|point| is_output(*point));
    let is_locked = |point: &Point| module.points.get(point).is_some_and(|of| of.locked);
    points
        .filter(|point| !is_locked(point))
        .map(|point| (point, false))
        .collect()
}

fn ended(
    service: &Service,
    module: &str,
    done: Result<WriteDone, CommandError>,
    outputs: usize,
) -> OrderEnd {
    match done {
        Ok(done) => OrderEnd::done(done.confirmed, &done.audit),
        Err(failure) => not_done(service, module, &failure, outputs == 1),
    }
}

fn not_done(service: &Service, module: &str, failure: &CommandError, tells: bool) -> OrderEnd {
    let problem = failures::problem(service, module, None, failure);
    OrderEnd::not_done(failure, &problem.code, tells)
}

#[cfg(test)]
mod tests {
    use super::*;
    use opcua::types::{DataValue, NodeId};
    use railbus_device::PointKind;
    use railbus_site::{Rights, Role};

    const SITE: &str = "[line.main]\nport = \"/dev/ttyS99\"\n[module.oven]\nline = \"main\"\n\
        model = \"erc8\"\naddress = 3\n[module.hall]\nline = \"main\"\nmodel = \"eda9060a\"\n\
        address = 1\n[module.oven.point]\nk6 = { locked = true }\n";

    fn output(module: &str, index: u8, on: bool) -> AskedOutput {
        let kind = PointKind::Output;
        AskedOutput {
            module: module.to_owned(),
            point: Point { kind, index },
            on,
        }
    }

    #[tokio::test]
    async fn only_outputs_that_one_may_switch_are_written() {
        let service = Service::start(Config::parse(SITE).unwrap()).unwrap();
        let mut known = KnownSite::new(Vec::new());
        known.take(&service.follow().next_now().unwrap());
        let user = |role, points: &[&str]| OpcuaUser {
            name: "li".to_owned(),
            rights: Rights {
                role,
                points: points.iter().map(|&point| point.to_owned()).collect(),
            },
        };
        let write = |attribute_id, value: Option<Variant>| ParsedWriteValue {
            node_id: NodeId::null(),
            attribute_id,
            index_range: NumericRange::None,
            value: DataValue {
                value,
                ..DataValue::default()
            },
        };
        let all = user(Role::Operator, &[]);
        let on = write(AttributeId::Value, Some(true.into()));
        let ask = |user: &OpcuaUser, name: Option<&str>, write: &ParsedWriteValue| {
            asked(&known, user, name, write).map(|asked| asked.on)
        };
        let [viewer, other] = [user(Role::Viewer, &[]), user(Role::Operator, &["oven.k2"])];
        assert_eq!(ask(&all, Some("oven.k1"), &on), Ok(true));
        for (name, user, wrong) in [
            (Some("oven.k6"), &all, StatusCode::BadNotWritable),
            (Some("hall.di0"), &all, StatusCode::BadNotWritable),
            (Some("oven/State"), &all, StatusCode::BadNotWritable),
            (None, &all, StatusCode::BadNotWritable),
            (Some("oven.k1"), &viewer, StatusCode::BadUserAccessDenied),
            (Some("oven.k1"), &other, StatusCode::BadUserAccessDenied),
        ] {
            assert_eq!(ask(user, name, &on), Err(wrong), "{name:?}");
        }
        for value in [
            Some(1_i32.into()),
            Some("true".into()),
            Some(1.0.into()),
            None,
        ] {
            let write = write(AttributeId::Value, value);
            let end = ask(&all, Some("oven.k1"), &write);
            assert_eq!(end, Err(StatusCode::BadTypeMismatch), "{write:?}");
        }
        let mut doubtful = write(AttributeId::Value, Some(true.into()));
        for (status, end) in [
            (StatusCode::Good, Ok(true)),
            (
                StatusCode::UncertainLastUsableValue,
                Err(StatusCode::BadWriteNotSupported),
            ),
            (
                StatusCode::BadNoCommunication,
                Err(StatusCode::BadWriteNotSupported),
            ),
        ] {
            doubtful.value.status = Some(status);
            assert_eq!(ask(&all, Some("oven.k1"), &doubtful), end, "{status}");
        }
        let name = write(AttributeId::DisplayName, Some(true.into()));
        assert_eq!(
            ask(&all, Some("oven.k1"), &name),
            Err(StatusCode::BadNotWritable)
        );
    }

    #[test]
    fn writes_to_one_module_go_together_and_none_is_lost() {
        let asked = vec![
            (0, output("oven", 0, true)),
            (2, output("hall", 0, true)),
            (3, output("oven", 1, false)),
            (4, output("oven", 0, false)),
            (5, output("oven", 2, true)),
        ];
        let commands = commands(asked);
        let told: Vec<Vec<(&str, &[usize])>> = commands
            .iter()
            .map(|writes| {
                writes
                    .iter()
                    .map(|write| (&*write.module, &*write.places))
                    .collect()
            })
            .collect();
        assert_eq!(
            told,
            [
                vec![("hall", &[2][..])],
                vec![("oven", &[0, 3][..]), ("oven", &[4, 5][..])]
            ]
        );
    }

    #[test]
    fn all_off_leaves_out_what_is_locked() {
        let config = Config::parse(SITE).unwrap();
        let off = all_off(&config, "oven");
        let indices: Vec<u8> = off.iter().map(|(point, _)| point.index).collect();
        assert_eq!(indices, [0, 1, 2, 3, 4, 6, 7]);
        assert!(off.iter().all(|(_, on)| !on));
    }

    #[test]
    fn methods_take_their_arguments_and_no_others() {
        let [label, width] = [Variant::from("k1"), Variant::from(500_u32)];
        let pulse = |width| Ok(MethodOrder::Pulse("k1".to_owned(), width));
        let millis = Some(Micros::from_millis(500));
        assert_eq!(order(PULSE, &[label.clone(), width.clone()]), pulse(millis));
        assert_eq!(order(PULSE, &[label.clone(), 0_u32.into()]), pulse(None));
        assert_eq!(order(ALL_OFF, &[]), Ok(MethodOrder::AllOff));
        let wrong = StatusCode::BadTypeMismatch;
        assert_eq!(order(TOGGLE, &[5_i32.into()]), Err(vec![wrong]));
        let both = order(PULSE, &[label, 5_i32.into()]);
        assert_eq!(both, Err(vec![StatusCode::Good, wrong]));
        assert_eq!(order(PULSE, &[width]), Err(Vec::new()));
        assert_eq!(order(TOGGLE, &[]), Err(Vec::new()));
    }
}

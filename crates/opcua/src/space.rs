//! The nodes: `railbus`, its lines, their modules, and the points of those.

use crate::known::{KnownSite, LINE, ROUND_TRIP, STATE, is_output, node_id, path};
use crate::orders::{ALL_OFF, PULSE, TOGGLE};
use crate::units::unit;
use opcua::server::address_space::{
    AccessLevel, AddressSpace, MethodBuilder, ObjectBuilder, VariableBuilder,
};
use opcua::types::argument::Argument;
use opcua::types::{
    DataTypeId, ExtensionObject, LocalizedText, NodeId, ObjectId, ObjectTypeId, QualifiedName,
    Range, VariableTypeId, Variant, WriteMask,
};
use railbus_device::{Point, PointKind};
use railbus_site::{ModuleStatus, PointStatus};
use railbus_words::Lang;

/// The namespace of our nodes.
pub(crate) const NAMESPACE: &str = "urn:railbus:site";
/// What the node under which all others are is called in paths, and the last part of its ID: no
/// module has such a name.
const ROOT: &str = "railbus";
const ROOT_ID: &str = "/railbus";
/// The minimum sampling interval of a point, in ms.
const FASTEST_MS: f64 = 0.0;

/// Makes the nodes.
pub(crate) struct SpaceMaker<'s> {
    pub(crate) space: &'s mut AddressSpace,
    pub(crate) namespace: u16,
    pub(crate) lang: Lang,
    /// Whether there is a history to read.
    pub(crate) has_history: bool,
    /// The nodes that were made.
    pub(crate) made: Vec<NodeId>,
}

impl SpaceMaker<'_> {
    /// Makes the nodes of a site.
    pub(crate) fn site(&mut self, known: &KnownSite, called: &str) {
        let root = self.id(ROOT_ID);
        let name = self.name(ROOT);
        ObjectBuilder::new(&root, name, self.text(called))
            .is_folder()
            .organized_by(ObjectId::ObjectsFolder)
            .insert(self.space);
        for line in known.lines() {
            let id = self.id(&format!("{LINE}/{}", line.name));
            let called = self.called(&line.called.en, &line.called.zh, &line.name);
            ObjectBuilder::new(&id, self.name(&line.name), called)
                .is_folder()
                .organized_by(root.clone())
                .insert(self.space);
            let state = format!("{LINE}/{}/{STATE}", line.name);
            self.variable(&state, STATE, &id, (DataTypeId::String, "".into()));
            for module in known.modules(&line.name) {
                self.module(module, &id);
                for point in known.points(&module.name) {
                    self.point(point);
                }
            }
        }
        for id in &self.made {
            if let Some(node) = self.space.find_mut(id) {
                // Of a node itself nothing can be written, and it has to say so.
                let node = node.as_mut_node();
                node.set_write_mask(WriteMask::empty());
                node.set_user_write_mask(WriteMask::empty());
            }
        }
    }

    fn id(&mut self, name: &str) -> NodeId {
        let id = node_id(self.namespace, name);
        self.made.push(id.clone());
        id
    }

    fn name(&self, name: &str) -> QualifiedName {
        QualifiedName::new(self.namespace, name)
    }

    fn text(&self, text: &str) -> LocalizedText {
        LocalizedText::new(self.lang.name(), text)
    }

    fn called(&self, en: &Option<String>, zh: &Option<String>, name: &str) -> LocalizedText {
        let text = match self.lang {
            Lang::En => en.as_ref().or(zh.as_ref()),
            Lang::Zh => zh.as_ref().or(en.as_ref()),
        };
        self.text(text.map_or(name, String::as_str))
    }

    /// A variable that can only be read, under an object.
    fn variable(
        &mut self,
        id: &str,
        name: &str,
        of: &NodeId,
        (of_type, value): (DataTypeId, Variant),
    ) {
        let id = self.id(id);
        VariableBuilder::new(&id, self.name(name), name)
            .component_of(of.clone())
            .has_type_definition(VariableTypeId::BaseDataVariableType)
            .data_type(of_type)
            .access_level(AccessLevel::CURRENT_READ)
            .user_access_level(AccessLevel::CURRENT_READ)
            .minimum_sampling_interval(FASTEST_MS)
            .value(value)
            .insert(self.space);
    }

    /// A property, which does not change.
    fn property(&mut self, of: &str, name: &str, (of_type, value): (DataTypeId, Variant)) {
        let id = self.id(&format!("{of}/{name}"));
        // Those that the standard names are of its namespace.
        let is_own = !matches!(
            name,
            "TrueState" | "FalseState" | "EURange" | "EngineeringUnits"
        );
        let browse = QualifiedName::new(if is_own { self.namespace } else { 0 }, name);
        VariableBuilder::new(&id, browse, name)
            .property_of(node_id(self.namespace, of))
            .has_type_definition(VariableTypeId::PropertyType)
            .data_type(of_type)
            .access_level(AccessLevel::CURRENT_READ)
            .user_access_level(AccessLevel::CURRENT_READ)
            .value(value)
            .insert(self.space);
    }

    fn module(&mut self, module: &ModuleStatus, line: &NodeId) {
        let name = module.name.as_str();
        let id = self.id(name);
        let called = self.called(&module.called.en, &module.called.zh, name);
        ObjectBuilder::new(&id, self.name(name), called)
            .has_type_definition(ObjectTypeId::BaseObjectType)
            .component_of(line.clone())
            .insert(self.space);
        let setup = &module.setup;
        self.property(
            name,
            "Model",
            (DataTypeId::String, setup.family.name().into()),
        );
        self.property(name, "Address", (DataTypeId::Byte, setup.address.0.into()));
        let protocol = setup.protocol.name().into();
        self.property(name, "Protocol", (DataTypeId::String, protocol));
        let (state, trip) = (format!("{name}/{STATE}"), format!("{name}/{ROUND_TRIP}"));
        self.variable(&state, STATE, &id, (DataTypeId::String, "".into()));
        self.variable(&trip, ROUND_TRIP, &id, (DataTypeId::Double, 0.0.into()));
        if module.setup.outputs > 0 {
            let output = self.argument("Output", DataTypeId::String, ["k1, do0"; 2]);
            let width = self.argument(
                "Milliseconds",
                DataTypeId::UInt32,
                ["0: as the module has it", "0：使用模块自身的设定"],
            );
            self.method(name, PULSE, &[output.clone(), width]);
            self.method(name, TOGGLE, &[output]);
            self.method(name, ALL_OFF, &[]);
        }
    }

    fn argument(&self, name: &str, of_type: DataTypeId, about: [&'static str; 2]) -> Argument {
        Argument {
            name: name.into(),
            data_type: of_type.into(),
            value_rank: -1,
            array_dimensions: None,
            description: self.text(self.lang.of(about)),
        }
    }

    fn method(&mut self, module: &str, name: &str, arguments: &[Argument]) {
        let id = self.id(&format!("{module}/{name}"));
        let mut method = MethodBuilder::new(&id, self.name(name), name)
            .component_of(node_id(self.namespace, module));
        if !arguments.is_empty() {
            let inputs = self.id(&format!("{module}/{name}/InputArguments"));
            method = method.input_args(self.space, &inputs, arguments);
        }
        let outputs = self.id(&format!("{module}/{name}/OutputArguments"));
        let ends = [
            self.argument(
                "End",
                DataTypeId::String,
                [
                    "readback, reply, sent, unknown or failed",
                    "readback（已回读）、reply（已应答）、sent（已发送）、unknown（结果未知）或 failed（失败）",
                ],
            ),
            self.argument(
                "Code",
                DataTypeId::String,
                ["E0106, if it was not done", "未执行时的错误代码，如 E0106"],
            ),
            self.argument(
                "Audit",
                DataTypeId::String,
                ["number of its entry in the audit log", "审计日志中的记录编号"],
            ),
        ];
        let method = method.output_args(self.space, &outputs, &ends);
        method.insert(self.space);
    }

    fn point(&mut self, point: &PointStatus) {
        let path = path(point);
        let id = self.id(&path);
        let config = &point.config;
        let called = self.called(&config.name_en, &config.name_zh, &point.label);
        let mut access = AccessLevel::CURRENT_READ;
        if is_output(point.point) && !config.locked {
            access |= AccessLevel::CURRENT_WRITE;
        }
        if self.has_history {
            access |= AccessLevel::HISTORY_READ;
        }
        let (data, variable) = types(point);
        let name = self.name(&point.label);
        VariableBuilder::new(&id, name, called)
            .component_of(node_id(self.namespace, &point.module))
            .has_type_definition(variable)
            .data_type(data)
            .access_level(access)
            .user_access_level(access)
            .historizing(self.has_history)
            .minimum_sampling_interval(FASTEST_MS)
            .insert(self.space);
        match point.point.kind {
            PointKind::Output | PointKind::Input => {
                let [off, on] = states(point.point);
                for (name, [en, zh]) in [("FalseState", off), ("TrueState", on)] {
                    let text = Variant::from(self.text(self.lang.of([en, zh])));
                    self.property(&path, name, (DataTypeId::LocalizedText, text));
                }
            }
            PointKind::Analog => {
                if let Some(range) = &point.range {
                    let ends = Range {
                        low: range.low.min(range.high),
                        high: range.low.max(range.high),
                    };
                    let ends = ExtensionObject::from_message(ends);
                    self.property(&path, "EURange", (DataTypeId::Range, ends.into()));
                    let unit = ExtensionObject::from_message(unit(&range.unit));
                    let unit = (DataTypeId::EUInformation, unit.into());
                    self.property(&path, "EngineeringUnits", unit);
                }
            }
            PointKind::Variable => {}
        }
    }
}

/// The types of a point: of its value, and of its node.
fn types(point: &PointStatus) -> (DataTypeId, VariableTypeId) {
    match point.point.kind {
        PointKind::Output | PointKind::Input => {
            (DataTypeId::Boolean, VariableTypeId::TwoStateDiscreteType)
        }
        // A range is what makes it one of that type.
        PointKind::Analog if point.range.is_some() => {
            (DataTypeId::Double, VariableTypeId::AnalogUnitRangeType)
        }
        PointKind::Analog => (DataTypeId::Double, VariableTypeId::BaseDataVariableType),
        PointKind::Variable => (DataTypeId::UInt32, VariableTypeId::BaseDataVariableType),
    }
}

/// What the states of a digital point are called: off and on.
const fn states(point: Point) -> [[&'static str; 2]; 2] {
    match point.kind {
        PointKind::Output => [["off", "断开"], ["on", "接通"]],
        _ => [["0", "0"], ["1", "1"]],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use railbus_site::{Config, Service};

    const SITE: &str = "[line.main]\nport = \"/dev/ttyS99\"\n[module.railbus]\nline = \"main\"\n\
        model = \"erc8\"\naddress = 3\n[module.line]\nline = \"main\"\nmodel = \"emd2a2q\"\n\
        address = 5\n";

    #[test]
    fn an_argument_is_described_in_the_language_of_the_server() {
        for (lang, text) in [(Lang::En, "pulse"), (Lang::Zh, "脉冲")] {
            let maker = SpaceMaker {
                space: &mut AddressSpace::new(),
                namespace: 2,
                lang,
                has_history: false,
                made: Vec::new(),
            };
            let argument = maker.argument("Output", DataTypeId::String, ["pulse", "脉冲"]);
            assert_eq!(argument.description, LocalizedText::new(lang.name(), text));
        }
    }

    #[tokio::test]
    async fn every_node_is_one_of_its_own_and_says_that_it_stays_as_it_is() {
        let service = Service::start(Config::parse(SITE).unwrap()).unwrap();
        let mut known = KnownSite::new(Vec::new());
        known.take(&service.follow().next_now().unwrap());
        let mut space = AddressSpace::new();
        space.add_namespace(NAMESPACE, 2);
        let mut maker = SpaceMaker {
            space: &mut space,
            namespace: 2,
            lang: Lang::En,
            has_history: false,
            made: Vec::new(),
        };
        maker.site(&known, "plant");
        let made = maker.made;
        let ids: std::collections::HashSet<_> = made.iter().collect();
        assert_eq!(
            ids.len(),
            made.len(),
            "a module may be called like another node"
        );
        assert!(ids.contains(&node_id(2, "railbus")) && ids.contains(&node_id(2, ROOT_ID)));
        for id in &made {
            let node = space.find(id).unwrap().as_node();
            let masks = [node.write_mask(), node.user_write_mask()];
            let masks = masks.map(|mask| mask.map(|mask| mask.bits()));
            assert_eq!(masks, [Some(0), Some(0)], "{id}");
        }
    }
}

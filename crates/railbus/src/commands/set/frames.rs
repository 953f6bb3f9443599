//! The frames that `set --dry-run` shows.

use super::orders::{Order, State};
use crate::backend::Backend;
use crate::commands::Context;
use crate::texts::Text;
use railbus_api::types::ModuleInfo;
use railbus_app::failure::Failure;
use railbus_app::render::records::Records;
use railbus_app::render::table::Table;
use railbus_device::{Bank, Family, Layout, Module, Op, PointKind, Setup};
use railbus_wire::{Address, Channel, Frame, Protocol};
use railbus_words::Code;
use railbus_words::hex;
use serde_json::json;

/// Every frame of these switching steps, consecutive ones of one module together.
pub(in crate::commands) async fn show<'o>(
    context: &Context,
    backend: &Backend,
    groups: impl Iterator<Item = &'o [Order]>,
) -> Result<String, Failure> {
    let modules = backend.modules().await;
    let modules = modules.map_err(|problem| context.failure(&problem))?;
    let mut table = Table::bare();
    let mut rows = Vec::new();
    for group in groups {
        let first = group.first().map_or("", |order| order.module.as_str());
        let info = modules.iter().find(|info| info.module == first);
        let module = info
            .and_then(module_of)
            .ok_or_else(|| Failure::of(context.lang, Code::NoModule).because(first))?;
        for op in ops(context, &module, group)? {
            let exchange = module.exchange(&op);
            let exchange = exchange.map_err(|_| Failure::of(context.lang, Code::Unsupported))?;
            let mut frame = Frame::new();
            exchange.encode(&mut frame);
            let told = context.lang.get(Text::WouldSend).to_owned();
            let bytes = hex::spaced(frame.bytes());
            table.add([told, first.to_owned(), bytes.clone()]);
            rows.push(json!({ "module": first, "bytes": bytes }));
        }
    }
    let records = Records {
        key: "frames",
        rows,
        columns: &["module", "bytes"],
        value: "bytes",
        table,
    };
    Ok(records.render(context.format))
}

/// The ops for the outputs of one module, each with as many as fit into one frame.
fn ops(context: &Context, module: &Module, group: &[Order]) -> Result<Vec<Op>, Failure> {
    let mut ops = Vec::new();
    let mut left = Bank::default();
    for order in group {
        let point = module.setup().point(&order.point);
        let output = point.filter(|point| point.kind == PointKind::Output);
        let channel = output.and_then(|point| Channel::new(point.index));
        let channel = channel
            .ok_or_else(|| Failure::of(context.lang, Code::NoPoint).because(order.path()))?;
        if order.state == State::Toggle {
            ops.push(Op::Toggle(channel.mask()));
        } else {
            let on = if order.state == State::On {
                channel.mask()
            } else {
                0
            };
            left = Bank::new(left.mask | channel.mask(), left.on & !channel.mask() | on);
        }
    }
    let mut writes = Vec::new();
    while left.mask != 0 {
        let part = module.group(left);
        writes.push(Op::Write(part));
        left = Bank::new(left.mask & !part.mask, left.on);
    }
    writes.extend(ops);
    Ok(writes)
}

/// The module that the API describes.
fn module_of(info: &ModuleInfo) -> Option<Module> {
    let family = Family::from_name(&info.model)?;
    let protocols = Protocol::ALL.into_iter();
    let protocol = protocols
        .into_iter()
        .find(|known| known.name() == info.protocol)?;
    let count = |bits: &str| u8::try_from(bits.chars().count()).ok();
    let (outputs, inputs) = (count(&info.outputs)?, count(&info.inputs)?);
    let layout = match (outputs, inputs) {
        (_, 0) => Layout::Outputs,
        (0, _) => Layout::Inputs,
        _ => Layout::Mixed,
    };
    let setup = Setup {
        protocol,
        outputs,
        inputs,
        layout,
        ..Setup::new(family, Address(info.address))
    };
    Module::new(setup).ok()
}

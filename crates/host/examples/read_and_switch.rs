//! Opens a line with one ERC-8 at address 3, reads its relays, and switches the third one.
//!
//! ```text
//! cargo run --example read_and_switch -- /dev/ttyUSB0
//! cargo run --example read_and_switch -- tcp:10.0.0.5:4001
//! ```
#![allow(clippy::print_stdout, reason = "it is a program")]

use railbus_host::{
    Address, Bank, Channel, Family, Line, LineName, LineOptions, Module, ModuleId, Observation, Op,
    Plan, Setup, Terms,
};
use std::error::Error;

#[tokio::main(flavor = "current_thread")]
async fn main() -> Result<(), Box<dyn Error>> {
    let name = std::env::args().nth(1);
    let name = name.ok_or("say which line: /dev/ttyUSB0, tcp:HOST:PORT, …")?;
    read_and_switch(name.parse()?).await
}

/// The whole of it.
pub async fn read_and_switch(name: LineName) -> Result<(), Box<dyn Error>> {
    // A module as it leaves the factory: Modbus RTU, 9600 8N1. It is only asked when we ask;
    // with `Plan::default()` it would be polled, and `line.events()` would tell what it says.
    let oven = Module::new(Setup::new(Family::Erc8, Address(3)))?;
    let line = Line::open(LineOptions::new(name).with(oven, Plan::NEVER))?;
    line.opened().await?;
    let oven = ModuleId(0);

    let read = line.run(oven, Op::ReadOutputs, Terms::default()).await?;
    if let Some(Observation::Channels { outputs, .. }) = read.seen {
        println!("relays: {:08b}", outputs.on);
    }

    // Channels count from 0: this is the relay that is labelled K3.
    let k3 = Channel::new(2).ok_or("32 channels at most")?;
    let on = Op::Write(Bank::one(k3, true));
    let done = match line.run(oven, on, Terms::default()).await {
        Ok(done) => done,
        Err(fault) if fault.may_have_acted() => {
            return Err(format!("nobody knows whether K3 is on: {fault}").into());
        }
        Err(fault) => return Err(format!("K3 was not switched: {fault}").into()),
    };
    println!("K3 is on: {:?} after {} us", done.confirmed, done.took.0);

    line.close().await;
    Ok(())
}

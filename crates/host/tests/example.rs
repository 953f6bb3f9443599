//! The example does what it says.

mod support;

#[path = "../examples/read_and_switch.rs"]
#[allow(
    dead_code,
    unreachable_pub,
    reason = "its main is not run here, and it is a module here"
)]
mod read_and_switch;

use railbus_host::{Family, LineName, Protocol};
use support::{Player, pty, setup, soon};

#[tokio::test]
async fn the_example_switches_the_relay() {
    let (master, path) = pty();
    let player = Player::start(master, &[setup(Family::Erc8, 3, Protocol::Rtu)], false);
    let run = read_and_switch::read_and_switch(LineName::Serial(path));
    soon(run).await.expect("it works");
    assert_eq!(player.stop()[0].outputs(), 0b100);
}

#[tokio::test]
async fn the_example_says_why_it_does_not_work() {
    let name = LineName::Serial("/dev/railbus none such".into());
    let error = soon(read_and_switch::read_and_switch(name)).await;
    assert_eq!(error.expect_err("no such port").to_string(), "missing");
}

//! The firmware in QEMU, held to what the simulator is held to. `cargo xtask firmware test` builds
//! the images and runs this.
#![allow(clippy::print_stdout, reason = "what was run is told")]

mod cases;

use std::path::PathBuf;

/// Where `cargo xtask firmware build` put the images.
fn images() -> PathBuf {
    let folder = std::env::var_os("RAILBUS_FIRMWARE");
    folder
        .expect("run by `cargo xtask firmware test`, which says where the images are")
        .into()
}

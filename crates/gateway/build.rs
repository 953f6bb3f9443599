//! Says where the web pages are missing or old: it never builds them, since a build that starts
//! npm behind one's back is a trap.

use std::path::Path;
use std::time::SystemTime;

/// The web pages are made by `cargo xtask web`.
fn main() {
    let web = Path::new("../../web");
    for watched in ["src", "dist/index.html"] {
        println!("cargo::rerun-if-changed={}", web.join(watched).display());
    }
    let page = web.join("dist/index.html").metadata();
    let what = match page.and_then(|page| page.modified()) {
        Err(_) => "the web pages are not built",
        Ok(built) if newest(&web.join("src")) > Some(built) => "the web pages are old",
        Ok(_) => return,
    };
    println!("cargo::warning={what}: `cargo xtask web` makes them");
}

/// When something below a folder was last changed.
fn newest(folder: &Path) -> Option<SystemTime> {
    let entries = std::fs::read_dir(folder).ok()?.flatten();
    let changed = entries.filter_map(|entry| match entry.file_type().ok()?.is_dir() {
        true => newest(&entry.path()),
        false => entry.metadata().ok()?.modified().ok(),
    });
    changed.max()
}

//! Gathers the published schemas: a command's schema is the file of its name in `schemas`, and
//! nothing else has to name it. And says where the web pages are missing or old: it never builds
//! them, since a build that starts npm behind one's back is a trap.

use std::fmt::Write;
use std::path::Path;
use std::time::SystemTime;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    warn_of_old_pages();
    schemas()
}

/// The web pages are made by `cargo xtask web`.
fn warn_of_old_pages() {
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

fn schemas() -> Result<(), Box<dyn std::error::Error>> {
    println!("cargo::rerun-if-changed=schemas");
    let folder = Path::new(&std::env::var("CARGO_MANIFEST_DIR")?).join("schemas");
    let mut names = Vec::new();
    for entry in std::fs::read_dir(&folder)? {
        let path = entry?.path();
        let stem = path.file_stem().and_then(|stem| stem.to_str());
        if let (Some(stem), Some("json")) = (stem, path.extension().and_then(|e| e.to_str())) {
            names.push((stem.to_owned(), path.display().to_string()));
        }
    }
    names.sort();
    let mut text = "&[\n".to_owned();
    for (name, path) in names {
        writeln!(text, "    ({name:?}, include_str!({path:?})),")?;
    }
    text += "]\n";
    let out = Path::new(&std::env::var("OUT_DIR")?).join("schemas.rs");
    std::fs::write(out, text)?;
    Ok(())
}

//! Gathers the published schemas: a command's schema is the file of its name in `schemas`, and
//! nothing else has to name it.

use std::fmt::Write;
use std::path::Path;

fn main() -> Result<(), Box<dyn std::error::Error>> {
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

//! Finds the program that has a port open, as far as this user may see.

use crate::Holder;
use std::fs::{self, Metadata};
use std::os::fd::RawFd;
use std::os::unix::fs::{FileTypeExt, MetadataExt};
use std::path::Path;

/// The first process that has this terminal open, other than through our own descriptor `own`.
/// Another line of this process counts.
pub(crate) fn find(tty: &Metadata, own: Option<RawFd>) -> Option<Holder> {
    first(tty, own, |_| true)
}

/// The same without the process at the other end of a pseudo-terminal, which may keep both open: it
/// is the device here, and no other program that uses it.
pub(crate) fn find_rival(tty: &Metadata, own: Option<RawFd>) -> Option<Holder> {
    first(tty, own, |process| !has_other_end(process, tty))
}

fn first(tty: &Metadata, own: Option<RawFd>, counts: impl Fn(&Path) -> bool) -> Option<Holder> {
    let me = std::process::id();
    for process in fs::read_dir("/proc").ok()?.flatten() {
        let name = process.file_name();
        let Some(pid) = name.to_str().and_then(|name| name.parse::<u32>().ok()) else {
            continue;
        };
        let own = own.filter(|_| pid == me);
        if holds(&process.path(), tty, own) && counts(&process.path()) {
            let name = fs::read_to_string(process.path().join("comm")).unwrap_or_default();
            let name = name.trim_end().to_owned();
            return Some(Holder { pid, name });
        }
    }
    None
}

fn holds(process: &Path, tty: &Metadata, own: Option<RawFd>) -> bool {
    let Ok(descriptors) = fs::read_dir(process.join("fd")) else {
        // Another user's process, or one that has just ended.
        return false;
    };
    descriptors.flatten().any(|entry| {
        let number = entry.file_name();
        let number = number.to_str().and_then(|number| number.parse().ok());
        let is_own = own.is_some() && number == own;
        !is_own && fs::metadata(entry.path()).is_ok_and(|open| is_same(&open, tty))
    })
}

/// Whether a process has the master of this pseudo-terminal open.
fn has_other_end(process: &Path, pts: &Metadata) -> bool {
    let index = rustix::fs::minor(pts.rdev());
    let Ok(descriptors) = fs::read_dir(process.join("fdinfo")) else {
        return false;
    };
    descriptors.flatten().any(|entry| {
        let info = fs::read_to_string(entry.path()).unwrap_or_default();
        let of = info
            .lines()
            .find_map(|line| line.strip_prefix("tty-index:"));
        of.and_then(|of| of.trim().parse().ok()) == Some(index)
    })
}

/// Names and mounts may differ; the device is the same.
fn is_same(a: &Metadata, b: &Metadata) -> bool {
    a.file_type().is_char_device() && a.rdev() == b.rdev() && a.dev() == b.dev()
}

//! What kinds that serve Modbus share: every module is a unit, whatever it speaks on its line.
//!
//! - Settings that they have in common: `fields`. How they are tested: `identify`.
//! - Which module is which unit: `units`. Which coil or register of it is which point: `map`; the
//!   same for people: `table`.
//! - Where the points of a TCP server stand, by its settings alone: `offered`.
//! - What is known of the points, and answers to reads: `image`.
//! - Requests to units, without what frames them: `request`.
//! - The units of a site, and who carries their writes out: `site_units`.
//! - How a command ended, in Modbus' codes: `ends`.

pub(crate) mod ends;
pub(crate) mod fields;
pub(crate) mod identify;
pub(crate) mod image;
mod map;
pub(crate) mod offered;
pub(crate) mod request;
pub(crate) mod site_units;
pub(crate) mod table;
pub(crate) mod units;

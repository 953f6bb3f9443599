//! Changes of settings on simulated modules: what is said of a module is compared with what its
//! EEPROM holds.

mod bench;
mod changes;
mod cuts;
mod strangers;

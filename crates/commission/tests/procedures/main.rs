//! Changes of settings on simulated modules: what is reported about a module is compared with its
//! EEPROM.

mod bench;
mod changes;
mod cuts;
mod strangers;

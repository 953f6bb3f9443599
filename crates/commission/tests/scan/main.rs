//! Whole scans in virtual time: simulated modules, byte times, collisions, and the line's own
//! state machine between them and the scan.

mod bench;
mod budgets;
mod honest;
mod patience;
mod strangers;

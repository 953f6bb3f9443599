//! What our own modules do beyond the datasheets: nothing, unless [`crate::Options::beyond`] is on.

/// What a module keeps for it over a loss of power [BEYOND §1.2].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Beyond {
    /// The host watchdog in tenths of a second, 0.1 s to 25.5 s; 0 does not watch.
    pub watchdog: u8,
    /// Outputs at power-up: bit n = output n is on.
    pub power_on: u32,
    /// Outputs when the host watchdog trips: bit n = output n is on.
    pub safe: u32,
    /// The host watchdog has tripped, and nobody has cleared that yet.
    pub tripped: bool,
}

impl Beyond {
    /// Nothing is watched, and all outputs are off at power-up: as the makers' modules are.
    pub const NEUTRAL: Beyond = Beyond {
        watchdog: 0,
        power_on: 0,
        safe: 0,
        tripped: false,
    };
}

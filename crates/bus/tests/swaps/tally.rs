//! What was counted on a line, and how near its limits came.

/// What the judge counted, and how near its limits came.
#[derive(Default)]
pub(crate) struct Tally {
    pub(crate) swaps: u64,
    pub(crate) done: u64,
    pub(crate) not_done: u64,
    pub(crate) strangers: u64,
    pub(crate) values: u64,
    /// Of another model: undetectable, or within [`FOREIGN_MAX`].
    pub(crate) unnoticed_values: u64,
    pub(crate) foreign_values: u64,
    pub(crate) unnoticed_commands: u64,
    pub(crate) foreign_commands: u64,
    pub(crate) accused: u64,
    pub(crate) taken_for: u64,
    pub(crate) foreign: u64,
    pub(crate) unread: u64,
}

impl Tally {
    pub(crate) fn add(&mut self, other: &Tally) {
        self.swaps += other.swaps;
        self.done += other.done;
        self.not_done += other.not_done;
        self.strangers += other.strangers;
        self.values += other.values;
        self.unnoticed_values += other.unnoticed_values;
        self.foreign_values += other.foreign_values;
        self.unnoticed_commands += other.unnoticed_commands;
        self.foreign_commands += other.foreign_commands;
        self.accused = self.accused.max(other.accused);
        self.taken_for = self.taken_for.max(other.taken_for);
        self.foreign = self.foreign.max(other.foreign);
        self.unread = self.unread.max(other.unread);
    }

    pub(crate) fn show(&self, lines: u64) {
        println!(
            "{lines} lines, {} swaps; commands: {} done, {} not, {} by an unnoticed stranger, \
             {} by another; {} values, {} of an unnoticed stranger, {} of another; \
             told as strangers: {}",
            self.swaps,
            self.done,
            self.not_done,
            self.unnoticed_commands,
            self.foreign_commands,
            self.values,
            self.unnoticed_values,
            self.foreign_values,
            self.strangers
        );
        println!(
            "longest, in us: accused {}, taken for another {}, foreign values {}, unread {}",
            self.accused, self.taken_for, self.foreign, self.unread
        );
    }
}

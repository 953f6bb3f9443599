//! The settings that a module starts with, and where later ones are stored.

use railbus_device::{Eeprom, Setup};
use railbus_nvm::{Counters, Held, Record, RecordError, SettingsStore, Store};
use railbus_wire::Instant;

/// Where the settings that a module started with came from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Origin {
    /// Its store was empty: they are the factory's.
    Factory,
    /// Its store.
    Kept,
    /// The factory's, as the store has those of a family that this image is not for.
    OtherFamily,
    /// The factory's, as the store has those of a newer firmware; nothing will be stored.
    Newer,
    /// The factory's, as the store does not answer.
    Unreadable,
}

impl Origin {
    /// Its word on the console.
    #[must_use]
    pub const fn text(self) -> &'static str {
        match self {
            Origin::Factory => "factory",
            Origin::Kept => "kept",
            Origin::OtherFamily => "factory; another family's are not used",
            Origin::Newer => "factory; a newer firmware's are left alone",
            Origin::Unreadable => "factory; the store does not answer",
        }
    }
}

/// The settings of a module, and where they are stored.
#[derive(Debug)]
pub struct Kept<S> {
    keeper: SettingsStore<S>,
    record: Record,
    origin: Origin,
}

impl<S: Store> Kept<S> {
    /// The settings in this store, or the factory's settings of this module.
    ///
    /// # Errors
    /// If such a module can't have left the factory.
    // Frees the stack that reading needs before the module runs.
    #[inline(never)]
    pub fn load(store: S, factory: &Setup) -> Result<Kept<S>, RecordError> {
        let mut keeper = SettingsStore::new(store);
        let factory = Record::factory(factory)?;
        let family = factory.setup().family;
        let (record, origin) = match keeper.load() {
            Ok(Held::Record(record)) if record.setup().family == family => (record, Origin::Kept),
            Ok(Held::Record(_) | Held::OtherFamily) => (factory, Origin::OtherFamily),
            Ok(Held::Nothing) => (factory, Origin::Factory),
            Ok(Held::Newer(_)) => (factory, Origin::Newer),
            Err(_) => (factory, Origin::Unreadable),
        };
        Ok(Kept {
            keeper,
            record,
            origin,
        })
    }

    /// The settings that are stored, or will be.
    pub const fn record(&self) -> &Record {
        &self.record
    }

    /// Where the module's settings came from at the start.
    pub const fn origin(&self) -> Origin {
        self.origin
    }

    /// How often settings were stored, and how that went.
    pub const fn counters(&self) -> Counters {
        self.keeper.counters()
    }

    /// Stores these settings, now or as soon as possible.
    pub fn save(&mut self, now: Instant, settings: &Eeprom) {
        // The engine never has settings that its module can't have.
        if let Ok(record) = self.record.with(*settings) {
            self.record = record;
            self.keeper.save(now, &self.record);
        }
    }

    /// Stores pending settings when it is time; returns when to call again.
    pub fn poll(&mut self, now: Instant) -> Option<Instant> {
        self.keeper.poll(now)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use railbus_device::Family;
    use railbus_nvm::Bytes;
    use railbus_wire::Address;

    /// A store with this content, or one that does not answer.
    struct Holds(Result<Option<Bytes>, ()>);

    impl Store for &mut Holds {
        type Error = ();
        fn read<'a>(&mut self, room: &'a mut Bytes) -> Result<Option<&'a [u8]>, ()> {
            Ok(self.0?.map(|held| {
                *room = held;
                room.bytes()
            }))
        }
        fn write(&mut self, bytes: &[u8]) -> Result<(), ()> {
            self.0 = Ok(Bytes::of(bytes));
            Ok(())
        }
    }

    fn record(family: Family, address: u8) -> Record {
        Record::factory(&Setup::new(family, Address(address))).unwrap()
    }

    fn load(holds: &mut Holds) -> (Origin, u8) {
        let kept = Kept::load(holds, &Setup::new(Family::Erc8, Address(1))).unwrap();
        (kept.origin(), kept.record().setup().address.0)
    }

    #[test]
    fn only_settings_of_the_own_family_are_used() {
        let holding = |family| Holds(Ok(Bytes::of(&record(family, 7).encode())));
        assert_eq!(load(&mut holding(Family::Erc8)), (Origin::Kept, 7));
        assert_eq!(load(&mut holding(Family::R55)), (Origin::OtherFamily, 1));
        assert_eq!(load(&mut Holds(Ok(None))), (Origin::Factory, 1));
        assert_eq!(load(&mut Holds(Ok(Bytes::of(&[99])))), (Origin::Newer, 1));
        assert_eq!(load(&mut Holds(Err(()))), (Origin::Unreadable, 1));
    }

    #[test]
    fn what_is_saved_is_there_at_the_next_start() {
        let mut store = Holds(Ok(None));
        let factory = Setup::new(Family::Erc8, Address(1));
        let mut kept = Kept::load(&mut store, &factory).unwrap();
        let address = Address(9);
        let settings = Eeprom {
            address,
            ..kept.record().eeprom()
        };
        kept.save(Instant(0), &settings);
        assert_eq!(kept.counters().written, 1);
        assert_eq!(load(&mut store), (Origin::Kept, 9));
    }
}

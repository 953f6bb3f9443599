//! Baud rates, character formats, and how long characters and frames take on the wire.

use crate::Micros;
use core::fmt;

/// A baud rate in common use on serial lines, 1200 to 115200.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[allow(missing_docs)]
pub enum Baud {
    B1200,
    B2400,
    B4800,
    B9600,
    B19200,
    B38400,
    B57600,
    B115200,
}

impl Baud {
    /// All baud rates, slowest first.
    pub const ALL: [Baud; 8] = [
        Baud::B1200,
        Baud::B2400,
        Baud::B4800,
        Baud::B9600,
        Baud::B19200,
        Baud::B38400,
        Baud::B57600,
        Baud::B115200,
    ];

    /// The rates as text, in the order of [`Baud::ALL`].
    pub const NAMES: [&'static str; 8] = [
        "1200", "2400", "4800", "9600", "19200", "38400", "57600", "115200",
    ];

    /// Bits per second.
    #[must_use]
    pub const fn rate(self) -> u32 {
        match self {
            Baud::B1200 => 1200,
            Baud::B2400 => 2400,
            Baud::B4800 => 4800,
            Baud::B9600 => 9600,
            Baud::B19200 => 19200,
            Baud::B38400 => 38400,
            Baud::B57600 => 57600,
            Baud::B115200 => 115_200,
        }
    }

    /// The baud rate with this many bits per second, if there is one.
    #[must_use]
    pub fn from_rate(rate: u32) -> Option<Baud> {
        Baud::ALL.into_iter().find(|baud| baud.rate() == rate)
    }
}

impl fmt::Display for Baud {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.rate().fmt(f)
    }
}

/// Parity and stop bits of a character; there are always eight data bits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Character {
    /// No parity, one stop bit: 10 bits. The factory setting of all five families.
    #[default]
    N1,
    /// Even parity, one stop bit: 11 bits.
    E1,
    /// Odd parity, one stop bit: 11 bits.
    O1,
    /// No parity, two stop bits: 11 bits, required by the Modbus standard without parity.
    N2,
}

impl Character {
    /// All character formats.
    pub const ALL: [Character; 4] = [Character::N1, Character::E1, Character::O1, Character::N2];

    /// The character format with this name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Character> {
        Character::ALL
            .into_iter()
            .find(|known| known.name() == name)
    }

    /// How many bits a character takes, including start and stop bits: 10 or 11.
    #[must_use]
    pub const fn bits(self) -> u32 {
        match self {
            Character::N1 => 10,
            Character::E1 | Character::O1 | Character::N2 => 11,
        }
    }

    /// The name: `8N1`, `8E1`, `8O1`, `8N2`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Character::N1 => "8N1",
            Character::E1 => "8E1",
            Character::O1 => "8O1",
            Character::N2 => "8N2",
        }
    }
}

impl fmt::Display for Character {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// The serial settings: speed and character format.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct SerialSettings {
    /// The speed.
    pub baud: Baud,
    /// Parity and stop bits.
    pub character: Character,
}

impl SerialSettings {
    /// 9600 8N1, the factory setting of all five families.
    pub const FACTORY: SerialSettings = SerialSettings {
        baud: Baud::B9600,
        character: Character::N1,
    };

    /// How long this many characters take on the wire, rounded up to the microsecond.
    #[must_use]
    pub const fn frame_time(self, characters: usize) -> Micros {
        self.times(characters, self.character.bits() * 1_000_000)
    }

    /// The silence that ends a Modbus RTU frame: 3.5 characters of the format in use up to 19200
    /// baud, 1.75 ms above [MODBUS §1.4].
    #[must_use]
    #[cfg_attr(feature = "small", inline(never))]
    pub const fn t3_5(self) -> Micros {
        if self.baud.rate() > 19200 {
            Micros(1750)
        } else {
            self.tenths_of_characters(35)
        }
    }

    /// The longest pause inside a Modbus RTU frame: 1.5 characters up to 19200 baud, 0.75 ms
    /// above [MODBUS §1.5].
    #[must_use]
    pub const fn t1_5(self) -> Micros {
        if self.baud.rate() > 19200 {
            Micros(750)
        } else {
            self.tenths_of_characters(15)
        }
    }

    const fn tenths_of_characters(self, tenths: usize) -> Micros {
        self.times(tenths, self.character.bits() * 100_000)
    }

    /// `count` times this many millionths of a bit, rounded up. Every speed and both lengths are
    /// multiples of 400, and the time of as many units as there are bits in a second is a whole
    /// number of microseconds; so only the rest has to be divided, in 32 bits.
    #[cfg_attr(feature = "small", inline(never))]
    const fn times(self, count: usize, millionths: u32) -> Micros {
        let (each, rate) = (millionths / 400, self.baud.rate() / 400);
        let whole = (count / rate as usize) as u64;
        let rest = (count % rate as usize) as u32;
        let whole = whole.saturating_mul(each as u64);
        Micros(whole.saturating_add((rest * each).div_ceil(rate) as u64))
    }
}

impl fmt::Display for SerialSettings {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}", self.baud, self.character)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_those_of_the_standard() {
        let at = |baud, character| SerialSettings { baud, character };
        // [MODBUS §1.4, §1.5], 11-bit and 10-bit characters.
        assert_eq!(at(Baud::B1200, Character::E1).t3_5(), Micros(32_084));
        assert_eq!(at(Baud::B9600, Character::N2).t3_5(), Micros(4_011));
        assert_eq!(at(Baud::B9600, Character::N1).t3_5(), Micros(3_646));
        assert_eq!(at(Baud::B9600, Character::O1).t1_5(), Micros(1_719));
        assert_eq!(at(Baud::B19200, Character::N1).t3_5(), Micros(1_823));
        assert_eq!(at(Baud::B38400, Character::N1).t3_5(), Micros(1_750));
        assert_eq!(at(Baud::B115200, Character::N1).t1_5(), Micros(750));
        assert_eq!(SerialSettings::FACTORY.frame_time(8), Micros(8_334));
    }

    #[test]
    fn times_are_what_division_says() {
        let characters = [Character::N1, Character::E1];
        for (baud, character) in Baud::ALL
            .into_iter()
            .flat_map(|b| characters.map(|c| (b, c)))
        {
            let settings = SerialSettings { baud, character };
            let (bits, rate) = (u128::from(character.bits()), u128::from(baud.rate()));
            for count in (0..1000).chain([65_535, 1 << 24, u32::MAX as usize]) {
                let right = (count as u128 * bits * 1_000_000).div_ceil(rate);
                assert_eq!(
                    u128::from(settings.frame_time(count).0),
                    right,
                    "{settings} {count}"
                );
            }
        }
    }

    #[test]
    fn every_speed_is_found_by_its_rate() {
        for baud in Baud::ALL {
            assert_eq!(Baud::from_rate(baud.rate()), Some(baud));
        }
        assert_eq!(Baud::from_rate(9601), None);
    }
}

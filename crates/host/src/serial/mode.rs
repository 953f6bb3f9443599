//! Terminal modes for each speed and character format.

use railbus_wire::{Character, SerialSettings};
use rustix::termios::{ControlModes, InputModes, SpecialCodeIndex, Termios};

/// Sets a terminal's modes to pass bytes through at this speed and in this format. Pseudo-terminals
/// have no parity: requesting it fails or is ignored.
pub(crate) fn set(
    mode: &mut Termios,
    settings: SerialSettings,
    pts: bool,
) -> rustix::io::Result<()> {
    mode.make_raw();
    // A read returns "would block" until there is a byte. With 0 an empty port would look like one
    // that is gone.
    mode.special_codes[SpecialCodeIndex::VMIN] = 1;
    mode.special_codes[SpecialCodeIndex::VTIME] = 0;
    // A break comes from an open or unbiased line and is not a byte.
    mode.input_modes |= InputModes::IGNBRK;
    mode.input_modes
        .remove(InputModes::INPCK | InputModes::IGNPAR | InputModes::PARMRK);
    mode.control_modes
        .remove(ControlModes::PARENB | ControlModes::PARODD | ControlModes::CSTOPB);
    mode.control_modes
        .remove(ControlModes::CRTSCTS | ControlModes::CMSPAR);
    // HUPCL: the last close lowers RTS and DTR, even when this program is killed.
    mode.control_modes |=
        ControlModes::CS8 | ControlModes::CREAD | ControlModes::CLOCAL | ControlModes::HUPCL;
    let parity = match settings.character {
        Character::N1 => ControlModes::empty(),
        Character::N2 => ControlModes::CSTOPB,
        Character::E1 => ControlModes::PARENB,
        Character::O1 => ControlModes::PARENB | ControlModes::PARODD,
    };
    if !pts {
        mode.control_modes |= parity;
        if parity.contains(ControlModes::PARENB) {
            // A byte with wrong parity becomes 00, which invalidates the frame, as it should.
            mode.input_modes |= InputModes::INPCK;
        }
    }
    mode.set_speed(settings.baud.rate())
}

#[cfg(test)]
mod tests {
    use super::*;
    use railbus_wire::Baud;
    use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
    use rustix::termios::{LocalModes, tcgetattr};

    /// Arbitrary terminal modes to start from.
    fn some_mode() -> Termios {
        let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
        grantpt(&master).unwrap();
        unlockpt(&master).unwrap();
        let path = ptsname(&master, Vec::new()).unwrap();
        let flags = rustix::fs::OFlags::RDWR | rustix::fs::OFlags::NOCTTY;
        let slave = rustix::fs::open(path, flags, rustix::fs::Mode::empty()).unwrap();
        tcgetattr(&slave).unwrap()
    }

    #[test]
    fn every_speed_and_format_is_asked_for_rightly() {
        let any = some_mode();
        for baud in Baud::ALL {
            for (character, parity) in [
                (Character::N1, ControlModes::empty()),
                (Character::N2, ControlModes::CSTOPB),
                (Character::E1, ControlModes::PARENB),
                (Character::O1, ControlModes::PARENB | ControlModes::PARODD),
            ] {
                let mut mode = any.clone();
                set(&mut mode, SerialSettings { baud, character }, false).unwrap();
                assert_eq!(mode.input_speed(), baud.rate());
                assert_eq!(mode.output_speed(), baud.rate());
                let both = ControlModes::PARENB | ControlModes::PARODD | ControlModes::CSTOPB;
                assert_eq!(mode.control_modes & both, parity);
                assert_eq!(mode.control_modes & ControlModes::CSIZE, ControlModes::CS8);
                let checks = mode.input_modes.contains(InputModes::INPCK);
                assert_eq!(checks, parity.contains(ControlModes::PARENB));
                assert_eq!(mode.special_codes[SpecialCodeIndex::VMIN], 1);
                let cooked = LocalModes::ICANON | LocalModes::ECHO | LocalModes::ISIG;
                assert!(!mode.local_modes.intersects(cooked));
            }
        }
    }

    #[test]
    fn a_pseudo_terminal_is_asked_for_no_parity() {
        let mut mode = some_mode();
        for character in [Character::E1, Character::O1, Character::N2] {
            let baud = Baud::B19200;
            set(&mut mode, SerialSettings { baud, character }, true).unwrap();
            let both = ControlModes::PARENB | ControlModes::PARODD | ControlModes::CSTOPB;
            assert!(!mode.control_modes.intersects(both));
            assert_eq!(mode.output_speed(), 19200);
        }
    }

    #[test]
    fn a_format_leaves_nothing_of_the_one_before() {
        let mut mode = some_mode();
        let baud = Baud::B9600;
        for character in [Character::O1, Character::N2, Character::E1, Character::N1] {
            set(&mut mode, SerialSettings { baud, character }, false).unwrap();
        }
        let all = ControlModes::PARENB | ControlModes::PARODD | ControlModes::CSTOPB;
        assert!(!mode.control_modes.intersects(all));
        assert!(!mode.input_modes.contains(InputModes::INPCK));
    }
}

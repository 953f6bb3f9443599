//! Numbers at the ends of their ranges, packed runs, and frames that are full.

use railbus_wire::*;

#[test]
fn small_numbers() {
    assert!(PulseWidth::from_tenths(0).is_none() && PulseWidth::from_tenths(201).is_none());
    assert!(PulseWidth::from_tenths(1).is_some() && PulseWidth::from_tenths(200).is_some());
    assert!(Channel::new(31).is_some() && Channel::new(32).is_none());
    assert!(Bits::from_mask(0, 0).is_none() && Bits::from_mask(0, 33).is_none());
    assert_eq!(Bits::from_mask(!0, 32).unwrap().to_mask(), !0);
    assert_eq!(Bits::from_mask(!0, 5).unwrap().to_mask(), 0x1F);
    assert!(Bits::from_packed(&[0; 2], 8).is_none() && Bits::from_packed(&[0; 1], 9).is_none());
    assert!(Bits::from_packed(&[], 0).is_none() && Bits::from_packed(&[0; 251], 2001).is_none());
    assert!(Words::from_packed(&[0; 3]).is_none() && Words::from_packed(&[]).is_none());
    assert!(Words::from_packed(&[0; 252]).is_none() && Words::from_packed(&[0; 250]).is_some());
}

#[test]
fn runs_of_bits_and_words() {
    let packed = [0b1010_0101, 0xFF];
    let bits = Bits::from_packed(&packed, 9).unwrap();
    assert_eq!(bits.iter().collect::<Vec<bool>>().len(), 9);
    assert_eq!(
        (bits.get(0), bits.get(1), bits.get(8), bits.get(9)),
        (Some(true), Some(false), Some(true), None)
    );
    assert_eq!(bits.to_mask(), 0x1A5);
    // Bits above the last one do not count, the number of bits does.
    assert_eq!(bits, Bits::from_packed(&[0b1010_0101, 1], 9).unwrap());
    assert_ne!(bits, Bits::from_packed(&packed, 10).unwrap());
    assert_ne!(bits, Bits::from_packed(&[0, 1], 9).unwrap());
    assert_eq!(bits, Bits::from_mask(0x1A5, 9).unwrap());

    let words = Words::two(0x1234, 5);
    assert_eq!(
        (words.get(0), words.get(1), words.get(2)),
        (Some(0x1234), Some(5), None)
    );
    assert_eq!(words, Words::from_packed(&[0x12, 0x34, 0, 5]).unwrap());
    assert_ne!(words, Words::one(0x1234));
}

#[test]
fn frames_hold_what_fits() {
    let mut frame = Frame::new();
    assert!(frame.extend(&[1; FRAME_MAX]) && !frame.extend(&[1]));
    assert_eq!(frame.bytes(), [1; FRAME_MAX]);
    let full = frame.clone();
    frame.clear();
    assert!(frame.bytes().is_empty() && frame.extend(&[]));
    assert!(frame != full && frame == Frame::default());
}

//! Units of measurement as OPC UA has them: by their code of UNECE Recommendation 20.

use opcua::types::{EUInformation, LocalizedText};

/// Who defines the codes, as OPC UA names it.
const UNECE: &str = "http://www.opcfoundation.org/UA/units/un/cefact";
/// Units as people write them, their codes, and what they are called.
const UNITS: &[(&str, &str, &str)] = &[
    ("V", "VLT", "volt"),
    ("mV", "2Z", "millivolt"),
    ("A", "AMP", "ampere"),
    ("mA", "4C", "milliampere"),
    ("W", "WTT", "watt"),
    ("kW", "KWT", "kilowatt"),
    ("kWh", "KWH", "kilowatt hour"),
    ("Hz", "HTZ", "hertz"),
    ("%", "P1", "percent"),
    ("°C", "CEL", "degree Celsius"),
    ("℃", "CEL", "degree Celsius"),
    ("°F", "FAH", "degree Fahrenheit"),
    ("K", "KEL", "kelvin"),
    ("Pa", "PAL", "pascal"),
    ("kPa", "KPA", "kilopascal"),
    ("MPa", "MPA", "megapascal"),
    ("bar", "BAR", "bar [unit of pressure]"),
    ("mbar", "MBR", "millibar"),
    ("m", "MTR", "metre"),
    ("mm", "MMT", "millimetre"),
    ("cm", "CMT", "centimetre"),
    ("L", "LTR", "litre"),
    ("l", "LTR", "litre"),
    ("m³", "MTQ", "cubic metre"),
    ("m³/h", "MQH", "cubic metre per hour"),
    ("L/min", "L2", "litre per minute"),
    ("l/min", "L2", "litre per minute"),
    ("kg", "KGM", "kilogram"),
    ("t", "TNE", "tonne (metric ton)"),
    ("rpm", "RPM", "revolutions per minute"),
    ("m/s", "MTS", "metre per second"),
    ("s", "SEC", "second"),
    ("min", "MIN", "minute [unit of time]"),
    ("h", "HUR", "hour"),
    ("ppm", "59", "part per million"),
];

/// A unit as it is written. One that is not known has its text and the number -1.
pub(crate) fn unit(text: &str) -> EUInformation {
    let known = UNITS.iter().find(|(written, ..)| *written == text);
    let (id, called) = match known {
        Some((_, code, called)) => (number(code), *called),
        None => (-1, text),
    };
    EUInformation {
        namespace_uri: UNECE.into(),
        unit_id: id,
        display_name: LocalizedText::new("", text),
        description: LocalizedText::new("", called),
    }
}

/// The number of a code: its characters, one byte each [OPC UA part 8, 5.6.3].
fn number(code: &str) -> i32 {
    let bytes = code.bytes();
    bytes.fold(0, |number, byte| (number << 8) | i32::from(byte))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_have_the_numbers_of_the_published_table() {
        // [OPC UA part 8, UNECE_to_OPCUA.csv]
        for (code, id) in [
            ("CEL", 4_408_652),
            ("4C", 13_379),
            ("VLT", 5_655_636),
            ("P1", 20_529),
        ] {
            assert_eq!(number(code), id, "{code}");
        }
    }

    #[test]
    fn a_unit_that_is_not_known_keeps_its_text() {
        assert_eq!(unit("°C").unit_id, number("CEL"));
        let own = unit("跳");
        assert_eq!((own.unit_id, own.display_name.text.as_ref()), (-1, "跳"));
    }
}

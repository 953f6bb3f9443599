//! Frames that are misprinted in datasheets.

use railbus_words::Lang;

/// A frame as printed, and what is wrong with it.
#[derive(Debug)]
pub(super) struct Known {
    pub(super) id: &'static str,
    bytes: &'static [u8],
    note: [&'static str; 2],
}

impl Known {
    pub(super) const fn note(&self, lang: Lang) -> &'static str {
        lang.of(self.note)
    }
}

const KNOWN: &[Known] = &[
    Known {
        id: "E-01",
        bytes: &[0x6C, 0x63, 0x01, 0x03, 0x22, 0x34, 0x0D],
        note: [
            "the EDA9060A manual prints this frame; its 22 34 are left over from the EDA9050 and \
             the right frame is 6C 63 01 03 02 06 0D",
            "EDA9060A 手册如此印刷；其中 22 34 是 EDA9050 的残留，正确的报文为 6C 63 01 03 02 06 0D",
        ],
    },
    Known {
        id: "E-11",
        bytes: b"!112200\r",
        note: [
            "the EDA9060A manual prints this reply, which a module with 4 inputs can't give; the \
             bits above the fourth are ignored",
            "EDA9060A 手册如此印刷，但只有 4 路输入的模块不会如此应答；第 4 位以上忽略",
        ],
    },
    Known {
        id: "E-14",
        bytes: b"082\r",
        note: [
            "the EDA manuals leave out the $ here; the frame is $082",
            "EDA 手册此处漏印 $；正确的报文为 $082",
        ],
    },
];

/// The misprint with these bytes.
pub(super) fn find(bytes: &[u8]) -> Option<&'static Known> {
    KNOWN.iter().find(|known| known.bytes == bytes)
}

//! Roles: what stands in the certificate of a client, and what the settings let it switch.

use super::settings::ROLES;
use crate::access::is_selector;
use crate::northbound::kind::texts;
use railbus_site::config::change::Keys;
use std::collections::BTreeMap;
use x509_parser::asn1_rs::{FromDer, Utf8String};
use x509_parser::certificate::X509Certificate;
use x509_parser::der_parser::oid;

/// What the roles may switch.
#[derive(Debug, Default)]
pub(super) struct Roles(BTreeMap<String, Vec<String>>);

/// Why a certificate that names a role has none.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum RoleFlaw {
    /// More than one.
    Several,
    /// It is not a text as the specification has it, or empty.
    NotAText,
}

impl RoleFlaw {
    pub(super) const fn reason(self) -> &'static str {
        match self {
            RoleFlaw::Several => "several roles",
            RoleFlaw::NotAText => "not a UTF8String",
        }
    }
}

/// A role and outputs that it may switch, as `operator=pump.*`; none if it is not written so. The
/// name of a role may have a `=` of its own, a selector has none.
pub(super) fn entry(text: &str) -> Option<(&str, &str)> {
    let (role, points) = text.rsplit_once('=')?;
    let (role, points) = (role.trim(), points.trim());
    (!role.is_empty() && is_selector(points)).then_some((role, points))
}

impl Roles {
    pub(super) fn new(settings: &Keys) -> Roles {
        let mut roles: BTreeMap<String, Vec<String>> = BTreeMap::new();
        for (role, points) in texts(settings, ROLES).filter_map(entry) {
            let its = roles.entry(role.to_owned()).or_default();
            its.push(points.to_owned());
        }
        Roles(roles)
    }

    /// The outputs that this role may switch: none if it is not among them.
    pub(super) fn points(&self, role: &str) -> &[String] {
        self.0.get(role).map(Vec::as_slice).unwrap_or_default()
    }
}

/// The role in a certificate, if there is one.
pub(super) fn role_of(certificate: &X509Certificate<'_>) -> Result<Option<String>, RoleFlaw> {
    // Of the Modbus Organization.
    let its = oid!(1.3.6.1.4.1.50316.802.1);
    let mut roles = certificate.extensions().iter().filter(|ext| ext.oid == its);
    let Some(role) = roles.next() else {
        return Ok(None);
    };
    if roles.next().is_some() {
        return Err(RoleFlaw::Several);
    }
    match Utf8String::from_der(role.value) {
        Ok(([], text)) if !text.as_ref().is_empty() => Ok(Some(text.string())),
        _ => Err(RoleFlaw::NotAText),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rcgen::{CertificateParams, CustomExtension, KeyPair};
    use serde_json::json;

    /// The role in a certificate with these extensions.
    fn role(contents: &[&[u8]]) -> Result<Option<String>, RoleFlaw> {
        let mut params = CertificateParams::new(Vec::new()).unwrap();
        let oid = [1, 3, 6, 1, 4, 1, 50316, 802, 1];
        let extension = |content: &&[u8]| CustomExtension::from_oid_content(&oid, content.to_vec());
        params.custom_extensions = contents.iter().map(extension).collect();
        // Another one of the same organization is none of ours.
        let other = CustomExtension::from_oid_content(&[1, 3, 6, 1, 4, 1, 50316, 802, 2], vec![0]);
        params.custom_extensions.push(other);
        let made = params.self_signed(&KeyPair::generate().unwrap()).unwrap();
        let (_, certificate) = X509Certificate::from_der(made.der()).unwrap();
        role_of(&certificate)
    }

    #[test]
    fn a_role_is_one_text_in_utf8() {
        assert_eq!(role(&[]), Ok(None));
        let operator = [&[0x0C, 8][..], b"operator"].concat();
        assert_eq!(role(&[&operator]), Ok(Some("operator".to_owned())));
        let chinese = [&[0x0C, 9][..], "操作员".as_bytes()].concat();
        assert_eq!(role(&[&chinese]), Ok(Some("操作员".to_owned())));
        assert_eq!(role(&[&operator, &chinese]), Err(RoleFlaw::Several));
        assert_eq!(role(&[&operator, &operator]), Err(RoleFlaw::Several));
        let behind = [&operator[..], &[0]].concat();
        for wrong in [
            &b"operator"[..],
            &[],
            &[0x0C, 0],
            &[0x0C, 9, b'o'],
            &[0x0C, 2, 0xC3, 0x28],
            // A PrintableString, and an OCTET STRING.
            &[0x13, 1, b'o'],
            &[0x04, 3, 0x0C, 1, b'o'],
            &behind,
        ] {
            assert_eq!(role(&[wrong]), Err(RoleFlaw::NotAText), "{wrong:02X?}");
        }
    }

    #[test]
    fn a_role_may_have_several_entries() {
        let settings = json!({"roles": [
            "operator=pump.*", "plant = east=oven.k1", "operator = oven.k2", "wrong"
        ]});
        let roles = Roles::new(settings.as_object().unwrap());
        assert_eq!(roles.points("operator"), ["pump.*", "oven.k2"]);
        assert_eq!(roles.points("plant = east"), ["oven.k1"]);
        assert_eq!(roles.points("Operator"), [""; 0]);
        for wrong in [
            "",
            "operator",
            "operator=",
            "=pump.*",
            " =*",
            "operator=pump/do0",
        ] {
            assert_eq!(entry(wrong), None, "{wrong}");
        }
    }
}

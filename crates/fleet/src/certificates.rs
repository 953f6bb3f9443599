//! Certificates of the servers, from an authority that signs nothing else.

use crate::DAY_S;
use rcgen::{
    BasicConstraints, Certificate, CertificateParams, DnType, ExtendedKeyUsagePurpose, IsCa,
    Issuer, KeyPair, KeyUsagePurpose, date_time_ymd,
};
use std::time::Duration;

/// How many days the authority is valid.
const AUTHORITY_DAYS: u64 = 20 * 365;
/// How many days a server's certificate is valid.
const SERVER_DAYS: u64 = 5 * 365;
/// Valid from so much before now: clocks of sites may be slow.
const SLOW_CLOCKS_DAYS: u64 = 1;

/// A certificate and its key, in PEM.
pub(crate) struct Pair {
    pub(crate) certificate: String,
    pub(crate) key: String,
}

/// The authority of a fleet.
pub(crate) struct Authority {
    certificate: Certificate,
    issuer: Issuer<'static, KeyPair>,
    now: u64,
}

impl Authority {
    /// A new one, at this time in seconds since 1970.
    ///
    /// # Errors
    /// No key can be made.
    pub(crate) fn new(now: u64) -> Result<Authority, rcgen::Error> {
        let mut params = valid(CertificateParams::default(), now, AUTHORITY_DAYS);
        let name = &mut params.distinguished_name;
        name.push(DnType::CommonName, "railbus fleet");
        params.is_ca = IsCa::Ca(BasicConstraints::Constrained(0));
        params.key_usages = vec![KeyUsagePurpose::KeyCertSign, KeyUsagePurpose::CrlSign];
        let key = KeyPair::generate()?;
        let certificate = params.self_signed(&key)?;
        let issuer = Issuer::new(params, key);
        Ok(Authority {
            certificate,
            issuer,
            now,
        })
    }

    /// Its own certificate, which everybody gets, and its key, which stays with its owner.
    pub(crate) fn own(&self) -> Pair {
        Pair {
            certificate: self.certificate.pem(),
            key: self.issuer.key().serialize_pem(),
        }
    }

    /// That of a server with this host name, for its clients and for the other servers.
    ///
    /// # Errors
    /// No key can be made.
    pub(crate) fn server(&self, host: &str) -> Result<Pair, rcgen::Error> {
        let params = CertificateParams::new([host.to_owned()])?;
        let mut params = valid(params, self.now, SERVER_DAYS);
        params.distinguished_name.push(DnType::CommonName, host);
        params.key_usages = vec![KeyUsagePurpose::DigitalSignature];
        params.extended_key_usages = vec![
            ExtendedKeyUsagePurpose::ServerAuth,
            ExtendedKeyUsagePurpose::ClientAuth,
        ];
        params.use_authority_key_identifier_extension = true;
        let key = KeyPair::generate()?;
        let certificate = params.signed_by(&key, &self.issuer)?;
        Ok(Pair {
            certificate: certificate.pem(),
            key: key.serialize_pem(),
        })
    }
}

fn valid(mut params: CertificateParams, now: u64, days: u64) -> CertificateParams {
    let epoch = date_time_ymd(1970, 1, 1);
    let at = |seconds: u64| epoch + Duration::from_secs(seconds);
    params.not_before = at(now.saturating_sub(SLOW_CLOCKS_DAYS * DAY_S));
    params.not_after = at(now.saturating_add(days * DAY_S));
    params
}

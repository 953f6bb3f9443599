//! The certificate of the server, and those of clients: which are trusted, and which were rejected
//! because they are not.
//!
//! The library keeps them in folders. What is trusted is said by the configuration, by thumbprint:
//! the folders are made to agree with it, and do not grow.

use opcua::crypto::{CertificateStore, X509, X509Data};
use std::collections::BTreeSet;
use std::fs::{self, DirBuilder, Permissions};
use std::io;
use std::os::unix::fs::{DirBuilderExt as _, PermissionsExt as _};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// The bits of its key.
const KEY_BITS: u32 = 2_048;
/// For how long its certificate is valid: clients have to trust another one.
const VALID_DAYS: u32 = 20 * 365;
/// How many certificates of clients that are not trusted are remembered.
const UNKNOWN_MAX: usize = 32;
/// The files and folders, as the library names them.
pub(crate) const OWN_CERT: &str = "own/cert.der";
pub(crate) const OWN_KEY: &str = "private/private.pem";
const TRUSTED: &str = "trusted";
const REJECTED: &str = "rejected";
/// Ours: those that the library rejected, and that were reported.
const SEEN: &str = "seen";

/// The SHA-1 of a certificate, by which clients and servers name it: 40 hexadecimal digits.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Thumbprint(String);

impl Thumbprint {
    /// As people write it: with colons or spaces, in either case.
    #[must_use]
    pub fn parse(text: &str) -> Option<Thumbprint> {
        let is_left_out = |letter: &char| matches!(letter, ':' | ' ' | '-');
        let digits: String = text.chars().filter(|letter| !is_left_out(letter)).collect();
        let is_one = digits.len() == 40 && digits.chars().all(|digit| digit.is_ascii_hexdigit());
        is_one.then(|| Thumbprint(digits.to_ascii_lowercase()))
    }

    /// Its digits.
    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.0
    }

    fn of(certificate: &X509) -> Thumbprint {
        Thumbprint(certificate.thumbprint().as_hex_string())
    }
}

/// The certificate of a client that is not trusted.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UnknownCertificate {
    /// By which it is named.
    pub thumbprint: Thumbprint,
    /// Whom it is said to be of, as `CN=UaExpert/O=…`.
    pub subject: String,
}

/// The folder with all certificates.
#[derive(Debug)]
pub(crate) struct Certificates {
    folder: PathBuf,
    trusted: BTreeSet<Thumbprint>,
}

impl Certificates {
    /// Opens the folder, which only its owner can read, and sees to it that the server has a
    /// certificate for this application and these hosts. The folders agree with what is trusted.
    pub(crate) fn open(
        folder: &Path,
        trusted: &[Thumbprint],
        application: &str,
        hosts: &[String],
    ) -> io::Result<Certificates> {
        let mut builder = DirBuilder::new();
        builder.recursive(true).mode(0o700);
        for part in ["own", "private", TRUSTED, REJECTED, SEEN] {
            builder.create(folder.join(part))?;
        }
        fs::set_permissions(folder, Permissions::from_mode(0o700))?;
        let certificates = Certificates {
            folder: folder.to_owned(),
            trusted: trusted.iter().cloned().collect(),
        };
        certificates.own(application, hosts)?;
        certificates.sort();
        Ok(certificates)
    }

    /// The server's own certificate: made anew where there is none that fits.
    fn own(&self, application: &str, hosts: &[String]) -> io::Result<()> {
        let (cert, key) = (self.folder.join(OWN_CERT), self.folder.join(OWN_KEY));
        let fits = CertificateStore::read_cert(&cert).is_ok_and(|cert| {
            let now = opcua::types::DateTime::now().as_chrono();
            cert.is_time_valid(&now).is_ok()
                && cert.is_application_uri_valid(application).is_ok()
                && hosts
                    .iter()
                    .all(|host| cert.is_hostname_valid(host).is_ok())
        });
        if fits && CertificateStore::read_pkey(&key).is_ok() {
            return Ok(());
        }
        let hosts = Some(hosts.to_vec());
        let names = X509Data::alt_host_names(application, hosts, false, false, false);
        let data = X509Data {
            key_size: KEY_BITS,
            common_name: "railbus".to_owned(),
            organization: "railbus".to_owned(),
            organizational_unit: "OPC UA".to_owned(),
            country: "CN".to_owned(),
            state: "-".to_owned(),
            alt_host_names: names,
            certificate_duration_days: VALID_DAYS,
        };
        let made = CertificateStore::create_certificate_and_key(&data, true, &cert, &key);
        made.map_err(io::Error::other)?;
        // Its folder is closed to others already.
        fs::set_permissions(&key, Permissions::from_mode(0o600))
    }

    /// Makes the folders agree with what is trusted, and keeps them small. The clients that were
    /// turned away since the last time, the newest last.
    pub(crate) fn sort(&self) -> Vec<UnknownCertificate> {
        let mut unknown = Vec::new();
        for folder in [REJECTED, SEEN, TRUSTED] {
            for (path, certificate) in self.files(folder) {
                let thumbprint = Thumbprint::of(&certificate);
                let belongs = match self.trusted.contains(&thumbprint) {
                    true => TRUSTED,
                    // Out of the library's way, which would not tell of another try.
                    false => SEEN,
                };
                if belongs == SEEN && folder == REJECTED {
                    unknown.push(UnknownCertificate {
                        thumbprint,
                        subject: certificate.subject_name(),
                    });
                }
                if belongs == folder {
                    continue;
                }
                let name = path.file_name().unwrap_or_default();
                let moved = fs::rename(&path, self.folder.join(belongs).join(name));
                // Whoever is in the folder of those is trusted.
                if moved.is_err() && folder == TRUSTED {
                    let _ = fs::remove_file(&path);
                }
            }
        }
        let mut files: Vec<(SystemTime, PathBuf)> = self.paths(SEEN);
        files.sort();
        let many = files.len().saturating_sub(UNKNOWN_MAX);
        for (_, path) in files.into_iter().take(many) {
            let _ = fs::remove_file(path);
        }
        unknown
    }

    /// The certificates of a folder, by their age.
    fn files(&self, folder: &str) -> Vec<(PathBuf, X509)> {
        let mut paths = self.paths(folder);
        paths.sort();
        let read = |(_, path): (SystemTime, PathBuf)| {
            let certificate = CertificateStore::read_cert(&path);
            // What is no certificate is none to trust.
            let certificate = certificate
                .inspect_err(|_| _ = fs::remove_file(&path))
                .ok()?;
            Some((path, certificate))
        };
        paths.into_iter().filter_map(read).collect()
    }

    fn paths(&self, folder: &str) -> Vec<(SystemTime, PathBuf)> {
        // A folder that can't be read has nothing that could be used.
        let entries = fs::read_dir(self.folder.join(folder)).into_iter().flatten();
        let age = |entry: fs::DirEntry| {
            let modified = entry.metadata().and_then(|about| about.modified());
            (modified.unwrap_or(SystemTime::UNIX_EPOCH), entry.path())
        };
        entries.flatten().map(age).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    struct Folder(PathBuf);

    impl Folder {
        fn new(name: &str) -> Folder {
            let unique = format!("railbus-pki-{}-{name}", std::process::id());
            Folder(std::env::temp_dir().join(unique))
        }

        fn open(&self, trusted: &[Thumbprint], application: &str) -> Certificates {
            Certificates::open(&self.0, trusted, application, &["localhost".to_owned()]).unwrap()
        }

        fn own(&self) -> Vec<u8> {
            fs::read(self.0.join(OWN_CERT)).unwrap()
        }

        /// As the library does with a certificate that it does not know.
        fn reject(&self, certificate: &[u8], name: &str) {
            fs::write(self.0.join(REJECTED).join(name), certificate).unwrap();
        }

        fn has(&self, folder: &str) -> usize {
            fs::read_dir(self.0.join(folder)).unwrap().count()
        }
    }

    impl Drop for Folder {
        fn drop(&mut self) {
            let _ = fs::remove_dir_all(&self.0);
        }
    }

    #[test]
    fn its_own_certificate_stays_while_it_fits_and_only_the_owner_reads_the_key() {
        let folder = Folder::new("own");
        folder.open(&[], "urn:here:railbus:a");
        let first = folder.own();
        folder.open(&[], "urn:here:railbus:a");
        assert_eq!(folder.own(), first);
        folder.open(&[], "urn:here:railbus:b");
        assert_ne!(folder.own(), first, "of another application");
        let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode() & 0o777;
        assert_eq!(mode(&folder.0), 0o700);
        assert_eq!(mode(&folder.0.join(OWN_KEY)), 0o600);
    }

    #[test]
    fn who_is_trusted_is_what_the_configuration_says() {
        let folder = Folder::new("trust");
        let certificates = folder.open(&[], "urn:here:railbus:a");
        let client = folder.own();
        folder.reject(&client, "client.der");
        let [unknown] = &certificates.sort()[..] else {
            panic!("one is not known");
        };
        assert_eq!(unknown.thumbprint.as_str().len(), 40);
        assert!(unknown.subject.contains("railbus"), "{}", unknown.subject);
        let trusted = folder.open(
            std::slice::from_ref(&unknown.thumbprint),
            "urn:here:railbus:a",
        );
        let has = || [TRUSTED, REJECTED, SEEN].map(|part| folder.has(part));
        assert_eq!(has(), [1, 0, 0]);
        assert_eq!(trusted.sort(), []);
        let nobody = folder.open(&[], "urn:here:railbus:a");
        assert_eq!(has(), [0, 0, 1], "no longer");
        assert_eq!(nobody.sort(), [], "it was not turned away since");
        // The library tells of it again.
        folder.reject(&client, "client.der");
        assert_eq!(nobody.sort().len(), 1, "it tries once more");
    }

    #[test]
    fn those_that_are_not_trusted_do_not_fill_the_disk() {
        let folder = Folder::new("many");
        let certificates = folder.open(&[], "urn:here:railbus:a");
        let client = folder.own();
        for number in 0..UNKNOWN_MAX + 5 {
            let name = format!("{number:02}.der");
            folder.reject(&client, &name);
            let path = folder.0.join(REJECTED).join(&name);
            let file = fs::File::options().append(true).open(path).unwrap();
            let age = Duration::from_secs(1_000 + number as u64);
            file.set_modified(SystemTime::UNIX_EPOCH + age).unwrap();
        }
        folder.reject(b"no certificate", "x.der");
        certificates.sort();
        assert_eq!((folder.has(REJECTED), folder.has(SEEN)), (0, UNKNOWN_MAX));
        let seen = |name| folder.0.join(SEEN).join(name).exists();
        assert!(!seen("04.der") && seen("05.der"));
    }

    #[test]
    fn a_thumbprint_has_forty_digits() {
        let digits = "0123456789abcdef0123456789abcdef01234567";
        let parsed = Thumbprint::parse(&digits.to_uppercase()).unwrap();
        assert_eq!(parsed.as_str(), digits);
        for wrong in [
            "",
            "01",
            &digits[1..],
            &format!("{digits}0"),
            &digits.replace('0', "g"),
        ] {
            assert_eq!(Thumbprint::parse(wrong), None, "{wrong}");
        }
    }
}

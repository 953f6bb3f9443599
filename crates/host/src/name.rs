//! The names of ports, as users write them.

use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

/// The TCP port of Modbus TCP if the name has none.
const MODBUS_TCP: u16 = 502;

/// The port of a line. Its text form is what [`FromStr`] reads.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub enum LineName {
    /// `/dev/ttyUSB0`, `/dev/serial/by-id/…`: a serial port.
    Serial(PathBuf),
    /// `pty:/tmp/v0`: a terminal without a wire behind it, whose bytes take no time.
    Pty(PathBuf),
    /// `tcp:10.0.0.5:4001`: a serial server that passes bytes through.
    Tcp {
        /// Name or address.
        host: String,
        /// TCP port.
        port: u16,
    },
    /// `mbtcp:10.0.0.5:502`: a Modbus TCP gateway. The default port is 502.
    ModbusTcp {
        /// Name or address.
        host: String,
        /// TCP port.
        port: u16,
    },
}

/// Why a text is not the name of a port.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NameError {
    /// It is neither an absolute path nor begins with `tcp:`, `mbtcp:` or `pty:`.
    Form,
    /// `pty:` without an absolute path.
    Path,
    /// No host, or an IPv6 address without brackets.
    Host,
    /// No TCP port, or none from 1 to 65535.
    Port,
}

impl fmt::Display for NameError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            NameError::Form => "write /dev/…, tcp:HOST:PORT, mbtcp:HOST[:PORT] or pty:/PATH",
            NameError::Path => "after pty: comes a path that begins with /",
            NameError::Host => "write HOST:PORT, an IPv6 address in brackets",
            NameError::Port => "the TCP port is a number from 1 to 65535",
        })
    }
}

impl std::error::Error for NameError {}

impl FromStr for LineName {
    type Err = NameError;

    fn from_str(text: &str) -> Result<LineName, NameError> {
        if text.starts_with('/') {
            return Ok(LineName::Serial(text.into()));
        }
        match text.split_once(':').ok_or(NameError::Form)? {
            ("pty", path) if path.starts_with('/') => Ok(LineName::Pty(path.into())),
            ("pty", _) => Err(NameError::Path),
            ("tcp", rest) => {
                let (host, port) = endpoint(rest)?;
                let port = port.ok_or(NameError::Port)?;
                Ok(LineName::Tcp { host, port })
            }
            ("mbtcp", rest) => {
                let (host, port) = endpoint(rest)?;
                let port = port.unwrap_or(MODBUS_TCP);
                Ok(LineName::ModbusTcp { host, port })
            }
            _ => Err(NameError::Form),
        }
    }
}

/// `host`, `host:port`, `[v6]` or `[v6]:port`.
fn endpoint(text: &str) -> Result<(String, Option<u16>), NameError> {
    let (host, port) = match text.strip_prefix('[') {
        Some(rest) => {
            let (host, after) = rest.split_once(']').ok_or(NameError::Host)?;
            let port = match after.strip_prefix(':') {
                None if !after.is_empty() => return Err(NameError::Host),
                port => port,
            };
            (host, port)
        }
        None => match text.split_once(':') {
            Some((_, port)) if port.contains(':') => return Err(NameError::Host),
            Some((host, port)) => (host, Some(port)),
            None => (text, None),
        },
    };
    if host.is_empty() || host.contains(|c: char| c.is_whitespace() || c == '/') {
        return Err(NameError::Host);
    }
    let port = port.map(|port| match port.parse() {
        Ok(0) | Err(_) => Err(NameError::Port),
        Ok(port) => Ok(port),
    });
    Ok((host.to_owned(), port.transpose()?))
}

impl fmt::Display for LineName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            LineName::Serial(path) => path.display().fmt(f),
            LineName::Pty(path) => write!(f, "pty:{}", path.display()),
            LineName::Tcp { host, port } => write!(f, "tcp:{}:{port}", Bracketed(host)),
            LineName::ModbusTcp { host, port } => write!(f, "mbtcp:{}:{port}", Bracketed(host)),
        }
    }
}

/// A host as written before a colon.
struct Bracketed<'a>(&'a str);

impl fmt::Display for Bracketed<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.0.contains(':') {
            write!(f, "[{}]", self.0)
        } else {
            f.write_str(self.0)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_form_is_read_and_written_back() {
        let forms = [
            "/dev/ttyUSB0",
            "/dev/serial/by-id/usb-FTDI_FT232R_A10KZP45-if00-port0",
            "pty:/tmp/v0",
            "tcp:10.0.0.5:4001",
            "tcp:[fe80::1]:4001",
            "mbtcp:gateway.local:502",
        ];
        for form in forms {
            let name: LineName = form.parse().unwrap();
            assert_eq!(name.to_string(), form);
        }
        let name: LineName = "mbtcp:[::1]".parse().unwrap();
        assert_eq!(name.to_string(), "mbtcp:[::1]:502");
    }

    #[test]
    fn what_names_no_port_is_told_why() {
        let wrong = [
            ("", NameError::Form),
            ("ttyUSB0", NameError::Form),
            ("COM3", NameError::Form),
            ("udp:host:1", NameError::Form),
            ("pty:", NameError::Path),
            ("pty:v0", NameError::Path),
            ("tcp:", NameError::Host),
            ("tcp::4001", NameError::Host),
            ("tcp:fe80::1:4001", NameError::Host),
            ("tcp:[::1:4001", NameError::Host),
            ("tcp:[::1]4001", NameError::Host),
            ("tcp:a b:1", NameError::Host),
            ("tcp:host", NameError::Port),
            ("tcp:host:", NameError::Port),
            ("tcp:host:0", NameError::Port),
            ("tcp:host:65536", NameError::Port),
            ("mbtcp:host:x", NameError::Port),
        ];
        for (text, why) in wrong {
            assert_eq!(text.parse::<LineName>(), Err(why), "{text}");
        }
    }
}

//! Where packets come from: the connection strings of ART's own SDK.

use crate::error::{Error, Result};
use std::net::{IpAddr, Ipv4Addr, SocketAddr, SocketAddrV4, ToSocketAddrs};

/// Port that is customary for tracking data; nothing in the protocol demands it.
pub const DATA_PORT: u16 = 5000;
/// Port from which a controller sends, and to which the greeting for firewalls goes.
pub const CONTROLLER_PORT: u16 = 50_107;
/// What the vendor's SDK sends as greeting, so that a firewall that keeps state lets the stream in. A controller need not react.
pub const GREETING: &[u8; 10] = b"fw4dtsdkc\0";

const HINT: &str = "write PORT, GROUP:PORT (multicast), HOST:PORT, or HOST:PORT:fw to greet the controller through a firewall";

/// What to listen to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Endpoint {
    /// `port`: whatever comes to this port. 0 lets the system choose.
    Any {
        /// UDP port.
        port: u16,
    },
    /// `group:port`: a multicast group.
    Multicast {
        /// In 224.0.0.0/4.
        group: Ipv4Addr,
        /// UDP port.
        port: u16,
    },
    /// `host:port` and `host:port:fw`: packets of this controller only.
    Controller {
        /// Address of the controller.
        host: Ipv4Addr,
        /// UDP port.
        port: u16,
        /// Whether to send [`GREETING`] to it.
        greet: bool,
    },
}

impl Endpoint {
    /// Reads a connection string; names of hosts are looked up.
    ///
    /// # Errors
    /// [`Error::InvalidValue`] if it is none, [`Error::Network`] for a host that is not found.
    pub fn parse(text: &str) -> Result<Self> {
        let refuse = |got: &str| Error::value("connection", "a connection string", format!("{got:?}"), HINT);
        let parts: Vec<&str> = text.trim().split(':').collect();
        let port = |text: &str| text.parse::<u16>().map_err(|_| refuse(text));
        match parts[..] {
            [number] => Ok(Self::Any { port: port(number)? }),
            [host, number] | [host, number, "fw"] if !host.is_empty() => {
                let (port, greet) = (port(number)?, parts.len() == 3);
                let host = resolve(host)?;
                match (host.is_multicast(), greet) {
                    (true, false) => Ok(Self::Multicast { group: host, port }),
                    (true, true) => {
                        Err(Error::value("connection", "a host to greet", text, "a multicast group cannot be greeted: leave out :fw"))
                    }
                    (false, _) => Ok(Self::Controller { host, port, greet }),
                }
            }
            _ => Err(refuse(text)),
        }
    }

    /// The port to listen on.
    pub fn port(&self) -> u16 {
        match *self {
            Self::Any { port } | Self::Multicast { port, .. } | Self::Controller { port, .. } => port,
        }
    }
}

/// A host's IPv4 address, from numbers or by its name.
///
/// # Errors
/// [`Error::Network`] if there is none.
pub fn resolve(host: &str) -> Result<Ipv4Addr> {
    if let Ok(address) = host.parse() {
        return Ok(address);
    }
    let failed = |got: String| Error::network(host, "a host with an IPv4 address", got, "check the name, or give the address in numbers");
    let found = (host, 0).to_socket_addrs().map_err(|e| failed(e.to_string()))?;
    let v4 = |address: SocketAddr| if let IpAddr::V4(v4) = address.ip() { Some(v4) } else { None };
    found.into_iter().find_map(v4).ok_or_else(|| failed("no such address".into()))
}

/// `host:port` to send to, or a port of this machine.
///
/// # Errors
/// [`Error::InvalidValue`] if it is none, [`Error::Network`] for a host that is not found.
pub fn target(text: &str) -> Result<SocketAddrV4> {
    let (host, port) = text.trim().rsplit_once(':').unwrap_or(("127.0.0.1", text.trim()));
    match port.parse::<u16>() {
        Ok(port) if port > 0 => Ok(SocketAddrV4::new(resolve(host)?, port)),
        _ => Err(Error::value("target", "HOST:PORT or PORT", format!("{text:?}"), "5000 is the customary port")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strings_of_the_sdk() {
        let controller = |port, greet| Endpoint::Controller { host: Ipv4Addr::new(10, 0, 0, 7), port, greet };
        assert_eq!(Endpoint::parse("5000"), Ok(Endpoint::Any { port: 5000 }));
        assert_eq!(Endpoint::parse("225.1.1.1:5000"), Ok(Endpoint::Multicast { group: Ipv4Addr::new(225, 1, 1, 1), port: 5000 }));
        assert_eq!(Endpoint::parse("10.0.0.7:5001"), Ok(controller(5001, false)));
        assert_eq!(Endpoint::parse(" 10.0.0.7:5002:fw "), Ok(controller(5002, true)));
        assert_eq!(Endpoint::parse("localhost:5000").map(|e| e.port()), Ok(5000));
    }

    #[test]
    fn everything_else_says_what_to_write() {
        for text in ["", "x", "70000", "-1", ":5000", "1.2.3.4:", "1.2.3.4:5000:tcp", "1.2.3.4:5000:fw:fw", "225.1.1.1:5000:fw"] {
            let error = Endpoint::parse(text).unwrap_err().to_string();
            assert!(error.starts_with("connection: expected"), "{text:?}: {error}");
        }
        assert!(matches!(Endpoint::parse("no-such-host.invalid:5000"), Err(Error::Network { .. })));
        assert_eq!(target("5000"), Ok(SocketAddrV4::new(Ipv4Addr::LOCALHOST, 5000)));
        assert!(target("0").is_err() && target("host:").is_err());
    }
}

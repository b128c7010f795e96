//! What a service manager is told: ready, alive, stopping (sd_notify(3), the protocol of systemd).

use std::os::linux::net::SocketAddrExt;
use std::os::unix::ffi::OsStrExt;
use std::os::unix::net::{SocketAddr, UnixDatagram};

/// Set by the service manager: a path, or a name that begins with @.
pub(crate) const SOCKET: &str = "NOTIFY_SOCKET";
/// Set by the service manager with `WatchdogSec=`: `[us]` silence after which it restarts the service.
pub(crate) const WATCHDOG: &str = "WATCHDOG_USEC";

/// The line to the service manager; silent where there is none.
#[derive(Debug)]
pub(crate) struct Notifier {
    line: Option<(UnixDatagram, SocketAddr)>,
    /// `[ns]` between signs of life, where they are asked for.
    every_ns: Option<u64>,
    due_ns: u64,
}

impl Notifier {
    /// Connects to the service manager that started this process; where its address cannot be used, a line says so.
    pub(crate) fn from_environment() -> Self {
        let nobody = Self { line: None, every_ns: None, due_ns: 0 };
        let Some(name) = std::env::var_os(SOCKET) else { return nobody };
        match Self::connect(name.as_encoded_bytes()) {
            Ok(line) => {
                let microseconds = std::env::var(WATCHDOG).ok().and_then(|text| text.parse::<u64>().ok());
                // Half of the time, as the protocol asks.
                Self { line: Some(line), every_ns: microseconds.map(|every_us| every_us * 500), due_ns: 0 }
            }
            Err(error) => {
                crate::output::note(format!(
                    "{SOCKET} {}: {error}; no service manager is told",
                    name.display()
                ));
                nobody
            }
        }
    }

    fn connect(name: &[u8]) -> std::io::Result<(UnixDatagram, SocketAddr)> {
        let address = match name.strip_prefix(b"@") {
            Some(name) => SocketAddr::from_abstract_name(name)?,
            None => SocketAddr::from_pathname(std::ffi::OsStr::from_bytes(name))?,
        };
        let socket = UnixDatagram::unbound()?;
        // A manager that does not read must not hold up supervision.
        socket.set_nonblocking(true)?;
        Ok((socket, address))
    }

    fn say(&self, word: &str) {
        if let Some((socket, address)) = &self.line {
            // Nobody is harmed by a manager that does not listen.
            let _ = socket.send_to_addr(word.as_bytes(), address);
        }
    }

    /// Every node beats.
    pub(crate) fn ready(&self) {
        self.say("READY=1");
    }

    /// The supervisor looked at everything.
    pub(crate) fn alive(&mut self, now_ns: u64) {
        if let Some(every_ns) = self.every_ns
            && now_ns >= self.due_ns
        {
            self.due_ns = now_ns + every_ns;
            self.say("WATCHDOG=1");
        }
    }

    /// The robot is brought to rest.
    pub(crate) fn stopping(&self) {
        self.say("STOPPING=1");
    }
}

//! The terminal's keys while a recording plays: read here, where the terminal is, and handed to the player.

use sidestep_player::{KEYS_SOCKET, Key};
use std::fs::File;
use std::io::{IsTerminal, Read};
use std::os::fd::{AsFd, AsRawFd};
use std::os::unix::net::UnixDatagram;
use std::path::Path;

/// A terminal that hands over each key at once and does not show it; as it was before when this is dropped.
///
/// Ctrl-C stays a signal, so every way in which a run ends comes back through the end of this value.
pub(crate) struct Keyboard {
    terminal: File,
    before: libc::termios,
    socket: UnixDatagram,
}

fn attributes(terminal: &File) -> Option<libc::termios> {
    // SAFETY: all zeros is a value of this plain struct, and the call writes it while the descriptor is open.
    #[allow(unsafe_code, reason = "std knows no terminal modes")]
    unsafe {
        let mut found: libc::termios = std::mem::zeroed();
        (libc::tcgetattr(terminal.as_raw_fd(), &raw mut found) == 0).then_some(found)
    }
}

fn set_attributes(terminal: &File, wanted: &libc::termios) -> bool {
    // SAFETY: `wanted` is a valid value for the length of the call, and the descriptor is open.
    #[allow(unsafe_code, reason = "std knows no terminal modes")]
    unsafe {
        libc::tcsetattr(terminal.as_raw_fd(), libc::TCSANOW, wanted) == 0
    }
}

/// Whether this process may touch the terminal: one in the background would be stopped for it.
fn is_in_front(terminal: &File) -> bool {
    // SAFETY: both calls only ask, and have no memory preconditions.
    #[allow(unsafe_code, reason = "std knows no process groups of terminals")]
    unsafe {
        libc::tcgetpgrp(terminal.as_raw_fd()) == libc::getpgrp()
    }
}

impl Keyboard {
    /// Takes the keys of the terminal; `None` where standard input is none, or is in use by somebody else.
    pub(crate) fn take() -> Option<Self> {
        let input = std::io::stdin();
        if !input.is_terminal() {
            return None;
        }
        let terminal = File::from(input.as_fd().try_clone_to_owned().ok()?);
        let before = attributes(&terminal).filter(|_| is_in_front(&terminal))?;
        let socket = UnixDatagram::unbound().ok()?;
        socket.set_nonblocking(true).ok()?;
        let mut keys = before;
        keys.c_lflag &= !(libc::ICANON | libc::ECHO);
        // A read takes what is there and never waits.
        keys.c_cc[libc::VMIN] = 0;
        keys.c_cc[libc::VTIME] = 0;
        set_attributes(&terminal, &keys).then_some(Self { terminal, before, socket })
    }

    /// Hands what was pressed since the last look to the player of the run in this folder.
    pub(crate) fn pass_on(&mut self, run: &Path) {
        let mut bytes = [0; 64];
        if !is_in_front(&self.terminal) {
            return;
        }
        let Ok(count) = self.terminal.read(&mut bytes) else { return };
        let keys: Vec<u8> = Key::read(&bytes[..count]).into_iter().map(Key::byte).collect();
        if !keys.is_empty() {
            // A player that is not there yet, or any more, misses them, as it should.
            let _ = self.socket.send_to(&keys, run.join(KEYS_SOCKET));
        }
    }
}

impl Drop for Keyboard {
    fn drop(&mut self) {
        set_attributes(&self.terminal, &self.before);
    }
}

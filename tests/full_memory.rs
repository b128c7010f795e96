//! Shared memory without room: refused before the start with the remedy, and told as the likely cause of an end.

use crate::driver::{graph_with, refused};
use crate::harness::{Alone, Folder, finish, run};
use std::process::{Command, Stdio};

/// Where nothing may be mounted, the script ends so.
const NO_MOUNT: i32 = 77;

#[test]
fn too_little_shared_memory_is_refused_with_the_remedy() {
    let script = format!("mount -t tmpfs -o size=8m tmpfs /dev/shm || exit {NO_MOUNT}; exec \"$@\"");
    let mut command = Command::new("unshare");
    command.args(["--mount", "sh", "-c", &script, "sh", env!("CARGO_BIN_EXE_sidestep")]);
    command.args(["run", "sim", "--for", "1s"]).stdin(Stdio::null());
    let child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn();
    match child.map(finish) {
        Ok(outcome) if outcome.code != NO_MOUNT && !outcome.err.starts_with("unshare:") => {
            refused(&outcome, 3, &["8 of 8 MB free in /dev/shm, 32 MB needed: end other runs, or mount"]);
        }
        _ => println!("skipped: a small shared memory needs a mount, which this user may not make"),
    }
}

/// The system ends so whoever writes to shared memory that is full.
#[test]
fn a_driver_that_found_no_room_for_a_message_is_said_to_have() {
    let _alone = Alone::wait();
    let folder = Folder::new("no-room");
    let graph = graph_with(&folder, &["sh", "-c", "kill -BUS $$"]);
    let outcome = run(&["run", &graph, "--set", "supervision.restarts_most=0"]);
    let says =
        ["perhaps it found no room for a message; now ", " MB free in /dev/shm: end other runs, or mount"];
    refused(&outcome, 1, &[&["ended and given up: signal 7 after"], &says[..]].concat());
}

//! Shared memory without room: refused before the start with the remedy, and told as the likely cause of an end.

use crate::driver::{graph_with, refused};
use crate::harness::{Alone, Folder, Outcome, finish, run, sidestep};
use crate::recordings::SmallDisk;
use std::process::{Command, Stdio};

/// The command with a disk in the place of its shared memory; `None` where this user may not do that.
fn within(disk: &SmallDisk, command: &Command) -> Option<Command> {
    let script = r#"mount --bind "$1" /dev/shm && shift && exec "$@""#;
    let of = |program: &str| {
        let mut within = Command::new("unshare");
        within.args(["--mount", "sh", "-c", script, "sh"]).arg(&disk.0.0).arg(program);
        within.stdin(Stdio::null());
        within
    };
    let mut within = of("true");
    if !within.stderr(Stdio::null()).status().is_ok_and(|status| status.success()) {
        return None;
    }
    let mut within = of(command.get_program().to_str()?);
    within.args(command.get_args()).current_dir(command.get_current_dir()?);
    Some(within)
}

fn mounted(size_mb: u32, arguments: &[&str]) -> Option<(SmallDisk, Command)> {
    let disk = SmallDisk::mount(size_mb);
    let command = disk.as_ref().and_then(|disk| within(disk, &sidestep(arguments)));
    if command.is_none() {
        println!("skipped: a small shared memory needs a mount, which this user may not make");
    }
    disk.zip(command)
}

#[test]
fn too_little_shared_memory_is_refused_with_the_remedy() {
    let Some((_disk, mut command)) = mounted(8, &["run", "sim", "--for", "1s"]) else { return };
    let Outcome { code, err, .. } =
        finish(command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap());
    assert_eq!(code, 3, "{err}");
    assert!(err.contains("8 of 8 MB free in /dev/shm, 32 MB needed: end other runs, or mount"), "{err}");
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

//! Shared memory without room is refused before the start, with the remedy.

use crate::harness::{Outcome, finish, sidestep};
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
